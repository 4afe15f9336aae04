use std::fmt;

use crate::{AgentError, Learner};

/// Hardware or a library that trains the value networks of many runs side by side: a GPU, or a library on the
/// processor.
///
/// An accelerator handles only networks. [`train_together`](crate::train_together) chooses the transitions that each
/// network learns from and scores its predictions. Results agree with native training within the rounding of sums in
/// single precision.
pub trait Accelerator: fmt::Debug + Sync {
    /// Returns the class of its numerical results, such as `libtorch-cuda`. Results of two classes never share a key. Within a
    /// class, the numbers of a network depend only on what it learns from, not on the networks trained beside it.
    fn class(&self) -> &str;

    /// Bytes that networks, mini-batches and streams may take at a time.
    fn memory(&self) -> u64;

    /// Creates networks before their first update.
    ///
    /// # Errors
    /// [`AgentError::Accelerator`] if there is not enough memory for them.
    fn networks(&self, networks: &Networks<'_>) -> Result<Box<dyn Lockstep>, AgentError>;
}

/// Value networks of one shape and one kind of optimiser: one for every learner in every run. All runs have the same
/// learners. The learners share γ and whether they have target networks.
#[derive(Debug)]
pub struct Networks<'a> {
    /// Sizes of the layers, input first, the single output last.
    pub sizes: Vec<usize>,
    /// The learners of each run: how each learns, what it predicts, and where it starts.
    pub learners: &'a [Learner<'a>],
    /// Initial parameters of the learners without a checkpoint, one vector per run, in the order of
    /// [`calib_nn::Mlp::parameters`].
    pub parameters: Vec<Vec<f32>>,
    /// States of the runs, `[run, state, column]`. Runs that are shorter than the others are padded with zeros.
    pub states: Vec<f32>,
    /// Number of transitions per update.
    pub batch: usize,
}

/// A sequence of steps for the networks. In each step they predict the value of a state, then learn from transitions.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Steps {
    /// The state whose value is predicted before the update, `[step, run]`.
    pub present: Vec<u32>,
    /// The states from which the transitions of a mini-batch start, `[step, run, transition]`. Empty if these steps
    /// only predict.
    pub starts: Vec<u32>,
}

/// The results of some steps, `[step, run, learner]`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LockstepResults {
    /// Values of the present states.
    pub predictions: Vec<f32>,
    /// Whether every TD error was finite; true where no update was made.
    pub finite: Vec<bool>,
}

/// Networks in the middle of training.
pub trait Lockstep {
    /// Makes these steps, one after the other.
    ///
    /// # Errors
    /// [`AgentError::Accelerator`].
    fn make(&mut self, steps: &Steps) -> Result<LockstepResults, AgentError>;

    /// Whether all parameters are finite, `[run, learner]`.
    ///
    /// # Errors
    /// [`AgentError::Accelerator`].
    fn finite(&self) -> Result<Vec<bool>, AgentError>;
}
