//! Finds a time at which a channel probably changed its unit.
//!
//! The values before and after this time do not overlap, and nothing lies between them. The values after it are those
//! before it in another unit. Either level, spread and steps from row to row grew or shrank by about the same factor,
//! of three or more. Or degrees Celsius, Fahrenheit and kelvins replace each other. A set point, a season or a pump
//! does not change all three by the same factor. (The numbers are our choices: with them, no channel of the recorded
//! plant logs that we have is reported.)

use calib_core::{Timestamp, number};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::channel::quantile;

/// Minimum number of rows on either side, which must also have a twentieth of all rows.
const LEAST_ROWS: usize = 200;
/// Number of blocks whose medians are compared, so that a few bad samples hide nothing.
const BLOCKS: usize = 200;
/// Maximum share of the values on the wrong side.
const MISPLACED: f64 = 0.01;
/// Number of rows on each side of the change that are searched for a gradual transition: this many, or as many as a
/// block has.
const NEAR_ROWS: usize = 20;
/// Maximum number of these rows between both ranges. A plant that starts up, or a vessel that empties, passes through.
const PASSING: usize = 3;
/// A factor closer to 1 may be a set point.
const LEAST_FACTOR: f64 = 3.0;
/// Maximum ratio between the factors of level, spread and steps from row to row: a plant does not behave the same all
/// the time.
const ALIKE: f64 = 2.0;
/// Maximum ratio for the spread in degrees, whose factor is known.
const ALIKE_DEGREES: f64 = 1.5;
/// Maximum deviation of a level in degrees from its conversion, as a share of its change.
const NEAR_DEGREES: f64 = 0.15;
/// Number of values that are examined; more values are evenly thinned.
const LOOKED_AT: usize = 200_000;

/// The conversion of values from one unit to another.
struct Conversion {
    factor: f64,
    offset: f64,
}

/// From degrees Celsius to Fahrenheit and back, and to kelvins and back.
const DEGREES: [Conversion; 4] = [
    Conversion { factor: 1.8, offset: 32.0 },
    Conversion { factor: 1.0 / 1.8, offset: -32.0 / 1.8 },
    Conversion { factor: 1.0, offset: 273.15 },
    Conversion { factor: 1.0, offset: -273.15 },
];

/// A time at which the unit of a channel probably changed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct UnitChange {
    /// The time of the first value after it.
    pub at: Timestamp,
    /// The smallest and the largest value before it, without a twentieth of the values at each end.
    pub before: [f64; 2],
    /// The smallest and the largest value after it, without a twentieth of the values at each end.
    pub after: [f64; 2],
}

impl UnitChange {
    /// Searches these values, where NaN means missing, with their times.
    pub(crate) fn find(values: &[f64], timestamps: &[Timestamp]) -> Option<Self> {
        let step = values.len() / LOOKED_AT + 1;
        let looked_at = values.iter().copied().enumerate().step_by(step);
        let (rows, there): (Vec<usize>, Vec<f64>) =
            looked_at.filter(|(_, value)| !value.is_nan()).unzip();
        let least = LEAST_ROWS.max(there.len() / 20);
        if there.len() < 2 * least {
            return None;
        }
        let size = (there.len() / BLOCKS).max(5);
        let medians: Vec<f64> =
            there.chunks_exact(size).map(|block| quantile(&mut block.to_vec(), 0.5)).collect();
        let gap = Gap::of(&medians)?;
        let row = gap.row(&there, size);
        if row < least || there.len() - row < least || gap.misplaced(&there, row) > MISPLACED {
            return None;
        }
        let before = Level::of(&there[..row]);
        let after = Level::of(&there[row..]);
        let reach = NEAR_ROWS.max(there.len() / BLOCKS);
        let near = &there[row.saturating_sub(reach)..(row + reach).min(there.len())];
        (after.is_abrupt(&before, near) && after.is_converted(&before)).then(|| Self {
            at: timestamps[rows[row]],
            before: [before.low, before.high],
            after: [after.low, after.high],
        })
    }

    /// What is said of it, without the name of its channel. Its time is `shown`.
    pub(crate) fn told(&self, shown: &str) -> String {
        let [before, after] = [self.before, self.after]
            .map(|[low, high]| format!("{} to {}", number(low), number(high)));
        format!(
            "two ranges that do not overlap, mostly {before} before {shown} and {after} from then on; did its unit or its zero change? Let data.train and \
             data.held_out begin after that time, correct the values, or leave the channel out with data.exclude"
        )
    }
}

