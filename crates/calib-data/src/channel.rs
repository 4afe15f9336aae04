//! Statistics of one channel.

use std::{collections::HashSet, ops::Range};

use calib_core::Timestamp;

/// Maximum number of distinct values that are counted.
const DISTINCT: usize = 256;

/// Number of values that are read twice while they are in the cache.
const BLOCK: usize = 4_096;
/// Number of parallel sums: few enough for registers, and always the same order of additions.
const LANES: usize = 4;

/// Numbers with a smaller relative difference are equal up to rounding, such as 0.05 and 0.05000000000000001: rounding
/// is about 1e-16 per operation. Our choice.
const NOISE: f64 = 1e-12;

/// Whether two values are equal up to rounding.
pub fn is_same(one: f64, other: f64) -> bool {
    one == other || (one - other).abs() <= NOISE * one.abs().max(other.abs())
}

/// Returns the bits of a value without those that rounding may change.
fn rounded_bits(value: f64) -> u64 {
    const NOISY: u64 = (1 << 12) - 1;
    value.to_bits().saturating_add(NOISY / 2) & !NOISY
}

/// Moments of the values in a range of rows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Moments {
    /// Number of values that are not missing.
    pub(crate) count: usize,
    pub(crate) min: f64,
    pub(crate) max: f64,
    pub(crate) mean: f64,
    /// Sum of the squared differences from the mean.
    squares: f64,
}

impl Moments {
    /// Computes the moments of `values`, where NaN means missing; `None` if all are missing.
    pub(crate) fn of(values: &[f64]) -> Option<Self> {
        values.chunks(BLOCK).filter_map(Self::of_block).reduce(Self::merge)
    }

    /// Returns the standard deviation, with division by the count.
    pub(crate) fn std(&self) -> f64 {
        (self.squares / self.count as f64).sqrt()
    }

    /// Combines the moments of two sets of values (Chan, Golub and `LeVeque` 1979). One far outlier does not cost the
    /// digits of all other values.
    pub(crate) fn merge(self, other: Self) -> Self {
        let count = self.count + other.count;
        let share = other.count as f64 / count as f64;
        let difference = other.mean - self.mean;
        Self {
            count,
            min: self.min.min(other.min),
            max: self.max.max(other.max),
            mean: self.mean + difference * share,
            squares: self.squares
                + other.squares
                + difference * difference * share * self.count as f64,
        }
    }

    fn of_block(values: &[f64]) -> Option<Self> {
        let mut counts = [0_u64; LANES];
        let mut sums = [0.0; LANES];
        let mut mins = [f64::INFINITY; LANES];
        let mut maxs = [f64::NEG_INFINITY; LANES];
        for chunk in values.chunks(LANES) {
            for (lane, &value) in chunk.iter().enumerate() {
                let present = !value.is_nan();
                counts[lane] += u64::from(present);
                sums[lane] += if present { value } else { 0.0 };
                // Comparisons with NaN are false.
                mins[lane] = if value < mins[lane] { value } else { mins[lane] };
                maxs[lane] = if value > maxs[lane] { value } else { maxs[lane] };
            }
        }
        let count = counts.iter().sum::<u64>() as usize;
        if count == 0 {
            return None;
        }
        let min = mins.into_iter().fold(f64::INFINITY, f64::min);
        let max = maxs.into_iter().fold(f64::NEG_INFINITY, f64::max);
        let mean = (sums.iter().sum::<f64>() / count as f64).clamp(min, max);
        let mut squares = [0.0; LANES];
        for chunk in values.chunks(LANES) {
            for (lane, &value) in chunk.iter().enumerate() {
                let difference = if value.is_nan() { 0.0 } else { value - mean };
                squares[lane] += difference * difference;
            }
        }
        Some(Self { count, min, max, mean, squares: squares.iter().sum() })
    }
}

