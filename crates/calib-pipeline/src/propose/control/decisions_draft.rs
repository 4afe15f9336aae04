//! What drafts of a study of agents that act are made of: the findings about the log, and the decisions in it.

use calib_base::{
    Context as _, StepError, bail,
    clock::TimeTaken,
    options::ProposeOptions,
    output::{Printer, count, counted},
};
use calib_control::{ControlConfig, ControlError, Decisions};
use calib_data::{Sentinel, Sketch};
use calib_files::TemporaryFolder;
use calib_propose::{
    Angle, Cleaning, Clock, ControlDraft, DecisionColumns, LogDraft, ProposedControl, Scope,
    action_levels, actions_are_continuous,
};
use calib_study::{Job, Request};

use super::columns::{self, LookedAt};
use crate::{
    control::{self, ActionLog},
    propose::{given::gives, look::SketchedLog},
};

/// Steps of the shortest runs for measuring costs, and of drafts of which no runs are made.
pub(super) const SHORT: usize = 200;

/// Returns the `[control]` section of a study.
pub(super) fn section(job: &Job) -> Result<&ControlConfig, StepError> {
    job.study().control.as_ref().context("the study has no [control]")
}

/// The findings about a log of decisions before they are read.
pub(super) struct ExaminedDecisions {
    /// Sketch of the sensors alone.
    pub(super) sketch: Sketch,
    pub(super) sentinels: Vec<Sentinel>,
    pub(super) angles: Vec<Angle>,
    pub(super) clock: Option<Clock>,
    pub(super) scope: Scope,
    pub(super) cleaning: Cleaning,
    /// Number of different values of each action column. `None` for a column with very many.
    pub(super) distinct: Vec<Option<u32>>,
}

impl ExaminedDecisions {
    pub(super) fn at(
        args: &ProposeOptions,
        columns: &DecisionColumns,
        printer: &Printer,
    ) -> Result<Self, StepError> {
        let SketchedLog { mut sketch, sentinels, angles, clock, .. } =
            SketchedLog::at(args, |name| !columns.contains(name), printer)?;
        let is_limited = gives(args, "data.include") || gives(args, "data.exclude");
        let looked_at = if is_limited { LookedAt::Part } else { LookedAt::Whole };
        columns::check(columns, &sketch, looked_at)?;
        let distinct = columns::distinct(columns, &sketch);
        sketch.channels.retain(|channel| !columns.contains(&channel.name));
        let scope = Scope::of(&sketch).map_err(StepError::other)?;
        let cleaning = Cleaning::of(&sketch, &scope);
        Ok(Self { sketch, sentinels, angles, clock, scope, cleaning, distinct })
    }
}

/// The decisions as the study will read them.
pub(super) struct ReadDecisions {
    pub(super) log: ActionLog,
    /// `control.levels` with its reason. `None` if every combination of values is an action, or the key was given.
    pub(super) levels: Option<(usize, String)>,
    /// Time to read them, in seconds.
    pub(super) secs: f64,
}

/// The inputs that all drafts of a study share.
pub(super) struct ControlDrafting<'a> {
    pub(super) args: &'a ProposeOptions,
    /// `data.path`.
    pub(super) path: &'a str,
    pub(super) columns: &'a DecisionColumns,
    pub(super) look: &'a ExaminedDecisions,
    pub(super) place: &'a TemporaryFolder,
}

impl ControlDrafting<'_> {
    pub(super) fn text(
        &self,
        levels: Option<&(usize, String)>,
        proposed: Option<&ProposedControl>,
        steps: usize,
        steps_reason: &str,
    ) -> String {
        let look = self.look;
        let log = LogDraft {
            sketch: &look.sketch,
            path: self.path,
            scope: &look.scope,
            cleaning: &look.cleaning,
            missing_values: &look.sentinels,
            angles: &look.angles,
            clock: look.clock,
        };
        ControlDraft { log, columns: self.columns, levels, proposed, steps, steps_reason }.text()
    }

    /// Creates a job whose results are discarded.
    pub(super) fn job(&self, text: String) -> Result<Job, StepError> {
        let request = Request {
            output: Some(self.place.path().join("results")),
            set: self.args.set.clone(),
            ..Request::new(&self.args.study)
        };
        Ok(Job::of_text(request, text)?)
    }

    /// Reads the decisions. Every combination of values is an action, or there are levels if that gives too many
    /// actions.
    pub(super) fn decisions(&self, printer: &Printer) -> Result<ReadDecisions, StepError> {
        let job = self.job(self.text(None, None, SHORT, ""))?;
        let config = section(&job)?;
        let (read, taken) = TimeTaken::by(|| control::read_log(&job, config, printer));
        let Some(why) = self.why_continuous(&read, config) else {
            let log = read?;
            self.refuse_one_action(&log.decisions)?;
            return Ok(ReadDecisions { log, levels: None, secs: taken.secs });
        };
        if let Some(name) = &self.columns.probability {
            bail!(
                "--probability {name}: {why}, so that actions are taken for continuous ones (control.levels), and what was set then has no \
                 probability but a density; leave --probability out, or round the columns of --action"
            );
        }
        let levels =
            action_levels(&self.look.distinct, config.most_actions).map_err(StepError::other)?;
        drop(read);
        let levels = (levels, why);
        let job = self.job(self.text(Some(&levels), None, SHORT, ""))?;
        // Other warnings about the log have been printed already. Only those about levels are new.
        let config = section(&job)?;
        let silent = printer.silent();
        let (log, taken) = TimeTaken::by(|| control::read_log(&job, config, &silent));
        let log = log?;
        log.outlying.iter().for_each(|told| printer.warn(told));
        self.refuse_one_action(&log.decisions)?;
        Ok(ReadDecisions { log, levels: Some(levels), secs: taken.secs })
    }

    /// Returns the reason to treat actions as continuous, if there is one.
    fn why_continuous(
        &self,
        read: &Result<ActionLog, StepError>,
        config: &ControlConfig,
    ) -> Option<String> {
        match read {
            Err(reason) if has_many_actions(reason) => {
                Some(format!("the log has more than {} different actions", config.most_actions))
            }
            Ok(ActionLog { decisions, .. }) if config.levels.is_none() => {
                let [actions, steps] = [decisions.levels(), decisions.len()];
                actions_are_continuous(&self.look.distinct, actions, steps).then(|| {
                    format!(
                        "the log has {} different actions in {}",
                        count(actions),
                        counted(steps, "step")
                    )
                })
            }
            _ => None,
        }
    }

    /// Refuses a log in which the same action was taken in all steps.
    fn refuse_one_action(&self, log: &Decisions) -> Result<(), StepError> {
        if log.counts().iter().filter(|&&taken| taken > 0).count() < 2 {
            bail!(
                "--action {}: one action was taken in all {}, so there is nothing to choose; use a log in which several were",
                self.columns.actions.join(" --action "),
                counted(log.len(), "step")
            );
        }
        Ok(())
    }
}

/// Whether a log has more actions than a study may have.
fn has_many_actions(reason: &StepError) -> bool {
    let StepError::Control(reason) = reason.root() else { return false };
    matches!(reason.as_ref(), ControlError::ManyActions { .. })
}
