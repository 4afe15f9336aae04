//! The section `[control]` of a study.

use calib_base::StepError;
use calib_control::{ControlConfig, Support};
use calib_study::Job;

/// Returns the error for a study without actions.
pub(super) fn no_section(job: &Job) -> StepError {
    StepError::message(format!(
        "{} has no [control] section; say there which columns are actions: [control] actions = [\"COLUMN\"]",
        job.layout().study().display()
    ))
}

/// Returns the requirements on the log for a supported choice.
pub(super) fn support(config: &ControlConfig) -> Support {
    Support {
        most_uncovered: config.most_uncovered,
        fewest_terminals: config.terminal.as_ref().map_or(0, |_| config.fewest_terminals),
    }
}