/// The changes of a channel from row to row.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Movement {
    /// Longest time for which the value stayed exactly the same, in microseconds.
    pub(crate) longest_stuck: i64,
    /// The value of that time.
    pub(crate) stuck_at: Option<f64>,
    /// Smallest change between successive rows.
    pub(crate) smallest_change: Option<f64>,
    /// Share of successive rows without a change.
    pub(crate) unchanged: f64,
    /// Number of distinct values, if there are few.
    pub(crate) distinct: Option<u32>,
}

impl Movement {
    /// Measures the changes of `values` inside each of `stretches`; a missing value ends a run.
    pub(crate) fn of(values: &[f64], timestamps: &[Timestamp], stretches: &[Range<usize>]) -> Self {
        let mut movement = Self::default();
        let mut pairs = 0_u64;
        let mut same = 0_u64;
        let mut smallest = f64::INFINITY;
        let mut distinct = HashSet::new();
        for stretch in stretches {
            let mut before = f64::NAN;
            let mut since = stretch.start;
            for row in stretch.clone() {
                let value = values[row];
                if is_same(value, before) {
                    pairs += 1;
                    same += 1;
                    continue;
                }
                let change = (value - before).abs();
                if !change.is_nan() {
                    pairs += 1;
                    smallest = smallest.min(change);
                }
                movement.note_run(timestamps, since..row, before);
                since = row;
                before = value;
                if !value.is_nan() && distinct.len() <= DISTINCT {
                    distinct.insert(rounded_bits(value));
                }
                if value.is_nan() {
                    since = row + 1;
                }
            }
            movement.note_run(timestamps, since..stretch.end, before);
        }
        movement.smallest_change = smallest.is_finite().then_some(smallest);
        movement.unchanged = if pairs == 0 { 0.0 } else { same as f64 / pairs as f64 };
        movement.distinct = (distinct.len() <= DISTINCT).then_some(distinct.len() as u32);
        movement
    }

    fn note_run(&mut self, timestamps: &[Timestamp], run: Range<usize>, value: f64) {
        if run.len() > 1 {
            let span = timestamps[run.end - 1].micros_since(timestamps[run.start]);
            if span > self.longest_stuck {
                self.longest_stuck = span;
                self.stuck_at = Some(value);
            }
        }
    }
}

/// Returns the quantile `q` of the values that are not missing, with linear interpolation between them (type 7 of
/// Hyndman and Fan, the default of NumPy). Reorders `values`.
///
/// # Panics
/// If all values are missing.
pub(crate) fn quantile(values: &mut Vec<f64>, q: f64) -> f64 {
    values.retain(|value| !value.is_nan());
    let position = q * (values.len() - 1) as f64;
    let low = position.floor() as usize;
    let (_, &mut at_low, above) = values.select_nth_unstable_by(low, f64::total_cmp);
    let next = above.iter().copied().fold(f64::INFINITY, f64::min);
    if position > low as f64 { at_low + (position - low as f64) * (next - at_low) } else { at_low }
}

#[cfg(test)]
mod tests {
    use std::slice::from_ref;

    use proptest::prelude::*;

    use super::*;

    const NAN: f64 = f64::NAN;

    #[test]
    fn moments_skip_missing_values() {
        let moments = Moments::of(&[NAN, 2.0, 4.0, NAN, 6.0]).expect("three values");
        assert_eq!((moments.count, moments.min, moments.max, moments.mean), (3, 2.0, 6.0, 4.0));
        assert!((moments.std() - (8.0_f64 / 3.0).sqrt()).abs() < 1e-15);
        assert_eq!(Moments::of(&[NAN]), None);
        let constant = Moments::of(&[0.1; 1_000]).expect("values");
        assert_eq!((constant.mean, constant.std()), (0.1, 0.0));
    }

