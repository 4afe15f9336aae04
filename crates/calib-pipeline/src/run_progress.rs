//! Progress of the whole run of a study.

use std::cell::Cell;

use calib_base::{
    StepError,
    output::{Printer, Stage},
};
use calib_study::{Job, Scope, StepKind, Study};

use crate::plan::Plan;

/// Counts the stages of a run, and the sweeps still to come, which are almost all of the work.
pub(crate) struct RunProgress<'a> {
    talk: &'a Printer,
    stages: usize,
    begun: Cell<usize>,
    /// Passes over streams of all sweeps that have not begun.
    later: Cell<usize>,
}

impl<'a> RunProgress<'a> {
    /// Starts the progress of a run with `stages` stages and the sweeps of `models`.
    pub(crate) fn new(
        talk: &'a Printer,
        stages: usize,
        plan: &Plan,
        models: &[&Job],
    ) -> Result<Self, StepError> {
        let mut later = 0;
        for model in models {
            let parts = model.parts(Scope::Deployment)?;
            let left = parts.iter().filter(|part| plan.is_to_do(StepKind::Sweep, part));
            later += left.map(|part| passes(part.study())).sum::<usize>();
        }
        Ok(Self { talk, stages, begun: Cell::new(0), later: Cell::new(later) })
    }

    pub(crate) fn stage(&self, name: &str) {
        self.begun.set(self.begun.get() + 1);
        self.tell(None);
        self.talk.heading(&format!("[{}/{}] {name}", self.begun.get(), self.stages));
    }

    pub(crate) fn skip(&self, stages: usize) {
        self.begun.set(self.begun.get() + stages);
    }

    /// Reports that the sweep of a part begins, if it is to do.
    pub(crate) fn sweep(&self, plan: &Plan, part: &Job) {
        if plan.is_to_do(StepKind::Sweep, part) {
            let own = passes(part.study());
            let later = self.later.get().saturating_sub(own);
            self.later.set(later);
            self.tell(Some(later as f64 / own.max(1) as f64));
        }
    }

    fn tell(&self, later: Option<f64>) {
        self.talk.stage(Stage { number: self.begun.get(), stages: self.stages, later });
    }
}

/// Returns the number of passes over streams in a sweep, as far as the study determines it.
pub(crate) fn passes(study: &Study) -> usize {
    let online = if study.data.held_out.is_some() { study.sweep.online_runs } else { 0 };
    study.members() * study.member_runs() + online + study.sweep.log_replay_runs
}
