//! What a study of agents that act costs on this machine. A dry run estimates it in about a second. Trial runs follow if
//! they take little of the requested time, because they include all work and the load of all threads.

use calib_base::{
    StepError,
    clock::{Stopwatch, TimeTaken},
    output::Printer,
};
use calib_propose::{CONTROL_STEPS, Costs, ProposedControl};

use super::decisions_draft::{ControlDrafting, ReadDecisions, SHORT, section};
use crate::{
    control,
    propose::{deadline::TimeLimit, trial},
};

/// Factor from one length of runs to the next.
const LONGER: usize = 4;
/// Runs that take less than this share of the requested time are too short to measure the time per step.
const WORTH: f64 = 0.01;
/// Share of the requested time after which no longer runs are timed. If the first two lengths would take more, none are.
const TRIED: f64 = 0.25;

/// Costs of a study by the estimate of a dry run.
struct EstimatedCosts {
    costs: Costs,
    /// Estimated time of trial runs of the first two lengths, in seconds.
    trial_secs: f64,
}

impl ControlDrafting<'_> {
    /// Returns the costs of the study. `None` if the time is over before they are known.
    pub(super) fn costs(
        &self,
        read: &ReadDecisions,
        proposed: &ProposedControl,
        begun: Stopwatch,
        printer: &Printer,
    ) -> Result<Option<Costs>, StepError> {
        let limit = TimeLimit::new(begun, self.args.within, printer);
        let estimated = limit.done(|watched| {
            printer.say("measuring how long a study takes");
            self.estimated(read, proposed, watched)
        })?;
        let estimated = estimated.flatten();
        if let Some(EstimatedCosts { costs, trial_secs }) = &estimated
            && begun.elapsed().as_secs_f64() + trial_secs > TRIED * self.args.within
        {
            return Ok(Some(*costs));
        }
        // If trials that should have fitted do not, the estimate is wrong too.
        limit.done(|watched| self.timed(read, proposed, begun, watched))
    }

    /// Estimates the costs of the study as a dry run does. `None` if a dry run cannot.
    fn estimated(
        &self,
        read: &ReadDecisions,
        proposed: &ProposedControl,
        printer: &Printer,
    ) -> Result<Option<EstimatedCosts>, StepError> {
        let job = self.job(self.text(read.levels.as_ref(), Some(proposed), SHORT, ""))?;
        let [least, most] = CONTROL_STEPS;
        let lengths = [SHORT, LONGER * SHORT, least, most];
        let secs = control::expected_secs(&job, section(&job)?, &read.log, lengths, printer)?;
        Ok(secs.map(|[short, longer, less, more]| EstimatedCosts {
            costs: trial::costs([(least as f64, less), (most as f64, more)], read.secs),
            // The model and each length read the log again.
            trial_secs: short + longer + 3.0 * read.secs,
        }))
    }

    /// Measures the costs of the study with short runs of all settings. Longer runs follow until they take a measurable
    /// share of the requested time.
    fn timed(
        &self,
        read: &ReadDecisions,
        proposed: &ProposedControl,
        begun: Stopwatch,
        printer: &Printer,
    ) -> Result<Costs, StepError> {
        let job =
            |steps: usize| self.job(self.text(read.levels.as_ref(), Some(proposed), steps, ""));
        let model = job(SHORT)?;
        let (built, building) = TimeTaken::by(|| control::build(&model, printer));
        built?;
        let swept = |steps: usize| -> Result<(f64, f64), StepError> {
            let job = job(steps)?;
            let (judged, taken) = TimeTaken::by(|| control::run(&job, printer));
            judged?;
            Ok((steps as f64, taken.secs))
        };
        let less = swept(SHORT)?;
        let mut steps = LONGER * SHORT;
        let mut more = swept(steps)?;
        let within = self.args.within;
        while more.1 - less.1 < WORTH * within && begun.elapsed().as_secs_f64() < TRIED * within {
            steps *= LONGER;
            more = swept(steps)?;
        }
        Ok(trial::costs([less, more], building.secs))
    }
}
