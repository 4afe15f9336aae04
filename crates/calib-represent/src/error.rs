use calib_core::Cancelled;
use calib_files::FileError;

use crate::RepresentConfigError;

/// An error of training, reading or choosing a representation.
#[derive(Debug, thiserror::Error)]
pub enum RepresentError {
    /// A hyperparameter is outside its range.
    #[error(transparent)]
    Config(#[from] RepresentConfigError),
    /// A part of the data has no two successive states, so no pair can be drawn.
    #[error(
        "no two successive states lie in the {part} part of the training range ({rows} states); \
         take a longer range, or fewer gaps"
    )]
    NoPairs {
        /// The part: "training" or "validation".
        part: &'static str,
        /// Number of states in that part.
        rows: usize,
    },
    /// The weights do not form an encoder.
    #[error("{path} holds no encoder: {reason}")]
    Encoder {
        /// The file.
        path: std::path::PathBuf,
        /// What does not fit.
        reason: String,
    },
    /// A backend's arithmetic failed.
    #[error("{0}")]
    Backend(String),
    /// The monitor interrupted.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// A file could not be read or written.
    #[error(transparent)]
    File(#[from] FileError),
}
