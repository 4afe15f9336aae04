//! What a step in a model is given and returns.

use calib_core::TransitionIndex;
use serde::{Deserialize, Serialize};

use super::Pessimism;
use crate::Ending;

/// The rules for steps that the log does not cover.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rules {
    /// Whether the rollout continues with the nearest transition.
    pub pessimism: Pessimism,
    /// The return with which an episode ends if it does not continue.
    pub worst_return: f64,
}

/// The place of a rollout.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum At {
    /// In the start state with this number.
    Start(u32),
    /// In the next state of the transition with this number.
    After(u32),
}

/// The action of a step.
#[derive(Clone, Copy, Debug)]
pub enum Target<'a> {
    /// The action with this number, whose neighbours are in the tables.
    Level(usize),
    /// These settings, each as a share of its recorded range. Their neighbours are searched during the step. Only for continuous actions.
    Set(&'a [f32]),
}

/// Whether the log covers a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Covered {
    /// A transition with the action is within the radius.
    Near,
    /// The nearest transition with the action is beyond the radius.
    Far,
    /// The ensemble member has no transition with the action.
    Missing,
}

/// The result of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// The transition that was drawn; `None` if the episode ends because the log does not cover the step.
    pub drawn: Option<TransitionIndex>,
    /// The reward.
    pub reward: f64,
    /// Whether the episode ends here.
    pub ending: Ending,
    /// Whether the log covers the step.
    pub covered: Covered,
    /// Distance in the model's metric from the state to the source of the drawn transition, or of the nearest one if none was drawn; `+∞`
    /// if there is no transition.
    pub distance: f32,
}
