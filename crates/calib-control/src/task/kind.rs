use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::AgentConfig;

/// The simulated tasks, by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum TaskKind {
    /// Swing a two-link pendulum up: reward −1 per step until it is above the bar.
    Acrobot,
    /// Balance a pole on a cart: reward 1 per step until it falls.
    CartPole,
    /// Operate a membrane plant: choose one of eight recipes every half hour.
    Membrane,
    /// Swing a pendulum up and hold it there, with five torques.
    Pendulum,
    /// Cross a unit square with two puddles: reward −1 per step, and up to −40 more in a puddle.
    PuddleWorld,
}

impl TaskKind {
    /// All tasks.
    pub const ALL: [Self; 5] =
        [Self::Acrobot, Self::CartPole, Self::Membrane, Self::Pendulum, Self::PuddleWorld];

    /// Returns the name in studies and on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Acrobot => "acrobot",
            Self::CartPole => "cart_pole",
            Self::Membrane => "membrane",
            Self::Pendulum => "pendulum",
            Self::PuddleWorld => "puddle_world",
        }
    }

    /// Returns a return for the worst outcome, for models that do not know what follows.
    ///
    /// For Cart-pole it is an immediate fall, and for the plant an immediate trip. For Acrobot it is an episode to its timeout. For the
    /// others it is about the return of random actions.
    pub const fn worst_return(self) -> f64 {
        match self {
            Self::Acrobot => -500.0,
            Self::CartPole => 0.0,
            Self::Membrane => -200.0,
            Self::Pendulum => -1500.0,
            Self::PuddleWorld => -2500.0,
        }
    }

    /// Returns an agent that learns the task well. For Acrobot, Cart-pole and Puddle world it is the best of the published grid by
    /// its true return.
    pub fn good_agent(self) -> AgentConfig {
        match self {
            Self::Acrobot => agent_with(0.03, 0.9, 0.0),
            Self::CartPole => agent_with(0.3, 0.0, 8.0),
            Self::Membrane => AgentConfig { gamma: 0.99, tilings: 8, ..agent_with(0.3, 0.0, 0.0) },
            Self::Pendulum | Self::PuddleWorld => agent_with(0.3, 0.9, 0.0),
        }
    }

    /// Returns whether episodes can end in a terminal.
    pub const fn ends(self) -> bool {
        !matches!(self, Self::Pendulum)
    }

    /// Returns the steps after which an episode is cut.
    pub const fn timeout(self) -> usize {
        match self {
            Self::Acrobot | Self::CartPole | Self::PuddleWorld => 500,
            // Ten days of half hours.
            Self::Membrane => 480,
            Self::Pendulum => 200,
        }
    }

    /// Returns the mean return of ten episodes at which a learned policy counts as near-optimal.
    pub const fn near_optimal(self) -> f64 {
        match self {
            Self::Acrobot => -100.0,
            Self::CartPole => 300.0,
            Self::Membrane => 2000.0,
            Self::Pendulum => -300.0,
            Self::PuddleWorld => -45.0,
        }
    }
}

/// Returns the default agent with these hyperparameters, at a temperature of 1.
fn agent_with(step_size: f64, beta1: f64, initial_weight: f64) -> AgentConfig {
    AgentConfig { step_size, beta1, temperature: 1.0, initial_weight, ..AgentConfig::default() }
}
