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

/// A fixed rule: the action in what is observed, in the task's own units.
pub type Rule = fn(&[f64]) -> usize;

/// A simulated task: a state that actions change, and what is observed of it.
pub trait Task: Clone + Send + Sync {
    /// Name, lowest and highest value of each observed column; what is observed may lie a little outside.
    fn columns() -> &'static [(&'static str, f64, f64)];

    /// What the actions are called.
    fn actions() -> &'static [&'static str];

    /// How a log has the actions: its columns, and the value of each action in them.
    fn settings() -> Vec<(&'static str, Vec<f64>)> {
        vec![("action", (0..Self::actions().len()).map(|action| action as f64).collect())]
    }

    /// The column of a setting that is continuous, which [`log`](Self::log) adds: what was really set, the action being about that.
    fn continuous() -> Option<&'static str> {
        None
    }

    /// Columns of what is logged beside the state, which the reward is made of; none where the reward itself is logged.
    fn logged() -> &'static [&'static str] {
        &[]
    }

    /// Add what is logged of the last step beside the state.
    fn log(&self, _logged: &mut Vec<f64>) {}

    /// What those who operate it do, where there is such a rule.
    fn rule() -> Option<Rule> {
        None
    }

    /// Begin as the task does.
    fn start(&mut self, rng: &mut Rng);

    /// Begin anywhere: a state drawn from most of what can be, as of a plant that logs see in many conditions.
    fn start_anywhere(&mut self, rng: &mut Rng);

    /// What is observed, in the task's own units.
    fn observe(&self, observed: &mut Vec<f64>);

    /// Take `action`.
    fn step(&mut self, action: usize, rng: &mut Rng) -> Outcome;
}

/// The tasks by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum TaskKind {
    /// Swing a two-link pendulum up: −1 a step until it is above the bar.
    Acrobot,
    /// Balance a pole on a cart: 1 a step until it falls.
    CartPole,
    /// Operate a membrane plant: which of eight recipes, every half hour.
    Membrane,
    /// Swing a pendulum up and hold it there, with five torques.
    Pendulum,
    /// Cross a unit square with two puddles: −1 a step, and up to −40 more in a puddle.
    PuddleWorld,
}

impl TaskKind {
    /// All of them.
    pub const ALL: [Self; 5] =
        [Self::Acrobot, Self::CartPole, Self::Membrane, Self::Pendulum, Self::PuddleWorld];

    /// The name in studies and on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Acrobot => "acrobot",
            Self::CartPole => "cart_pole",
            Self::Membrane => "membrane",
            Self::Pendulum => "pendulum",
            Self::PuddleWorld => "puddle_world",
        }
    }

    /// The return that stands for the worst that can follow, for models that do not know what does.
    ///
    /// The pole falls at once; the plant trips at once; of Acrobot, an episode to its timeout; of the others, about what random actions get.
    pub const fn worst_return(self) -> f64 {
        match self {
            Self::Acrobot => -500.0,
            Self::CartPole => 0.0,
            Self::Membrane => -200.0,
            Self::Pendulum => -1500.0,
            Self::PuddleWorld => -2500.0,
        }
    }

    /// An agent that learns the task well: for Acrobot, Cart-pole and Puddle world the best of the published grid by its true return.
    pub fn good_agent(self) -> AgentConfig {
        match self {
            Self::Acrobot => agent_with(0.03, 0.9, 0.0),
            Self::CartPole => agent_with(0.3, 0.0, 8.0),
            Self::Membrane => AgentConfig { gamma: 0.99, tilings: 8, ..agent_with(0.3, 0.0, 0.0) },
            Self::Pendulum | Self::PuddleWorld => agent_with(0.3, 0.9, 0.0),
        }
    }

    /// Whether episodes can end in a terminal.
    pub const fn ends(self) -> bool {
        !matches!(self, Self::Pendulum)
    }

    /// Steps after which an episode is cut.
    pub const fn timeout(self) -> usize {
        match self {
            Self::Acrobot | Self::CartPole | Self::PuddleWorld => 500,
            // Ten days of half hours.
            Self::Membrane => 480,
            Self::Pendulum => 200,
        }
    }

    /// The mean return of ten episodes at which what was learnt counts as near-optimal.
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

/// The default agent with these hyperparameters, at a temperature of 1.
fn agent_with(step_size: f64, beta1: f64, initial_weight: f64) -> AgentConfig {
    AgentConfig { step_size, beta1, temperature: 1.0, initial_weight, ..AgentConfig::default() }
}
