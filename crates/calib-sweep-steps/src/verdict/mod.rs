//! Verdicts on one model or several, and their report.

pub mod compare;
pub(crate) mod compare_choices;
pub(crate) mod compare_pairs;
pub(crate) mod compare_tables;
pub(crate) mod deployed;
pub mod described;
pub mod evaluate;
pub mod evaluation;
pub mod judged;
pub(crate) mod judged_model;
pub(crate) mod learned;
mod learning;
mod learning_together;
pub(crate) mod recorded_together;
pub mod report;
pub mod report_cache;
pub(crate) mod report_data;
pub(crate) mod verdict_rows;
