//! Detects columns that count at a constant rate, such as clocks and row numbers.

use std::{collections::HashSet, slice};

use super::{Changes, ChannelSketch};

/// Minimum share of equal changes in a column that counts at a constant rate.
const EVEN: f64 = 0.95;
/// Columns with at most this many distinct values show no direction of changes: a switch that is used once only goes
/// up.
pub const FEW_VALUES: u32 = 20;

impl ChannelSketch {
    /// Whether the channel has more than a few distinct values.
    pub fn has_many_values(&self) -> bool {
        self.distinct.is_none_or(|distinct| distinct > FEW_VALUES)
    }

    /// Whether the channel counts at a constant rate, like a clock. It may restart.
    pub fn counts_on_evenly(&self) -> bool {
        self.has_many_values() && self.even >= EVEN
    }
}

/// Whether the values of a column count at a constant rate, like clocks and row numbers. They may restart. Values may
/// repeat for a while, like the number of an episode, or be missing (NaN).
pub fn counts_on_evenly(values: &[f64]) -> bool {
    let mut distinct = HashSet::new();
    let mut there = values.iter().filter(|value| !value.is_nan());
    let has_many_values = there.any(|value| {
        distinct.insert(value.to_bits());
        distinct.len() > FEW_VALUES as usize
    });
    has_many_values && Changes::of(values, slice::from_ref(&(0..values.len())), None).even >= EVEN
}