/// A position at which the medians of the blocks before and after do not overlap.
#[derive(Clone, Copy)]
struct Gap {
    /// The first block after the gap.
    block: usize,
    /// The largest median on the lower side.
    low: f64,
    /// The smallest median on the upper side.
    high: f64,
    /// Whether the upper side comes later.
    rises: bool,
}

impl Gap {
    /// Returns the widest gap; `None` if medians overlap at every division.
    fn of(medians: &[f64]) -> Option<Self> {
        let mut later = Vec::with_capacity(medians.len());
        let mut ends = [f64::INFINITY, f64::NEG_INFINITY];
        for median in medians.iter().rev() {
            ends = [ends[0].min(*median), ends[1].max(*median)];
            later.push(ends);
        }
        later.reverse();
        let mut before = [f64::INFINITY, f64::NEG_INFINITY];
        let mut widest: Option<Self> = None;
        for (block, after) in later.iter().enumerate().skip(1) {
            let last = medians[block - 1];
            before = [before[0].min(last), before[1].max(last)];
            let gap = if after[0] > before[1] {
                Self { block, low: before[1], high: after[0], rises: true }
            } else {
                Self { block, low: after[1], high: before[0], rises: false }
            };
            if gap.width() > 0.0 && widest.is_none_or(|widest| gap.width() > widest.width()) {
                widest = Some(gap);
            }
        }
        widest
    }

    fn width(&self) -> f64 {
        self.high - self.low
    }

    /// Whether a value is on the side that comes later.
    fn is_later(&self, value: f64) -> bool {
        (value > f64::midpoint(self.low, self.high)) == self.rises
    }

    /// Returns the first row after the gap, with the fewest values on the wrong side near it. Blocks have `size` rows.
    fn row(&self, values: &[f64], size: usize) -> usize {
        let near = (self.block - 1) * size..((self.block + 1) * size).min(values.len());
        // If the division is before the first of these rows, all rows that belong before it are misplaced.
        let early = values[near.clone()].iter().filter(|value| !self.is_later(**value)).count();
        let mut misplaced = early as i64;
        let mut fewest = misplaced;
        let mut best = near.start;
        for row in near {
            misplaced += if self.is_later(values[row]) { 1 } else { -1 };
            if misplaced < fewest {
                fewest = misplaced;
                best = row + 1;
            }
        }
        best
    }

    /// Returns the share of the values on the wrong side of a division before `row`.
    fn misplaced(&self, values: &[f64], row: usize) -> f64 {
        let early = values[..row].iter().filter(|value| self.is_later(**value)).count();
        let late = values[row..].iter().filter(|value| !self.is_later(**value)).count();
        (early + late) as f64 / values.len() as f64
    }
}

/// The distribution of values.
struct Level {
    /// The 5 % quantile.
    low: f64,
    /// The median.
    middle: f64,
    /// The 95 % quantile.
    high: f64,
    /// The 90 % quantile of the changes from row to row that are not 0; 0 if the value never changes.
    step: f64,
}

impl Level {
    fn of(values: &[f64]) -> Self {
        let changes = values.windows(2).map(|pair| (pair[1] - pair[0]).abs());
        let mut changes: Vec<f64> = changes.filter(|change| *change > 0.0).collect();
        let step = if changes.is_empty() { 0.0 } else { quantile(&mut changes, 0.9) };
        let mut values = values.to_vec();
        Self {
            step,
            low: quantile(&mut values, 0.05),
            middle: quantile(&mut values, 0.5),
            high: quantile(&mut values, 0.95),
        }
    }

    fn width(&self) -> f64 {
        self.high - self.low
    }

    /// Whether hardly any value `near` the time of the change lies between this level and the one before.
    fn is_abrupt(&self, before: &Self, near: &[f64]) -> bool {
        let (low, high) = if self.middle > before.middle {
            (before.high, self.low)
        } else {
            (self.high, before.low)
        };
        let quarter = (high - low) / 4.0;
        let passing = low + quarter..high - quarter;
        near.iter().filter(|value| passing.contains(*value)).count() <= PASSING
    }

    /// Whether this is the level `before` in another unit.
    fn is_converted(&self, before: &Self) -> bool {
        if self.width() <= 0.0 || before.width() <= 0.0 || self.step <= 0.0 || before.step <= 0.0 {
            return false;
        }
        let spread = self.width() / before.width();
        let step = self.step / before.step;
        let level = self.middle / before.middle;
        let is_scaled = level.is_finite()
            && level > 0.0
            && !are_within(level, 1.0, LEAST_FACTOR)
            && are_within(spread, level, ALIKE)
            && are_within(step, level, ALIKE);
        let change = self.middle - before.middle;
        is_scaled
            || DEGREES.iter().any(|Conversion { factor, offset }| {
                let expected = factor * before.middle + offset - before.middle;
                (change - expected).abs() <= NEAR_DEGREES * expected.abs()
                    && are_within(spread, *factor, ALIKE_DEGREES)
                    && are_within(step, *factor, ALIKE)
            })
    }
}

