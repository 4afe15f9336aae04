//! Agents that act: from a log of decisions to a verdict, and logs of classic tasks.

mod files;
mod log;
mod run;
mod show;
mod simulate;

pub(crate) use files::ToldToMachines;
pub(crate) use run::run;
pub(crate) use simulate::simulate;
pub use simulate::{SimulateTask, SimulatedTask};
