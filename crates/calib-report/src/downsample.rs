//! Fewer points that look the same.

/// Thins `values` `[n]` to at most `max_points` indices, ascending, that keep every peak visible.
///
/// The series is cut into buckets of equal length; each gives its first smallest and its first largest value,
/// in time order, and the first and last point of the series are always kept. Values that are not
/// finite (gaps) are never extremes; a bucket without a finite value gives its first point, so that a gap stays one.
/// Series that are short enough come back whole. At least four points are kept.
///
/// Source: the usual min–max decimation of plotting libraries; O(n).
///
/// ```
/// let mut values = vec![0.0; 10_000];
/// values[7_777] = 5.0;
/// let kept = calib_report::min_max_indices(&values, 100);
/// assert!(kept.len() <= 100 && kept.contains(&7_777));
/// ```
pub fn min_max_indices(values: &[f64], max_points: usize) -> Vec<usize> {
    let (n, max_points) = (values.len(), max_points.max(4));
    if n <= max_points {
        return (0..n).collect();
    }
    let buckets = (max_points - 2) / 2;
    let mut kept = Vec::with_capacity(max_points);
    kept.push(0);
    for bucket in 0..buckets {
        // The first and last point are kept anyway.
        let start = 1 + bucket * (n - 2) / buckets;
        let end = 1 + (bucket + 1) * (n - 2) / buckets;
        let (low, high) = extremes(values, start, end);
        kept.push(low.min(high));
        if low != high {
            kept.push(low.max(high));
        }
    }
    kept.push(n - 1);
    kept
}

/// Indices of the first smallest and the first largest finite value in `start..end`.
fn extremes(values: &[f64], start: usize, end: usize) -> (usize, usize) {
    let mut found: Option<(usize, usize)> = None;
    for index in start..end {
        if !values[index].is_finite() {
            continue;
        }
        let (low, high) = found.get_or_insert((index, index));
        if values[index] < values[*low] {
            *low = index;
        }
        if values[index] > values[*high] {
            *high = index;
        }
    }
    found.unwrap_or((start, start))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_short_series_comes_back_whole() {
        assert_eq!(min_max_indices(&[1.0, 2.0, 3.0], 10), [0, 1, 2]);
        assert_eq!(min_max_indices(&[], 10), [] as [usize; 0]);
    }

    #[test]
    fn a_gap_longer_than_a_bucket_stays_a_gap() {
        let mut values = vec![1.0; 1000];
        values[400..600].fill(f64::NAN);
        let kept = min_max_indices(&values, 50);
        assert!(kept.iter().any(|&i| values[i].is_nan()));
    }

    proptest! {
        #[test]
        fn extremes_and_ends_survive_and_the_limit_holds(
            values in prop::collection::vec(-1e3f64..1e3, 1..600), max_points in 0usize..80
        ) {
            let kept = min_max_indices(&values, max_points);
            prop_assert!(kept.len() <= max_points.max(4));
            prop_assert!(kept.windows(2).all(|pair| pair[0] < pair[1]));
            prop_assert_eq!(kept[0], 0);
            prop_assert_eq!(*kept.last().unwrap(), values.len() - 1);
            let largest = values.iter().copied().fold(f64::MIN, f64::max);
            let smallest = values.iter().copied().fold(f64::MAX, f64::min);
            prop_assert!(kept.iter().any(|&i| values[i] == largest));
            prop_assert!(kept.iter().any(|&i| values[i] == smallest));
        }
    }
}
