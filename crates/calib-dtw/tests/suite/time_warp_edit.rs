//! Tests the time warp edit distance against its definition, cell by cell.

use calib_dtw::{DtwError, InstructionSet, Series, TimeWarpEdit};
use proptest::prelude::*;

/// Computes the recursion as it is defined, with the whole matrix.
fn by_definition(x: Series<'_>, y: Series<'_>, stiffness: f64, deletion: f64) -> f64 {
    let n = x.len();
    let m = y.len();
    let mut g = vec![vec![f64::INFINITY; m + 1]; n + 1];
    g[0][0] = 0.0;
    for i in 1..=n {
        for j in 1..=m {
            let same = apart(&sample(x, i), &sample(y, j));
            let before = apart(&sample(x, i - 1), &sample(y, j - 1));
            let time = 2.0 * stiffness * i.abs_diff(j) as f64;
            let delete_x = apart(&sample(x, i), &sample(x, i - 1)) + stiffness + deletion;
            let delete_y = apart(&sample(y, j), &sample(y, j - 1)) + stiffness + deletion;
            g[i][j] = (g[i - 1][j - 1] + same + before + time)
                .min(g[i - 1][j] + delete_x)
                .min(g[i][j - 1] + delete_y);
        }
    }
    g[n][m]
}

/// Returns a sample, counted from 1. The one before the first is zero.
fn sample(series: Series<'_>, index: usize) -> Vec<f64> {
    if index == 0 { vec![0.0; series.channels()] } else { series.sample(index - 1).to_vec() }
}

/// Returns the distance between two samples, summed over all channels.
fn apart(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum()
}

fn values() -> impl Strategy<Value = Vec<f64>> {
    proptest::collection::vec(-2.0..2.0, 1..40)
}

fn distance(x: &[f64], y: &[f64]) -> f64 {
    TimeWarpEdit::default().distance(x, y).expect("neither is empty")
}

proptest! {
    #[test]
    fn it_is_the_recursion_for_all_instructions(
        x in values(), y in values(), channels in 1..4_usize,
        stiffness in 0.0..0.5_f64, deletion in 0.0..2.0_f64,
    ) {
        let [x, y] = [x, y].map(|mut values| {
            let whole = values.len().max(channels) / channels * channels;
            values.resize(whole, 0.5);
            values
        });
        let x = Series::with_channels(&x, channels).unwrap();
        let y = Series::with_channels(&y, channels).unwrap();
        let twed = TimeWarpEdit::new(stiffness, deletion).unwrap();
        let found = twed.distance(x, y).unwrap();
        prop_assert!((found - by_definition(x, y, stiffness, deletion)).abs() < 1e-9);
        for set in InstructionSet::available() {
            let same = twed.instruction_set(set).unwrap().distance(x, y).unwrap();
            prop_assert_eq!(same.to_bits(), found.to_bits(), "{}", set);
        }
    }

    #[test]
    fn it_is_a_metric(x in values(), y in values(), z in values()) {
        prop_assert_eq!(distance(&x, &x), 0.0);
        prop_assert!((distance(&x, &y) - distance(&y, &x)).abs() < 1e-9);
        prop_assert!(distance(&x, &z) <= distance(&x, &y) + distance(&y, &z) + 1e-9);
        prop_assert!(x == y || distance(&x, &y) > 0.0);
    }
}

#[test]
fn what_cannot_be_compared_is_refused() {
    let twed = TimeWarpEdit::default();
    assert!(matches!(twed.distance(&[], &[1.0]), Err(DtwError::Empty { .. })));
    assert!(matches!(twed.distance(&[f64::NAN], &[1.0]), Err(DtwError::NotFinite { .. })));
    let error = TimeWarpEdit::new(0.1, -1.0).unwrap_err().to_string();
    assert!(error.contains("deletion") && error.contains("-1"), "{error}");
    assert!(TimeWarpEdit::new(f64::NAN, 1.0).is_err());
}