/// Whether the quotient of two positive numbers is between `1 / factor` and `factor`.
fn are_within(one: f64, other: f64, factor: f64) -> bool {
    (one / other).ln().abs() <= factor.ln()
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROWS: usize = 4_000;

    /// Returns a level between 1 and 3 that never repeats.
    fn level(row: usize) -> f64 {
        2.0 + 0.7 * (row as f64 / 40.0).sin() + 0.3 * (row as f64 / 2.3).sin()
    }

    fn found(value_at: impl Fn(usize) -> f64) -> Option<UnitChange> {
        let values: Vec<f64> = (0..ROWS).map(value_at).collect();
        let timestamps: Vec<Timestamp> =
            (0..ROWS as i64).map(|row| Timestamp::from_micros(60_000_000 * row)).collect();
        UnitChange::find(&values, &timestamps)
    }

    /// Returns the row at which a unit changes.
    fn row_of(value_at: impl Fn(usize) -> f64) -> Option<usize> {
        found(value_at).map(|change| (change.at.as_micros() / 60_000_000) as usize)
    }

    #[test]
    fn a_factor_is_told_with_its_time() {
        let change = found(|row| level(row) * if row < 1_500 { 1.0 } else { 100.0 }).expect("told");
        assert_eq!(change.at, Timestamp::from_micros(60_000_000 * 1_500));
        let told = change.told("2024-03-02 01:00:00");
        assert!(told.starts_with("two ranges that do not overlap, mostly 1.1"), "{told}");
        assert!(told.contains(" before 2024-03-02 01:00:00 and 11"), "{told}");
        assert_eq!(row_of(|row| level(row) * if row < 3_000 { 1.0 } else { 0.001 }), Some(3_000));
    }

    fn celsius(row: usize) -> f64 {
        12.0 + 5.0 * level(row)
    }

    fn is_early(row: usize) -> bool {
        row < 2_000
    }

    #[test]
    fn degrees_are_told() {
        let row =
            row_of(|row| if is_early(row) { celsius(row) } else { 1.8 * celsius(row) + 32.0 });
        assert_eq!(row, Some(2_000));
        let to_kelvins = row_of(|row| celsius(row) + if is_early(row) { 0.0 } else { 273.15 });
        assert_eq!(to_kelvins, Some(2_000));
        let to_celsius = row_of(|row| celsius(row) + if is_early(row) { 273.15 } else { 0.0 });
        assert_eq!(to_celsius, Some(2_000));
    }

    #[test]
    fn bad_samples_hide_nothing_and_missing_ones_count_nothing() {
        let told = row_of(|row| match row {
            _ if row % 7 == 0 => f64::NAN,
            100 | 2_500 | 2_501 => 0.0,
            _ => level(row) * if row < 1_500 { 1.0 } else { 100.0 },
        });
        assert_eq!(told, Some(1_500));
    }

    #[test]
    fn what_a_plant_does_is_no_unit() {
        let none = [
            row_of(|row| level(row) + if is_early(row) { 8.0 } else { 14.0 }),
            // A drift.
            row_of(|row| level(row) + row as f64 / 100.0),
            // A switch.
            row_of(|row| if is_early(row) { 0.0 } else { 100.0 }),
            // A pump that was off.
            row_of(|row| if is_early(row) { 0.01 * level(row) } else { 40.0 + level(row) }),
            // A storm.
            row_of(|row| level(row) * if (900..1_500).contains(&row) { 9.0 } else { 1.0 }),
            // Few rows before.
            row_of(|row| level(row) * if row < 100 { 1.0 } else { 100.0 }),
            // Another load with the same noise: steps do not grow with the level.
            row_of(|row| {
                let wave = (row as f64 / 40.0).sin();
                let noise = 0.2 * (row as f64 * 1.7).sin();
                noise + (2.0 + 0.7 * wave) * if is_early(row) { 1.0 } else { 8.0 }
            }),
            // A vessel that empties passes all levels in between.
            row_of(|row| match row {
                0..2_000 => 10.0 * level(row),
                2_000..2_020 => 20.0 - (row - 2_000) as f64 * 0.9,
                _ => level(row),
            }),
        ];
        assert_eq!(none, [None; 8]);
    }
}
