//! Verdicts, of one model and of several, and the report that shows them.

pub(crate) mod compare;
pub(crate) mod compare_choices;
pub(crate) mod compare_pairs;
pub(crate) mod compare_tables;
pub(crate) mod deployed;
pub(crate) mod described;
pub(crate) mod evaluate;
pub(crate) mod evaluation;
pub(crate) mod kept_report;
pub(crate) mod learned;
mod learning;
pub(crate) mod recorded_together;
pub(crate) mod report;
pub(crate) mod report_data;
pub(crate) mod verdict_rows;
