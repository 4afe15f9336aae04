//! Columns that count on evenly, such as clocks and the numbers of rows.

use std::{collections::HashSet, slice};

use super::{Changes, ChannelSketch};

/// A column of which this share of changes are equal counts on evenly.
const EVEN: f64 = 0.95;
/// So few distinct values say nothing about the direction of changes: a switch that is thrown once only goes up.
pub const FEW_VALUES: u32 = 20;

impl ChannelSketch {
    /// Whether it has more than a few distinct values.
    pub fn has_many_values(&self) -> bool {
        self.distinct.is_none_or(|distinct| distinct > FEW_VALUES)
    }

    /// Whether it counts on evenly, as clocks do, also those that start anew.
    pub fn counts_on_evenly(&self) -> bool {
        self.has_many_values() && self.even >= EVEN
    }
}

/// Whether the values of a column count on evenly, as clocks and the numbers of rows do, also those that start anew. Values may stay as they
/// are for a while, as the number of an episode does, or be missing, which is NaN.
pub fn counts_on_evenly(values: &[f64]) -> bool {
    let mut distinct = HashSet::new();
    let mut there = values.iter().filter(|value| !value.is_nan());
    let has_many_values = there.any(|value| {
        distinct.insert(value.to_bits());
        distinct.len() > FEW_VALUES as usize
    });
    has_many_values && Changes::of(values, slice::from_ref(&(0..values.len())), None).even >= EVEN
}
