//! Warns of channels whose instrument was probably frozen.

use crate::{Profile, Sketch, channel::is_same, first_few::first_few};

/// A frozen channel keeps one value for at least this share of the rows. Our choice.
const CONSTANT: f64 = 0.02;
/// It does so in at most this share of the rows: a channel that seldom changes is not frozen. Our choice.
const MOST: f64 = 0.5;
/// It does so in at least so many rows. Our choice.
const LEAST_ROWS: f64 = 60.0;
/// A frozen channel keeps its value in at most this share of the other rows: flows that stop every night are not
/// frozen. Our choice.
const UNCHANGED: f64 = 0.1;
/// Channels with fewer distinct values are switches and set-points, which keep their value once set.
const LEAST_VALUES: u32 = 16;

/// How long a channel is constant, and how often it changes otherwise.
struct Constancy<'a> {
    name: &'a str,
    /// The longest time without a change.
    longest_secs: f64,
    /// Share of successive rows without a change.
    unchanged: f64,
    /// Whether the longest constant value is 0, or the smallest or largest of the channel: it is switched off, or at a
    /// limit.
    rests: bool,
    /// Number of distinct values, if there are few.
    distinct: Option<u32>,
}

impl Constancy<'_> {
    /// Whether the channel is frozen, in a log of `rows` rows.
    fn is_frozen(&self, rows: usize, period_secs: f64) -> bool {
        let rows = rows as f64;
        // If rows are far apart, a long time without a change has few rows.
        let constant = (self.longest_secs / period_secs).min(self.unchanged * rows);
        let others = (self.unchanged * rows - constant) / (rows - constant).max(1.0);
        self.distinct.is_none_or(|distinct| distinct >= LEAST_VALUES)
            && !self.rests
            && constant >= LEAST_ROWS.max(CONSTANT * rows)
            && constant <= MOST * rows
            && others <= UNCHANGED
    }
}

impl Profile {
    /// Returns the warning for kept channels whose instrument was probably frozen; `None` if there are no such
    /// channels.
    pub fn frozen_doubt(&self) -> Option<String> {
        let moving = self.kept().filter_map(|channel| {
            channel.values.as_ref().map(|values| Constancy {
                name: &channel.name,
                longest_secs: values.longest_stuck_secs,
                unchanged: values.unchanged,
                rests: is_rest(values.stuck_at, Some([values.min, values.max])),
                distinct: values.distinct,
            })
        });
        told(moving, self.rows as usize, self.period_secs)
    }
}

impl Sketch {
    /// Returns the same warning for the channels that are sensors.
    pub fn frozen_doubt(&self, is_sensor: impl Fn(&str) -> bool) -> Option<String> {
        let sensors = self.channels.iter().filter(|channel| is_sensor(&channel.name));
        let moving = sensors.map(|channel| Constancy {
            name: &channel.name,
            longest_secs: channel.longest_stuck_secs,
            unchanged: channel.unchanged,
            rests: is_rest(channel.stuck_at, channel.range),
            distinct: channel.distinct,
        });
        told(moving, self.timestamps.len(), self.period_secs)
    }
}

/// Whether a constant value is 0, or an end of the `range` of its channel.
fn is_rest(value: Option<f64>, range: Option<[f64; 2]>) -> bool {
    let ends = range.into_iter().flatten();
    value.is_some_and(|value| ends.chain([0.0]).any(|end| is_same(value, end)))
}

fn told<'a>(
    channels: impl Iterator<Item = Constancy<'a>>,
    rows: usize,
    period_secs: f64,
) -> Option<String> {
    let frozen = channels.filter(|channel| channel.is_frozen(rows, period_secs));
    let frozen: Vec<String> = frozen
        .map(|channel| format!("{} for {}", channel.name, long(channel.longest_secs)))
        .collect();
    let frozen = first_few(&frozen)?;
    Some(format!(
        "channels that change in nearly every row are constant for long: {frozen}. If their instruments were frozen, leave the channels out with \
         data.exclude, or these times with data.train and data.held_out"
    ))
}

/// Formats a long time in words.
fn long(secs: f64) -> String {
    let units = [(86_400.0, "d"), (3_600.0, "h"), (60.0, "min")];
    let (size, unit) = units.into_iter().find(|(size, _)| secs >= 2.0 * size).unwrap_or((1.0, "s"));
    format!("{:.0} {unit}", secs / size)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whether a channel is frozen that is constant for `constant` of 1000 rows and unchanged in `unchanged` rows.
    fn is_frozen(constant: f64, unchanged: f64, distinct: Option<u32>) -> bool {
        let longest_secs = 60.0 * constant;
        let unchanged = unchanged / 1_000.0;
        Constancy { name: "A", longest_secs, unchanged, rests: false, distinct }
            .is_frozen(1_000, 60.0)
    }

    #[test]
    fn only_what_moves_otherwise_is_frozen() {
        assert!(is_frozen(300.0, 305.0, None));
        assert!(!is_frozen(15.0, 20.0, None), "not for long");
        assert!(!is_frozen(300.0, 305.0, Some(2)), "a switch");
        assert!(!is_frozen(1_000.0, 1_000.0, Some(1)), "a constant");
        assert!(!is_frozen(110.0, 330.0, None), "at night, three times");
        assert!(!is_frozen(100.0, 1.0, None), "one step of many periods");
        assert!(!is_frozen(50.0, 55.0, None), "few rows");
        assert!(!is_frozen(900.0, 923.0, None), "it seldom changes");
    }

    #[test]
    fn channels_that_rest_are_not_frozen() {
        for rest in [0.0, -3.0, 8.0] {
            assert!(is_rest(Some(rest), Some([-3.0, 8.0])), "{rest}");
        }
        assert!(!is_rest(Some(1.5), Some([-3.0, 8.0])));
        assert!(!is_rest(None, None));
        let off = Constancy {
            name: "A",
            longest_secs: 18_000.0,
            unchanged: 0.305,
            rests: true,
            distinct: None,
        };
        assert!(!off.is_frozen(1_000, 60.0));
    }

    #[test]
    fn times_are_whole_units() {
        assert_eq!([long(1_200_000.0), long(10_000.0), long(500.0)], ["14 d", "3 h", "8 min"]);
    }
}
