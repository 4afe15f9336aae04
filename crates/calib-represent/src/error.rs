use calib_core::Cancelled;
use calib_files::FileError;

use crate::RepresentConfigError;

/// Why a representation cannot be trained, read or chosen.
#[derive(Debug, thiserror::Error)]
pub enum RepresentError {
    /// A hyperparameter is outside its range.
    #[error(transparent)]
    Config(#[from] RepresentConfigError),
    /// No pair of states can be drawn.
    #[error(
        "no two successive states lie in the {part} part of the training range ({rows} states); \
         take a longer range, or fewer gaps"
    )]
    NoPairs {
        /// "training" or "validation".
        part: &'static str,
        /// States of that part.
        rows: usize,
    },
    /// Weights that are no encoder.
    #[error("{path} holds no encoder: {reason}")]
    Encoder {
        /// The file.
        path: std::path::PathBuf,
        /// What does not fit.
        reason: String,
    },
    /// Arithmetic that another library does failed.
    #[error("{0}")]
    Backend(String),
    /// The observer asked to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// A file could not be read or written.
    #[error(transparent)]
    File(#[from] FileError),
}
