//! Prints results: lines and tables for people, or JSON.

mod agents;
mod sweeps;
mod verdicts;

pub use verdicts::show_judgement;
