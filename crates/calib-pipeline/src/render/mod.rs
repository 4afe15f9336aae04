//! Results as whoever asked for them reads them: lines and tables, or JSON.

mod agents;
mod models;
mod representations;
mod rollouts;
mod sweeps;
mod verdicts;

pub(crate) use verdicts::show_judgement;
