//! Agents that act: from a log of decisions to a verdict, and logs of tasks whose truth is known.

mod described;
mod figures;
mod files;
mod inspect;
mod log;
mod page;
mod run;
mod show;
mod simulate;

pub use described::LogTold;
pub(crate) use files::ToldToMachines;
pub(crate) use inspect::inspect;
pub(crate) use run::run;
pub(crate) use simulate::simulate;
pub use simulate::{SimulateTask, SimulatedTask};
