//! Values that no plant measured: single samples far outside of all others.
//!
//! The training range defines the normal values. With Q(p) its quantiles, the *fences* of a channel are
//!
//! ```text
//! Q(0.005) - 3 W  and  Q(0.995) + 3 W,   W = Q(0.995) - Q(0.005).
//! ```
//!
//! These are Tukey's fences (*Exploratory Data Analysis*, 1977: beyond three times the spread is *far out*), with the
//! central 99 % instead of the central half. Plants have modes and bursts, so half of the values of a turbidity or a
//! valve say nothing about the others. A median absolute deviation, as in Hampel's rule, is 0 if a channel rests most
//! of the time. W is also at least twice the smallest change, so that neighbouring steps of a quantised channel are
//! inside the fences. If 99 % of the values are equal, the others cannot be judged, and there are no fences.
//!
//! A *spike* is a run of at most three rows beyond a fence, between rows within the fences. Longer runs, and runs at
//! the beginning or end of a stretch of the log, are kept because they may be real. (The numbers are our choices.
//! `docs/formats.md` lists what they flag on the logs that we have.)

use std::ops::Range;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{
    Outliers,
    channel::{is_same, quantile},
};

/// Share of the values on each side that the spread excludes.
const TAIL: f64 = 0.005;
/// Distance between a tail and its fence, in spreads.
const FAR: f64 = 3.0;
/// Maximum number of rows of a spike.
const SPIKE_ROWS: usize = 3;
/// Number of values that quantiles are computed from; more values are evenly thinned.
const LOOKED_AT: usize = 200_000;

/// The fences of a channel: the limits of its normal values, by its training range.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Fences {
    /// Values below this are far out.
    pub low: f64,
    /// Values above this are far out.
    pub high: f64,
}

impl Fences {
    /// Computes fences from the values of the training range, where NaN means missing; `None` if nearly all are equal.
    pub(crate) fn of(values: &[f64], smallest_change: Option<f64>) -> Option<Self> {
        let step = values.len() / LOOKED_AT + 1;
        let mut looked_at: Vec<f64> =
            values.iter().copied().step_by(step).filter(|value| !value.is_nan()).collect();
        if looked_at.is_empty() {
            return None;
        }
        let low = quantile(&mut looked_at, TAIL);
        let high = quantile(&mut looked_at, 1.0 - TAIL);
        if is_same(low, high) {
            return None;
        }
        let spread = (high - low).max(2.0 * smallest_change.unwrap_or(0.0));
        let fences = Self { low: low - FAR * spread, high: high + FAR * spread };
        (fences.low.is_finite() && fences.high.is_finite()).then_some(fences)
    }

    /// Whether `value` lies beyond a fence; false for a missing value.
    pub fn far_out(&self, value: f64) -> bool {
        value < self.low || value > self.high
    }

    /// Calls `found` with every row of `values` that is a spike, inside each of `stretches`.
    pub(crate) fn spikes(
        &self,
        values: &[f64],
        stretches: &[Range<usize>],
        mut found: impl FnMut(usize),
    ) {
        for stretch in stretches {
            let mut row = stretch.start;
            while row < stretch.end {
                if !self.far_out(values[row]) {
                    row += 1;
                    continue;
                }
                let end = (row..stretch.end).find(|&row| !self.far_out(values[row]));
                let end = end.unwrap_or(stretch.end);
                let is_between = row > stretch.start && end < stretch.end;
                if is_between && end - row <= SPIKE_ROWS {
                    (row..end).for_each(&mut found);
                }
                row = end;
            }
        }
    }

    /// Treats the spikes of `values` by the method `outliers`.
    pub(crate) fn treat(&self, values: &mut [f64], stretches: &[Range<usize>], outliers: Outliers) {
        if outliers == Outliers::Keep {
            return;
        }
        let mut rows = Vec::new();
        self.spikes(values, stretches, |row| rows.push(row));
        for row in rows {
            values[row] = match outliers {
                Outliers::Clip => values[row].clamp(self.low, self.high),
                Outliers::Keep | Outliers::Missing => f64::NAN,
            };
        }
    }
}

#[cfg(test)]
mod tests {
    use std::slice::from_ref;

    use proptest::prelude::*;

    use super::*;

    fn spikes(values: &[f64]) -> Vec<usize> {
        let mut rows = Vec::new();
        if let Some(fences) = Fences::of(values, None) {
            fences.spikes(values, from_ref(&(0..values.len())), |row| rows.push(row));
        }
        rows
    }

    /// Returns a level between 1480 and 1520.
    fn level(rows: usize) -> Vec<f64> {
        (0..rows).map(|row| 1500.0 + 20.0 * (row as f64 / 7.0).sin()).collect()
    }

    #[test]
    fn a_bad_sample_is_found_and_what_lasts_is_kept() {
        let mut values = level(2_000);
        assert_eq!(spikes(&values), [0; 0]);
        values[100] = 9.9e12;
        values[500] = 0.0;
        values[501] = 0.0;
        assert_eq!(spikes(&values), [100, 500, 501]);
        values[900..905].fill(1_000.0);
        assert_eq!(spikes(&values), [100, 500, 501], "five rows: the plant stood still");
        values[1_999] = 9.9e12;
        assert_eq!(spikes(&values), [100, 500, 501], "nobody knows what comes after it");
    }

    #[test]
    fn modes_bursts_and_quantised_channels_have_no_spikes() {
        let pump: Vec<f64> =
            (0..2_000).map(|row| if row % 50 == 0 { 100.0 } else { 0.0 }).collect();
        assert_eq!(spikes(&pump), [0; 0]);
        let rare: Vec<f64> = (0..2_000).map(|row| if row == 700 { 1.0 } else { 0.0 }).collect();
        assert_eq!(Fences::of(&rare, Some(1.0)), None, "99 % are equal");
        let quantised: Vec<f64> =
            (0..2_000).map(|row| f64::from(u8::from(row % 3 == 0)) * 0.1).collect();
        let fences = Fences::of(&quantised, Some(0.1)).expect("two values");
        assert!(!fences.far_out(0.6), "some steps further is not far out");
        let burst: Vec<f64> = (0..2_000)
            .map(|row| if row % 400 < 20 { 40.0 } else { 0.1 + f64::from(row % 7) * 0.01 })
            .collect();
        assert_eq!(spikes(&burst), [0; 0]);
    }

    #[test]
    fn spikes_are_kept_made_missing_or_clipped() {
        let mut values = level(2_000);
        values[100] = 9.9e12;
        let fences = Fences::of(&values, None).expect("a level");
        let [kept, missing, clipped] =
            [Outliers::Keep, Outliers::Missing, Outliers::Clip].map(|outliers| {
                let mut values = values.clone();
                fences.treat(&mut values, from_ref(&(0..2_000)), outliers);
                values[100]
            });
        assert_eq!(kept, 9.9e12);
        assert!(missing.is_nan());
        assert_eq!(clipped, fences.high);
    }

    proptest! {
        #[test]
        fn scale_and_offset_change_no_spike(
            values in prop::collection::vec(-20_i32..20, 300),
            at in 1_usize..299,
            scale in 1_i32..9,
            offset in -50_i32..50,
        ) {
            let mut values: Vec<f64> = values.into_iter().map(f64::from).collect();
            values[at] = 4_096.0;
            let found = spikes(&values);
            prop_assert_eq!(&found, &[at]);
            let moved: Vec<f64> =
                values.iter().map(|value| value * f64::from(scale) + f64::from(offset)).collect();
            prop_assert_eq!(spikes(&moved), found);
        }
    }
}
