//! Agents that act: logs of decisions, models with actions, control agents, sweeps and verdicts of returns.
//!
//! - [`Environment`], [`Outcome`]: what an agent acts in; a simulator and a model look the same to it.
//! - [`Task`], [`Acrobot`], [`CartPole`], [`Pendulum`], [`PuddleWorld`]: tasks with known answers.

mod environment;
mod task;

pub use environment::{Ending, Environment, Outcome};
pub use task::{Acrobot, Begin, CartPole, Pendulum, PuddleWorld, Simulated, Task, TaskKind};
