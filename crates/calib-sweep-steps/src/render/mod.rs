//! Results as whoever asked for them reads them: lines and tables, or JSON.

mod agents;
mod sweeps;
mod verdicts;

pub use verdicts::show_judgement;
