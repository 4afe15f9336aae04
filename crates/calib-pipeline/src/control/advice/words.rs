//! Ranks, differences and intervals in the words of the advice.

use calib_base::output::number;
use calib_stats::{Difference, Interval, RankRule};

/// What the chosen setting gets beside a policy that learns nothing.
pub(super) fn more_than(other: &str, over: Option<&Difference>) -> String {
    let Some(over) = over.filter(|over| over.mean.is_finite()) else { return String::new() };
    let interval = over.interval.map_or_else(String::new, |around| {
        let is_chance = around.low < 0.0 && around.high > 0.0;
        let chance = if is_chance { ", which could be chance" } else { "" };
        format!("{}{chance}", interval_of_amounts(around))
    });
    format!(" The chosen setting gets {} than {other}{interval}.", amount(over.mean))
}

/// Returns the name of the rank that a rule uses.
pub(crate) fn rank_name(rule: RankRule) -> &'static str {
    match rule {
        RankRule::MeanRank => "mean rank",
        RankRule::WorstRank => "worst rank",
    }
}

pub(super) fn difference(difference: &Difference) -> String {
    let sign = if difference.mean >= 0.0 { "+" } else { "" };
    let interval = difference.interval.map_or_else(String::new, interval);
    format!("{sign}{} in the model, over blocks of the log{interval}", number(difference.mean))
}

pub(super) fn interval(interval: Interval) -> String {
    format!(" (95 %: {} to {})", number(interval.low), number(interval.high))
}

pub(super) fn interval_of_amounts(interval: Interval) -> String {
    let [low, high] = [interval.low, interval.high].map(amount);
    format!(" (95 % over blocks of the log: {low} to {high})")
}

/// Formats a difference, such as "2.5 more" or "2.5 less".
pub(super) fn amount(difference: f64) -> String {
    let side = if difference < 0.0 { "less" } else { "more" };
    format!("{} {side}", number(difference.abs()))
}
