//! Merges samples of one channel at the same instant.

use calib_core::Timestamp;
use calib_text::format_time;

use crate::{
    AngleOf, Contradictions,
    channel::is_same,
    text::{Cell, Switch, Words},
};

/// Number of contradictions of a log that are shown.
pub(crate) const SHOWN: usize = 3;

/// Two values of a channel at one time.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Contradiction {
    pub(crate) time: i64,
    pub(crate) values: [f64; 2],
}

impl Contradiction {
    pub(crate) fn told(&self, channel: &str) -> String {
        let at = format_time(Timestamp::from_micros(self.time));
        format!("at {at} {channel} is {} and {}", self.values[0], self.values[1])
    }
}

/// Whether two values of a channel are equal up to rounding. Two angles are equal if they are the same direction.
pub(crate) fn agree(one: f64, other: f64, angle: Option<&AngleOf>) -> bool {
    is_same(one, other) || angle.is_some_and(|angle| angle.is_same(one, other))
}

/// Values that contradict another one at the same time.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Contradicting {
    pub(crate) count: u64,
    pub(crate) first: Vec<Contradiction>,
}

impl Contradicting {
    pub(crate) fn add(&mut self, time: i64, values: [f64; 2]) {
        self.count += 1;
        if self.first.len() < SHOWN {
            self.first.push(Contradiction { time, values });
        }
    }

    /// The words of those that are shown, whose values are positions in `words`.
    pub(super) fn replaced<'a>(&'a self, words: &'a Words) -> impl Iterator<Item = &'a str> {
        let values = self.first.iter().flat_map(|contradiction| contradiction.values);
        values.map(move |word| words.word(word as u32))
    }

    /// The same with the values that `switch` reads the words as.
    pub(super) fn of_switch(&self, switch: &Switch, words: &Words) -> Self {
        let first = self.first.iter().map(|contradiction| Contradiction {
            time: contradiction.time,
            values: contradiction
                .values
                .map(|word| switch.value(words.word(word as u32)).unwrap_or(f64::NAN)),
        });
        Self { count: self.count, first: first.collect() }
    }
}

/// Samples with distinct times.
#[derive(Debug, Default, PartialEq)]
pub(crate) struct Deduplicated {
    pub(crate) times: Vec<i64>,
    pub(crate) cells: Vec<u64>,
    /// Number of samples that repeat another one.
    pub(crate) repeated: u64,
    /// Numbers that differ from another number at their time.
    pub(crate) contradictions: Contradicting,
    /// Words that differ from another word at their time, by their positions. They count if the channel is read
    /// as words.
    pub(crate) words: Contradicting,
}

/// Merges samples with equal times, which are in order of time. A sample with a value is preferred. Among several
/// values, `keep` selects the first or the last. `angle` is set if the samples are of an angle.
pub(crate) fn deduplicate(
    times: &[i64],
    cells: &[u64],
    angle: Option<&AngleOf>,
    keep: Contradictions,
) -> Deduplicated {
    let mut placed = Deduplicated::default();
    for (&time, &cell) in times.iter().zip(cells) {
        let (Some(&last), Some(kept)) = (placed.times.last(), placed.cells.last_mut()) else {
            placed.times.push(time);
            placed.cells.push(cell);
            continue;
        };
        if last != time {
            placed.times.push(time);
            placed.cells.push(cell);
            continue;
        }
        match (Cell::decode(*kept), Cell::decode(cell)) {
            (_, Cell::Missing) => placed.repeated += 1,
            (before, now) if before == now => placed.repeated += 1,
            (Cell::Number(before), Cell::Number(now)) if agree(before, now, angle) => {
                placed.repeated += 1;
            }
            (Cell::Number(before), Cell::Number(now)) => {
                placed.contradictions.add(time, [before, now]);
                if keep == Contradictions::Last {
                    *kept = cell;
                }
            }
            (Cell::Word(before), Cell::Word(now)) => {
                placed.words.add(time, [before, now].map(f64::from));
                if keep == Contradictions::Last {
                    *kept = cell;
                }
            }
            // A number is preferred to a word, and a word to NaN.
            (Cell::Number(_), _) | (Cell::Word(_), Cell::NonFinite) => placed.repeated += 1,
            _ => *kept = cell,
        }
    }
    placed
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cells(values: &[f64]) -> Vec<u64> {
        let cells = values.iter().map(|&value| {
            let cell = if value.is_nan() { Cell::Missing } else { Cell::Number(value) };
            cell.encode()
        });
        cells.collect()
    }

    #[test]
    fn each_instant_comes_once_and_contradictions_are_told() {
        let nan = f64::NAN;
        let times = [1, 1, 2, 2, 3, 3, 3];
        let values = cells(&[nan, 5.0, 6.0, 6.0, 7.0, nan, 8.0]);
        let placed = deduplicate(&times, &values, None, Contradictions::Refuse);
        assert_eq!((placed.times, placed.cells), (vec![1, 2, 3], cells(&[5.0, 6.0, 7.0])));
        assert_eq!((placed.repeated, placed.contradictions.count), (2, 1));
        assert_eq!(placed.contradictions.first, [Contradiction { time: 3, values: [7.0, 8.0] }]);
        let last = deduplicate(&times, &values, None, Contradictions::Last);
        assert_eq!(last.cells, cells(&[5.0, 6.0, 8.0]));
    }

    #[test]
    fn of_two_words_the_first_or_the_last_is_kept() {
        let words = [3, 3, 4].map(|word| Cell::Word(word).encode());
        let [first, last] = [Contradictions::First, Contradictions::Last]
            .map(|keep| deduplicate(&[7, 7, 7], &words, None, keep));
        assert_eq!((first.cells, first.repeated), (vec![words[0]], 1));
        assert_eq!((first.contradictions.count, first.words.count), (0, 1));
        assert_eq!(first.words.first, [Contradiction { time: 7, values: [3.0, 4.0] }]);
        assert_eq!(last.cells, [words[2]]);
        let then_nan = [words[0], Cell::NonFinite.encode()];
        assert_eq!(deduplicate(&[7, 7], &then_nan, None, Contradictions::Refuse).cells, [words[0]]);
    }
}
