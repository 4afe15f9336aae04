use calib_pipeline::{Observer, Remark, StepError};
use calib_study::Place;

use crate::{
    ExitStatus,
    output::{excerpt, interrupted, is_to_be_tried_again},
};

/// Reports an error, and returns the exit status.
pub(crate) fn report(error: &StepError, observer: &dyn Observer) -> ExitStatus {
    let told = error.to_string();
    let told = if error.was_cancelled() { interrupted() } else { told.as_str() };
    observer.remark(Remark::Error(told));
    match error.exit_code() {
        130 if is_to_be_tried_again() => ExitStatus::TryAgain,
        130 => ExitStatus::Interrupted,
        4 => ExitStatus::Incomplete,
        _ => {
            excerpt(&error.place().map(Place::excerpt).unwrap_or_default());
            ExitStatus::BadInput
        }
    }
}
