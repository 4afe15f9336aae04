//! The states of a log, as all steps of a command share them.

use std::path::PathBuf;

use calib_data::Dataset;

/// A prepared log.
#[derive(Clone)]
pub struct Prepared {
    /// Its states, divided as in the study.
    pub dataset: Dataset,
    /// The file of the training states; `None` if it could not be written.
    pub(crate) states: Option<PathBuf>,
}