    #[test]
    fn rounding_is_no_change() {
        let sums = [0.05, 0.05, 0.050_000_000_000_000_01, 0.05, 0.049_999_999_999_999_996];
        let timestamps: Vec<Timestamp> = (0..5).map(Timestamp::from_micros).collect();
        let movement = Movement::of(&sums, &timestamps, from_ref(&(0..5)));
        let Movement { smallest_change, unchanged, distinct, .. } = movement;
        assert_eq!((smallest_change, unchanged, distinct), (None, 1.0, Some(1)));
        assert!(is_same(57.363_333_333_333_34, 57.363_333_333_333_35) && is_same(0.0, 0.0));
        assert!(!is_same(1e-9, 1.1e-9), "small values are values");
        assert!(!is_same(1e9, 1e9 + 0.1) && !is_same(f64::NAN, f64::NAN));
    }

    #[test]
    fn an_outlier_does_not_cost_the_digits() {
        let mut values = vec![1e9];
        values.extend((0..1_000).map(|i| if i % 2 == 0 { 1.0 } else { 1.02 }));
        let std = Moments::of(&values).expect("values").std();
        let expected = 1e9 * (1_000.0_f64 / 1_001.0 / 1_001.0).sqrt();
        assert!((std / expected - 1.0).abs() < 1e-6);
    }

    proptest! {
        #[test]
        fn blocks_merge_to_the_whole(
            values in prop::collection::vec(prop_oneof![5 => -1e3_f64..1e3, 1 => Just(NAN)], 1..60),
            cut in 0_usize..60,
        ) {
            let cut = cut.min(values.len());
            let parts = [Moments::of(&values[..cut]), Moments::of(&values[cut..])];
            let merged = parts.into_iter().flatten().reduce(Moments::merge);
            let present: Vec<f64> = values.iter().copied().filter(|value| !value.is_nan()).collect();
            prop_assert_eq!(merged.map_or(0, |moments| moments.count), present.len());
            if let Some(moments) = merged {
                let count = present.len() as f64;
                let mean = present.iter().sum::<f64>() / count;
                let variance = present.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / count;
                prop_assert!((moments.mean - mean).abs() < 1e-9);
                prop_assert!((moments.std() - variance.sqrt()).abs() < 1e-9);
                prop_assert_eq!(moments.min, present.iter().copied().fold(f64::INFINITY, f64::min));
                prop_assert_eq!(moments.max, present.iter().copied().fold(f64::NEG_INFINITY, f64::max));
            }
        }
    }

    #[test]
    fn movement_stays_inside_stretches() {
        let timestamps: Vec<Timestamp> = (0..10).map(Timestamp::from_micros).collect();
        let values = [1.0, 1.0, 1.5, 1.5, NAN, 1.5, 1.5, 1.5, 1.5, 4.0];
        let movement = Movement::of(&values, &timestamps, &[0..7, 7..10]);
        assert_eq!(movement.longest_stuck, 1, "rows 5 to 8 are cut by the end of a stretch");
        assert_eq!(movement.smallest_change, Some(0.5));
        assert_eq!(movement.distinct, Some(3));
        // Pairs: 0-1, 1-2, 2-3, 5-6 | 7-8, 8-9.
        assert!((movement.unchanged - 4.0 / 6.0).abs() < 1e-15);
        let one = Movement::of(&values, &timestamps, from_ref(&(0..10)));
        assert_eq!((one.longest_stuck, one.stuck_at), (3, Some(1.5)));
        assert_eq!(
            Movement::of(&[NAN], &timestamps, from_ref(&(0..1))),
            Movement { distinct: Some(0), ..Movement::default() }
        );
    }

    #[test]
    fn quantiles_agree_with_numpy() {
        // numpy.quantile([3, 1, 2, 10], [0, 0.05, 0.5, 0.95, 1])
        let expected = [(0.0, 1.0), (0.05, 1.15), (0.5, 2.5), (0.95, 8.95), (1.0, 10.0)];
        for (q, expected) in expected {
            let got = quantile(&mut vec![3.0, NAN, 1.0, 2.0, 10.0], q);
            assert!((got - expected).abs() < 1e-12, "{q}: {got}");
        }
        assert_eq!(quantile(&mut vec![7.0], 0.3), 7.0);
    }
}
