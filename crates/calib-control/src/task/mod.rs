//! Tasks whose truth is known: classic ones, which step as Gymnasium's do (`scripts/golden/control.py`), and a membrane plant.

mod acrobot;
mod cart_pole;
mod membrane;
mod pendulum;
mod puddle_world;
mod simulated;
#[cfg(test)]
mod tests;

use calib_core::Rng;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use acrobot::Acrobot;
pub use cart_pole::CartPole;
pub use membrane::Membrane;
pub use pendulum::Pendulum;
pub use puddle_world::PuddleWorld;
pub use simulated::{Begin, Simulated};

use crate::{AgentConfig, Outcome};

/// A fixed rule: returns the action for an observation, in the task's own units.
pub type Rule = fn(&[f64]) -> usize;

/// A simulated task: a state that actions change, and its observation.
pub trait Task: Clone + Send + Sync {
    /// Returns the name, the lowest and the highest value of each observed column. Observations may lie a little outside.
    fn columns() -> &'static [(&'static str, f64, f64)];

    /// Returns the names of the actions.
    fn actions() -> &'static [&'static str];

    /// Returns the columns of the actions in a log, and the value of each action in them.
    fn settings() -> Vec<(&'static str, Vec<f64>)> {
        vec![("action", (0..Self::actions().len()).map(|action| action as f64).collect())]
    }

    /// Returns the column of a continuous action, if there is one. [`log`](Self::log) adds the value that was really set, which is
    /// near that of the action.
    fn continuous() -> Option<&'static str> {
        None
    }

    /// Returns the columns that are logged beside the state, from which the reward is computed. Empty if the reward itself is logged.
    fn logged() -> &'static [&'static str] {
        &[]
    }

    /// Appends the logged values of the last step beside the state.
    fn log(&self, _logged: &mut Vec<f64>) {}

    /// Returns the operators' rule, if there is one.
    fn rule() -> Option<Rule> {
        None
    }

    /// Begins an episode in a start state of the task.
    fn start(&mut self, rng: &mut Rng);

    /// Begins an episode anywhere: in a state drawn from most possible ones, as in the log of a plant that saw many conditions.
    fn start_anywhere(&mut self, rng: &mut Rng);

    /// Writes the observation, in the task's own units.
    fn observe(&self, observed: &mut Vec<f64>);

    /// Takes `action`.
    fn step(&mut self, action: usize, rng: &mut Rng) -> Outcome;
}

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
