use calib_core::Cancelled;
use calib_files::FileError;

/// An error of a parametric model or of its rollouts.
#[derive(Debug, thiserror::Error)]
pub enum DynamicsError {
    /// A value is outside its range.
    #[error("`{key}` must be {expected}, got {got}")]
    Config {
        /// The key.
        key: &'static str,
        /// The expected values.
        expected: String,
        /// The value that was given.
        got: String,
    },
    /// There are too few transitions for training and validation.
    #[error(
        "{transitions} transitions cannot be split into a training part and the last {fraction} of them \
         for validation; give more data"
    )]
    TooFewTransitions {
        /// Number of transitions of the training range.
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
        /// The part: training or validation.
        part: &'static str,
        /// Number of transitions in a sequence.
        length: usize,
    },
    /// The training loss is not finite.
    #[error("the loss of epoch {epoch} is {loss}; lower `learning_rate`, now {learning_rate}")]
    Diverged {
        /// The epoch, counted from 1.
        epoch: usize,
        /// The loss of the epoch.
        loss: f64,
        /// The step size.
        learning_rate: f64,
    },
    /// The weights do not form a model of this study.
    #[error("the weights do not fit: {reason}")]
    Weights {
        /// What does not fit.
        reason: String,
    },
    /// A model that another library runs has failed.
    #[error("{0}")]
    Backend(String),
    /// A file could not be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// The monitor interrupted.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}
