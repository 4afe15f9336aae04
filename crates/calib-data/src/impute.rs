//! Fills missing values, or drops their rows, but never across a gap.

use std::ops::Range;

use calib_core::Timestamp;

use crate::Missing;

/// Fills missing values (NaN) inside each of `stretches` by the method `missing`, in place. Calls
/// `left` with every row that stays missing. Returns the number of filled values.
pub(crate) fn impute(
    values: &mut [f64],
    timestamps: &[Timestamp],
    stretches: &[Range<usize>],
    missing: Missing,
    limit: usize,
    mut left: impl FnMut(usize),
) -> u64 {
    let mut filled = 0;
    for stretch in stretches {
        let mut row = stretch.start;
        while row < stretch.end {
            if !values[row].is_nan() {
                row += 1;
                continue;
            }
            let length = values[row..stretch.end].iter().take_while(|value| value.is_nan()).count();
            let run = row..row + length;
            let before = (run.start > stretch.start).then(|| run.start - 1);
            let after = (run.end < stretch.end).then_some(run.end);
            let to_fill = match (missing, before, after) {
                (Missing::ForwardFill, Some(before), _) => {
                    let last = values[before];
                    let end = run.start + length.min(limit);
                    values[run.start..end].fill(last);
                    run.start..end
                }
                (Missing::Linear, Some(before), Some(after)) if length <= limit => {
                    let span = timestamps[after].micros_since(timestamps[before]) as f64;
                    let from = values[before];
                    let to = values[after];
                    for row in run.clone() {
                        let passed = timestamps[row].micros_since(timestamps[before]) as f64;
                        let share = passed / span;
                        values[row] = from * (1.0 - share) + to * share;
                    }
                    run.clone()
                }
                _ => run.start..run.start,
            };
            filled += to_fill.len() as u64;
            (to_fill.end..run.end).for_each(&mut left);
            row = run.end;
        }
    }
    filled
}

/// Returns the maximal runs of rows inside each of `stretches` that are not dropped.
pub(crate) fn clean(
    stretches: &[Range<usize>],
    dropped: impl Fn(usize) -> bool,
) -> Vec<Range<usize>> {
    let mut runs = Vec::new();
    for stretch in stretches {
        let mut start = stretch.start;
        for row in stretch.clone() {
            if dropped(row) {
                if start < row {
                    runs.push(start..row);
                }
                start = row + 1;
            }
        }
        if start < stretch.end {
            runs.push(start..stretch.end);
        }
    }
    runs
}

#[cfg(test)]
mod tests {
    use std::slice::from_ref;

    use proptest::prelude::*;

    use super::*;

    const NAN: f64 = f64::NAN;

    fn filled(
        values: &[f64],
        stretches: &[Range<usize>],
        missing: Missing,
        limit: usize,
    ) -> (Vec<f64>, Vec<usize>, u64) {
        let timestamps: Vec<Timestamp> =
            (0..values.len() as i64).map(Timestamp::from_micros).collect();
        let mut values = values.to_vec();
        let mut left = Vec::new();
        let count =
            impute(&mut values, &timestamps, stretches, missing, limit, |row| left.push(row));
        (values, left, count)
    }

    #[test]
    fn linear_interpolates_in_time() {
        let timestamps = [0, 10, 40].map(Timestamp::from_micros);
        let mut values = [0.0, NAN, 4.0];
        impute(&mut values, &timestamps, from_ref(&(0..3)), Missing::Linear, 1, |_| {});
        assert_eq!(values[1], 1.0);
    }

    /// Fills row by row, straight from the definition.
    fn naive(
        values: &[f64],
        stretch: &Range<usize>,
        missing: Missing,
        limit: usize,
        row: usize,
    ) -> Option<f64> {
        if !values[row].is_nan() {
            return Some(values[row]);
        }
        let before = (stretch.start..row).rev().find(|&at| !values[at].is_nan());
        let after = (row..stretch.end).find(|&at| !values[at].is_nan());
        match missing {
            Missing::DropRow => None,
            Missing::ForwardFill => before.filter(|at| row - at <= limit).map(|at| values[at]),
            Missing::Linear => {
                let before = before?;
                let after = after?;
                let share = (row - before) as f64 / (after - before) as f64;
                (after - before - 1 <= limit)
                    .then(|| values[before] * (1.0 - share) + values[after] * share)
            }
        }
    }

    proptest! {
        #[test]
        fn imputation_is_its_definition(
            values in prop::collection::vec(prop_oneof![(-5_i8..5).prop_map(f64::from), Just(NAN)], 1..40),
            cut in 0_usize..40,
            limit in 0_usize..5,
            missing in prop_oneof![Just(Missing::DropRow), Just(Missing::ForwardFill), Just(Missing::Linear)],
        ) {
            let cut = cut.min(values.len());
            let stretches: Vec<Range<usize>> =
                [0..cut, cut..values.len()].into_iter().filter(|stretch| !stretch.is_empty()).collect();
            let (got, left, count) = filled(&values, &stretches, missing, limit);
            let mut expected_left = Vec::new();
            for stretch in &stretches {
                for row in stretch.clone() {
                    match naive(&values, stretch, missing, limit, row) {
                        Some(value) => prop_assert!((got[row] - value).abs() < 1e-12),
                        None => expected_left.push(row),
                    }
                }
            }
            prop_assert_eq!(&left, &expected_left);
            let missing_before = values.iter().filter(|value| value.is_nan()).count();
            prop_assert_eq!(count as usize, missing_before - left.len());

            let runs = clean(&stretches, |row| left.contains(&row));
            let kept: Vec<usize> = runs.iter().cloned().flatten().collect();
            let expected: Vec<usize> = (0..values.len()).filter(|row| !left.contains(row)).collect();
            prop_assert_eq!(kept, expected);
            for run in &runs {
                prop_assert!(!run.is_empty());
                prop_assert!(stretches.iter().any(|stretch| stretch.start <= run.start && run.end <= stretch.end));
            }
            // Runs are maximal: two runs that touch are in different stretches.
            for pair in runs.windows(2) {
                prop_assert!(pair[0].end < pair[1].start || pair[0].end == cut);
            }
        }
    }
}
