//! The verdict of a sweep on one sensor: the choice, and its error on held-out data.

mod differ;
mod dropped;
mod errors;
mod grade;
mod judge;
mod judging;
mod measured;
mod nearby;
mod part_choice;
mod parts;
mod rule;
mod sensor_verdict;
mod share;
mod simple;
#[cfg(test)]
mod tests;
mod truth;
mod warnings;
mod with_parts;

pub use dropped::Dropped;
pub use errors::EnvironmentScores;
pub use grade::{Grade, Recommendation};
pub use judging::{ENOUGH_WINDOWS, Judging};
pub use part_choice::PartChoice;
pub use rule::{Rule, RuleChoice};
pub use sensor_verdict::SensorVerdict;
pub use share::Share;
pub use simple::SimpleComparison;
pub use truth::{Agreement, BaselineRegret, ChoiceBaseline, Truth, WindowTruth};
pub use with_parts::verdict;
