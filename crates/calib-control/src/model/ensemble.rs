use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Coverage;
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
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Neighbors, Self::Increments, Self::Network];

    /// As studies name it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Neighbors => "neighbors",
            Self::Increments => "increments",
            Self::Network => "network",
        }
    }
}

/// Models of one log that agents act in, one for each member. A sweep treats all kinds alike.
pub trait Ensemble: Sync {
    /// A walk in one of them.
    type Walk<'a>: ModelEnvironment
    where
        Self: 'a;

    /// What they are.
    fn kind(&self) -> ActionModelKind;

    /// Number of members.
    fn members(&self) -> usize;

    /// A walk in member `member`.
    ///
    /// # Panics
    /// If there is no such member.
    fn walk(&self, member: usize) -> Self::Walk<'_>;
}

/// A member of a model as an environment, which knows what its steps rested on.
pub trait ModelEnvironment: Environment {
    /// What they rested on so far.
    fn coverage(&self) -> Coverage;

    /// How far its whole episodes were moved by jumps, or the one that is not over; nothing where steps are no jumps.
    fn drift(&self) -> Drift {
        Drift::default()
    }
}
