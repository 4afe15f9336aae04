use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{At, Coverage};
use crate::{Drift, Environment};

/// A kind of model of a log that agents act in.
#[derive(
    Clone,
    Copy,
    Debug,
    Default,
    PartialEq,
    Eq,
    PartialOrd,
    Ord,
    Hash,
    Serialize,
    Deserialize,
    JsonSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum ActionModelKind {
    /// The recorded next state of a neighbour: steps never leave the recorded rows.
    #[default]
    Neighbors,
    /// The recorded change of a neighbour is added to the state, in columns where that predicts better.
    Increments,
    /// A network that predicts the next state.
    Network,
}

impl ActionModelKind {
    /// All kinds.
    pub const ALL: [Self; 3] = [Self::Neighbors, Self::Increments, Self::Network];

    /// Returns the name in studies.
    pub fn name(self) -> &'static str {
        match self {
            Self::Neighbors => "neighbors",
            Self::Increments => "increments",
            Self::Network => "network",
        }
    }
}

/// Models of one log in which agents act, one per ensemble member. A sweep treats all kinds alike.
pub trait Ensemble: Sync {
    /// A rollout in one of the models.
    type Rollout<'a>: ModelEnvironment
    where
        Self: 'a;

    /// Returns the kind of model.
    fn kind(&self) -> ActionModelKind;

    /// Returns the number of ensemble members.
    fn members(&self) -> usize;

    /// Returns a rollout in ensemble member `member`.
    ///
    /// # Panics
    /// If there is no such member.
    fn rollout(&self, member: usize) -> Self::Rollout<'_>;
}

/// An ensemble member of a model as an environment, which records the coverage of its steps.
pub trait ModelEnvironment: Environment {
    /// Returns the coverage of the steps so far.
    fn coverage(&self) -> Coverage;

    /// Returns how far jumps moved its finished episodes, or the unfinished one if no episode is finished. Empty if
    /// steps are not jumps.
    fn drift(&self) -> Drift {
        Drift::default()
    }

    /// Returns the recorded place of the present state; `None` if the model makes states that were not recorded.
    fn place(&self) -> Option<At> {
        None
    }
}
