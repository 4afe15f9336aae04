use serde::{Deserialize, Serialize};

use crate::{Checkpoint, outcome::Tracker};

/// Stores the state of a long run, so that an interrupted run can resume from the last stored state.
///
/// The result of a run does not depend on whether, where and how often it was resumed.
pub trait Checkpointer {
    /// Returns the work between two stored states, in multiplications
    /// (see [`train_learners`](crate::train_learners)).
    fn work_between(&self) -> u64;

    /// Returns the last stored state, if there is one of exactly this run.
    fn load(&self) -> Option<RunState>;

    /// Stores this state in place of the one before.
    ///
    /// # Errors
    /// The reason why the state cannot be stored, for the user.
    fn keep(&self, state: RunState) -> Result<(), String>;
}

/// Stores nothing: for short runs and for tests.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoKeeper;

impl Checkpointer for NoKeeper {
    fn work_between(&self) -> u64 {
        u64::MAX
    }

    fn load(&self) -> Option<RunState> {
        None
    }

    fn keep(&self, _state: RunState) -> Result<(), String> {
        Ok(())
    }
}

/// The state of a run between two steps. Replay buffers are not part of it: they follow from seed and step.
#[derive(Clone, Debug, PartialEq)]
pub struct RunState {
    /// The position in the run, and the errors so far.
    pub progress: RunProgress,
    /// The learners that are in the middle of their stream, by their position in the run.
    pub values: Vec<(usize, ValueState)>,
}

/// The position in a run, and the errors so far.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RunProgress {
    /// Number of populations that are finished.
    pub(crate) populations: usize,
    /// The next step of the present population.
    pub(crate) step: usize,
    /// Errors of each learner.
    pub(crate) trackers: Vec<Tracker>,
}

/// A value function in the middle of training.
#[derive(Clone, Debug, PartialEq)]
pub struct ValueState {
    /// Parameters and optimiser moments.
    pub checkpoint: Checkpoint,
    /// Parameters of the target network, if there is one.
    pub target: Option<Vec<f32>>,
    /// Eligibility traces and the related state of each weight, if there are any.
    pub traces: Option<Vec<f32>>,
    /// Updates so far. They decide when the target network is next copied.
    pub updates: usize,
}

impl From<&Checkpoint> for ValueState {
    /// Returns the state before the first update. The target network is a copy of the network.
    fn from(checkpoint: &Checkpoint) -> Self {
        Self { checkpoint: checkpoint.clone(), target: None, traces: None, updates: 0 }
    }
}
