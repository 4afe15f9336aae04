use calib_core::Cancelled;
use calib_files::FileError;

/// Why there is no parametric model, or no rollout of it.
#[derive(Debug, thiserror::Error)]
pub enum DynamicsError {
    /// A value is outside its range.
    #[error("`{key}` must be {expected}, got {got}")]
    Config {
        /// The key.
        key: &'static str,
        /// What it may be.
        expected: String,
        /// What it is.
        got: String,
    },
    /// Too few transitions to learn from and to validate with.
    #[error(
        "{transitions} transitions cannot be split into a training part and the last {fraction} of them \
         for validation; give more data"
    )]
    TooFewTransitions {
        /// Transitions of the training range.
        transitions: usize,
        /// The validation fraction.
        fraction: f64,
    },
    /// No segment is long enough for a sequence.
    #[error(
        "no segment of the {part} part has {length} successive transitions; lower `sequence_length`, or give \
         data with fewer gaps"
    )]
    NoSequence {
        /// Training or validation.
        part: &'static str,
        /// Transitions of a sequence.
        length: usize,
    },
    /// Training left the finite numbers.
    #[error("the loss of epoch {epoch} is {loss}; lower `learning_rate`, now {learning_rate}")]
    Diverged {
        /// The epoch, counted from 1.
        epoch: usize,
        /// Its loss.
        loss: f64,
        /// The step size.
        learning_rate: f64,
    },
    /// Weights that do not make a model of the study.
    #[error("the weights do not fit: {reason}")]
    Weights {
        /// What is wrong.
        reason: String,
    },
    /// A model that is run by another library failed.
    #[error("{0}")]
    Backend(String),
    /// A file could not be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// The observer asked to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}
