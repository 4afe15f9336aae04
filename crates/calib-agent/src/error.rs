use calib_core::Cancelled;

use crate::AgentConfigError;

/// An error that prevents or stops the training of agents.
#[derive(Clone, Debug, thiserror::Error, PartialEq)]
pub enum AgentError {
    /// A hyperparameter is outside its range.
    #[error(transparent)]
    Config(#[from] AgentConfigError),
    /// The sensor to predict is not in the state.
    #[error(
        "cumulant column {got} does not exist: expected a column below {width}, the width of a state"
    )]
    Cumulant {
        /// The requested column.
        got: usize,
        /// Number of values in a state.
        width: usize,
    },
    /// The sensor to predict is not finite at some step.
    #[error("cumulant column {column} is {value} at step {step}: expected finite states")]
    NonFiniteCumulant {
        /// The column.
        column: usize,
        /// The step.
        step: usize,
        /// The value at that step.
        value: f32,
    },
    /// A run is longer than its stream.
    #[error("a run of {steps} steps needs more states than that, and its data has {states}")]
    ShortStream {
        /// Requested number of steps.
        steps: usize,
        /// Number of states of the stream.
        states: usize,
    },
    /// No step can be scored.
    #[error(
        "no step can be scored: with gamma = {gamma}, scoring a prediction needs the {horizon} states after it, the longest of {pieces} stretches without a gap has {longest} steps, and scoring begins at step {first} of {steps}; use longer runs, a smaller gamma, or score the whole run"
    )]
    NothingToScore {
        /// Discount factor.
        gamma: f64,
        /// Unscored steps at the end of each piece.
        horizon: usize,
        /// Number of unbroken pieces.
        pieces: usize,
        /// Steps of the longest piece.
        longest: usize,
        /// First step that scoring may include.
        first: usize,
        /// Steps of the stream.
        steps: usize,
    },
    /// A checkpoint does not fit the value function that should start from it.
    #[error(
        "the checkpoint has {got} parameters: expected {expected}, as many as the value function has"
    )]
    Checkpoint {
        /// Parameters of the checkpoint.
        got: usize,
        /// Parameters of the value function.
        expected: usize,
    },
    /// A baseline does not fit the stream.
    #[error(
        "the baseline has {got} predictions: expected {expected}, one for each state of the stream"
    )]
    Baseline {
        /// Number of predictions of the baseline.
        got: usize,
        /// Number of states of the stream.
        expected: usize,
    },
    /// There are too few transitions to pre-train on.
    #[error(
        "pre-training requires at least {expected} transitions to learn from and one to validate on, \
         got {got} in all; use a longer range, or a smaller pretrain.validation_fraction or agent.batch_size"
    )]
    TooFewTransitions {
        /// Available transitions.
        got: usize,
        /// Transitions of one mini-batch.
        expected: usize,
    },
    /// Pre-training shuffles transitions, but eligibility traces need their
    /// order.
    #[error(
        "agents are pre-trained on mini-batches in random order, and agent.optimiser learns along the stream; use \"adam\" or \"sgd\", or \
         start from a predictor that is fitted on the log (agent.baseline) instead of pre-training"
    )]
    TracesInBatches,
    /// Runs side by side have states of different widths.
    #[error("runs that learn side by side see as many values a state: got {got} beside {expected}")]
    Widths {
        /// Width of the states of one run.
        got: usize,
        /// Width of the states of the first run.
        expected: usize,
    },
    /// The accelerator does not support these agents.
    #[error("agents with {0} are not trained side by side; leave --device out")]
    NotAccelerated(&'static str),
    /// An accelerator failed.
    #[error("{0}")]
    Accelerator(String),
    /// The state of a long run could not be stored.
    #[error("cannot keep the state of a run: {0}")]
    Keep(String),
    /// The observer asked to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}
