use std::fmt;

use crate::{AgentError, Learner};

/// Arithmetic that trains the value networks of many runs side by side: a GPU, or a library's on the processor.
///
/// [`train_together`](crate::train_together) says what each network learns from, and scores what it predicts; here is nothing but
/// networks. What it computes agrees with native training within the rounding of sums in single precision.
pub trait Accelerator: fmt::Debug + Sync {
    /// What its numbers are known by, such as `libtorch-cuda`: results of two classes never share a key. Within a class a network's numbers follow from
    /// what it learns from, and not from what else is side by side with it.
    fn class(&self) -> &str;

    /// Bytes that networks, mini-batches and streams may take at a time.
    fn memory(&self) -> u64;

    /// Networks before their first update.
    ///
    /// # Errors
    /// [`AgentError::Accelerator`] if there is no room for them.
    fn networks(&self, networks: &Networks<'_>) -> Result<Box<dyn Lockstep>, AgentError>;
}

/// Value networks of one shape, and of one kind of optimiser: one for every learner in every run. Learners are the same in all runs; they share γ,
/// and whether they have target networks.
#[derive(Debug)]
pub struct Networks<'a> {
    /// Sizes of the layers, input first, the single output last.
    pub sizes: Vec<usize>,
    /// How each learns, what it predicts, and what it starts from.
    pub learners: &'a [Learner<'a>],
    /// Of each run: what learners without a checkpoint start from, as [`calib_nn::Mlp::parameters`].
    pub parameters: Vec<Vec<f32>>,
    /// What runs see, `[run, state, column]`; runs that are shorter than the others end in zeros.
    pub states: Vec<f32>,
    /// Transitions of an update.
    pub batch: usize,
}

/// What networks do next, step after step: predict the value of a state, and learn from transitions.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Steps {
    /// Of each step and run: the state whose value is predicted, before anything is learnt.
    pub present: Vec<u32>,
    /// Of each step and run: the states from which the transitions of a mini-batch start, `[step, run, transition]`. Nothing if these steps only
    /// predict.
    pub starts: Vec<u32>,
}

/// What came of some steps, `[step, run, learner]`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LockstepResults {
    /// Values of present states.
    pub predictions: Vec<f32>,
    /// Whether every TD error was finite; true where nothing was learnt.
    pub finite: Vec<bool>,
}

/// Networks in the middle of training.
pub trait Lockstep {
    /// Make these steps, one after the other.
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
