use calib_base::{
    StepError,
    output::{Printer, counted},
};
use calib_control::{ActionModel, Distance};
use calib_model_steps::represent::decisions;
use calib_study::Job;

use super::{
    described::{ActionLogSummary, described},
    log, show,
};

/// What the log of a study with `[control]` did, in which states, and where it says what an action does; nothing of another study.
pub(crate) fn inspect(job: &Job, printer: &Printer) -> Result<Option<ActionLogSummary>, StepError> {
    let Some(config) = &job.study().control else { return Ok(None) };
    let log = log::read(job, config, printer)?;
    let plain = || (Distance::Euclidean, log.decisions.states().clone());
    let (distance, metric) = match config.model.distance {
        Distance::Euclidean => plain(),
        Distance::Laplacian => decisions::kept(job, log.material())?.map_or_else(
            || {
                printer.say("the representation is trained by `calib control`; here distances are those of states");
                plain()
            },
            |psi| (Distance::Laplacian, psi),
        ),
    };
    log::require_model(&log.decisions, config)?;
    let starts = log::starts(&log.decisions, &metric, config.start)?;
    let worst = config.worst_return.unwrap_or(0.0);
    let progress = printer.progress();
    let model =
        ActionModel::build(log.decisions, &metric, starts, &config.model, worst, &progress)?;
    described(&model, distance, &log.names).map(Some)
}

impl ActionLogSummary {
    /// Show it to people.
    ///
    /// # Errors
    /// If nothing can be printed.
    pub fn show(&self, printer: &Printer) -> Result<(), StepError> {
        let columns = counted(self.columns.len(), "column");
        printer.result("")?;
        printer.result(&format!(
            "for agents that act: {}; states of {columns}, without what they do and get",
            show::line(self)
        ))?;
        printer.lines(&show::actions(self))?;
        printer.lines(&show::states(self))?;
        Ok(())
    }
}
