//! Whether words beside numbers name what was measured, or are states of a plant.

use std::collections::{BTreeMap, BTreeSet};

use super::head::Head;
use crate::{
    DataError,
    text::{Decimal, Switch, parse_number},
};

/// Words name tags if the numbers beside each vary by this share of all variance at most: a state, such as the weather, tells less. Our choice.
const OWN_VARIANCE: f64 = 0.1;

/// How the words of a column follow each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Course {
    /// There is one, or none.
    Constant,
    /// They are a pair such as ON and OFF, or one of its words: no tags are called so.
    Switches,
    /// Few words that change from row to row, as tags do.
    Alternates,
    /// They stay for many rows, or are too many to tell.
    Stays,
}

impl Course {
    pub(super) fn of(sample: &[String]) -> Self {
        let distinct: BTreeSet<&str> = sample.iter().map(String::as_str).collect();
        let changes = sample.windows(2).filter(|pair| pair[0] != pair[1]).count();
        if Switch::of(distinct.iter().copied()).is_some() {
            Self::Switches
        } else if distinct.len() < 2 {
            Self::Constant
        } else if changes * 2 > sample.len() && distinct.len() * 2 < sample.len() {
            Self::Alternates
        } else {
            Self::Stays
        }
    }
}

/// Whether the first rows of a file look like samples of several tags: times repeat, or the numbers in column `value` lie elsewhere beside each
/// of the `words`.
pub(super) fn have_levels_of_their_own(
    head: &Head,
    time: usize,
    words: usize,
    value: usize,
) -> Result<bool, DataError> {
    let times = head.sample(time)?;
    let distinct: BTreeSet<&str> = times.iter().map(String::as_str).collect();
    Ok(distinct.len() < times.len() || differ(&head.pairs(words, value)?))
}

/// Whether numbers differ clearly between the words beside them.
fn differ(pairs: &[[String; 2]]) -> bool {
    let [points, commas] = [Decimal::Point, Decimal::Comma].map(|sign| numbers(pairs, sign));
    let numbers = if commas.len() > points.len() { commas } else { points };
    let mut by_word: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
    for &(word, number) in &numbers {
        by_word.entry(word).or_default().push(number);
    }
    let all: Vec<f64> = numbers.iter().map(|(_, number)| *number).collect();
    let within: f64 = by_word.values().map(|values| squares(values)).sum();
    within < OWN_VARIANCE * squares(&all)
}

/// The words whose second cell is a number with this sign, with it.
fn numbers(pairs: &[[String; 2]], decimal: Decimal) -> Vec<(&str, f64)> {
    let numbers = pairs.iter();
    numbers.filter_map(|[word, cell]| Some((word.as_str(), parse_number(cell, decimal)?))).collect()
}

/// The sum of the squared distances of numbers from their mean; 0 without any.
fn squares(values: &[f64]) -> f64 {
    let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
    values.iter().map(|value| (value - mean).powi(2)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pairs(number: impl Fn(usize) -> String) -> Vec<[String; 2]> {
        let rows = (0..90).map(|row| [["flow", "level", "rain"][row % 3].to_owned(), number(row)]);
        rows.collect()
    }

    #[test]
    fn numbers_of_tags_lie_elsewhere_and_those_of_states_do_not() {
        assert!(differ(&pairs(|row| format!("{},{:02}", row % 3, row % 30))));
        // The weather explains two thirds of the variance.
        assert!(!differ(&pairs(|row| (10 * (row % 3) + row % 20).to_string())));
        assert!(!differ(&pairs(|row| row.to_string())));
        assert!(!differ(&pairs(|_| "7".to_owned())));
        assert!(!differ(&[]));
    }

    fn course(words: &[&str]) -> Course {
        let sample = (0..30).map(|row: usize| words[row % words.len()].to_owned());
        Course::of(&sample.collect::<Vec<String>>())
    }

    #[test]
    fn words_of_a_switch_and_words_that_stay_are_no_tags() {
        assert_eq!(course(&["ON", "OFF"]), Course::Switches);
        assert_eq!(course(&["EIN"]), Course::Switches);
        assert_eq!(course(&["plant 1"]), Course::Constant);
        assert_eq!(course(&["FT1", "LT2"]), Course::Alternates);
        assert_eq!(course(&["a", "a", "a", "b"]), Course::Stays);
    }
}
