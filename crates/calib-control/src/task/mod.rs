//! Tasks whose truth is known: classic ones, which step as Gymnasium's do (`scripts/golden/control.py`), and a membrane plant.

mod acrobot;
mod cart_pole;
mod interface;
mod kind;
mod membrane;
mod pendulum;
mod puddle_world;
mod simulated;
#[cfg(test)]
mod tests;

pub use acrobot::Acrobot;
pub use cart_pole::CartPole;
pub use interface::{Rule, Task};
pub use kind::TaskKind;
pub use membrane::Membrane;
pub use pendulum::Pendulum;
pub use puddle_world::PuddleWorld;
pub use simulated::{Begin, Simulated};
