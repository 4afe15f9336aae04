use calib_control::ActionModel;
use calib_study::Job;

use super::{
    described::{LogTold, described},
    log, show,
};
use crate::output::Printer;

/// What the log of a study with `[control]` did, in which states, and where it says what an action does; nothing of another study.
pub(crate) fn inspect(job: &Job, printer: &Printer) -> anyhow::Result<Option<LogTold>> {
    let Some(config) = &job.study().control else { return Ok(None) };
    let log = log::read(job, config, printer)?;
    let starts = log::starts(&log.decisions, config.start)?;
    let metric = log.decisions.states().clone();
    let worst = config.worst_return.unwrap_or(0.0);
    let progress = printer.progress();
    let model =
        ActionModel::build(log.decisions, &metric, starts, &config.model, worst, &progress)?;
    described(&model, &log.names).map(Some)
}

impl LogTold {
    /// Show it to people.
    ///
    /// # Errors
    /// If nothing can be printed.
    pub fn show(&self, printer: &Printer) -> anyhow::Result<()> {
        printer.result(&show::line(self))?;
        printer.lines(&show::actions(self))?;
        printer.lines(&show::states(self))?;
        Ok(())
    }
}
