use serde::{Deserialize, Serialize};

use crate::{Checkpoint, outcome::Tracker};

/// Keeps the state of a long run, so that a killed one goes on from where it was last kept.
///
/// The result of a run does not depend on whether, where and how often it was resumed.
pub trait Checkpointer {
    /// Work between two states that are kept, in multiplications (see [`train_learners`](crate::train_learners)).
    fn work_between(&self) -> u64;

    /// The state that was kept last, if there is one of this very run.
    fn load(&self) -> Option<RunState>;

    /// Keep this state instead of the one before.
    ///
    /// # Errors
    /// Why it cannot be kept, for the user.
    fn keep(&self, state: RunState) -> Result<(), String>;
}

/// Keeps nothing: for short runs, and for tests.
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

/// A run between two steps. Replay buffers need no place in it: they follow from seed and step.
#[derive(Clone, Debug, PartialEq)]
pub struct RunState {
    /// Where the run stands, and the errors so far.
    pub progress: RunProgress,
    /// The learners that are in the middle of their stream, by their position in the run.
    pub values: Vec<(usize, ValueState)>,
}

/// Where a run stands, and the errors so far.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RunProgress {
    /// Populations that are finished.
    pub(crate) populations: usize,
    /// The next step of the present population.
    pub(crate) step: usize,
    /// Errors of each learner.
    pub(crate) trackers: Vec<Tracker>,
}

/// A value function in the middle of training.
#[derive(Clone, Debug, PartialEq)]
pub struct ValueState {
    /// Parameters and moments.
    pub checkpoint: Checkpoint,
    /// Parameters of the target network, where there is one.
    pub target: Option<Vec<f32>>,
    /// Eligibility traces and what goes with them, where there are any.
    pub traces: Option<Vec<f32>>,
    /// Updates so far; they decide when the target network is due for a copy.
    pub updates: usize,
}

impl From<&Checkpoint> for ValueState {
    /// Before the first update; the target network is the network itself.
    fn from(checkpoint: &Checkpoint) -> Self {
        Self { checkpoint: checkpoint.clone(), target: None, traces: None, updates: 0 }
    }
}
