//! Thinning of series to fewer points that look the same.

/// Thins `values` `[n]` to at most `max_points` ascending indices that keep every peak visible.
///
/// The series is cut into buckets of equal length. Each bucket keeps its first smallest and its first largest value,
/// in time order. The first and the last point of the series are always kept.
/// Values that are not finite (gaps) are never extremes. A bucket without a finite value keeps its first point, so that
/// the gap stays visible. Short series are returned whole. At least four points are kept.
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
    let n = values.len();
    let max_points = max_points.max(4);
    if n <= max_points {
        return (0..n).collect();
    }
    let buckets = (max_points - 2) / 2;
    let mut kept = Vec::with_capacity(max_points);
    kept.push(0);
    for bucket in 0..buckets {
        // The first and the last point are kept anyway.
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

/// Thins a time series, `values` at `times` (ascending, in any unit). Each of `buckets` equal stretches of time keeps its
/// first smallest and its first largest finite value, in time order. The first and the last value are kept.
///
/// Returns positions in the series. `None` breaks the line: there is no value for longer than `longest_step`, and
/// for longer than a stretch.
///
/// ```
/// let times = [0.0, 1.0, 2.0, 50.0, 51.0, 52.0];
/// let values = [5.0, 7.0, 6.0, 1.0, 1.0, f64::NAN];
/// let kept = calib_report::min_max_in_time(&times, &values, 100, 1.5);
/// assert_eq!(kept, [Some(0), Some(1), Some(2), None, Some(3), Some(4)]);
/// ```
pub fn min_max_in_time(
    times: &[f64],
    values: &[f64],
    buckets: usize,
    longest_step: f64,
) -> Vec<Option<usize>> {
    let present: Vec<usize> = (0..values.len()).filter(|&at| values[at].is_finite()).collect();
    let (Some(&first), Some(&last)) = (present.first(), present.last()) else { return Vec::new() };
    let buckets = buckets.max(1);
    let length = (times[last] - times[first]) / buckets as f64;
    let mut kept: Vec<Option<usize>> = vec![Some(first)];
    let mut before = first;
    let by_bucket = present.chunk_by(|&a, &b| {
        let [a, b] = [a, b].map(|at| ((times[at] - times[first]) / length) as usize);
        a.min(buckets - 1) == b.min(buckets - 1)
    });
    for own in by_bucket {
        // A break inside a stretch is shorter than the stretch.
        if times[own[0]] - times[before] > longest_step.max(length) {
            kept.push(None);
        }
        let low = own.iter().copied().min_by(|&a, &b| values[a].total_cmp(&values[b]));
        // `max_by` returns the last of equal values, so the search runs backwards.
        let high = own.iter().copied().rev().max_by(|&a, &b| values[a].total_cmp(&values[b]));
        let (low, high) = (low.unwrap_or(first), high.unwrap_or(first));
        keep(&mut kept, low.min(high));
        keep(&mut kept, low.max(high));
        before = own[own.len() - 1];
    }
    keep(&mut kept, last);
    kept
}

/// Adds a position, unless it was added last.
fn keep(kept: &mut Vec<Option<usize>>, at: usize) {
    if kept.last() != Some(&Some(at)) {
        kept.push(Some(at));
    }
}

/// Returns the indices of the first smallest and the first largest finite value in `start..end`.
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

    #[test]
    fn a_series_without_values_has_no_points() {
        assert_eq!(min_max_in_time(&[], &[], 10, 1.0), []);
        assert_eq!(min_max_in_time(&[1.0], &[f64::NAN], 10, 1.0), []);
        assert_eq!(min_max_in_time(&[1.0], &[3.0], 0, 1.0), [Some(0)]);
    }

    proptest! {
        #[test]
        fn extremes_of_every_stretch_survive_and_breaks_are_where_there_is_nothing(
            steps in prop::collection::vec((1u32..40, -1e3f64..1e3), 1..400), buckets in 1usize..60
        ) {
            let times: Vec<f64> = steps
                .iter()
                .scan(0.0, |time, (step, _)| { *time += f64::from(*step); Some(*time) })
                .collect();
            let values: Vec<f64> = steps.iter().map(|(_, value)| *value).collect();
            let kept = min_max_in_time(&times, &values, buckets, 20.0);
            let places: Vec<usize> = kept.iter().flatten().copied().collect();
            prop_assert!(places.windows(2).all(|pair| pair[0] < pair[1]));
            prop_assert!(places.len() <= 2 * buckets + 2);
            prop_assert_eq!((places[0], *places.last().unwrap()), (0, values.len() - 1));
            // This checks the definition stretch by stretch.
            let length = (times[values.len() - 1] - times[0]) / buckets as f64;
            for stretch in 0..buckets {
                let own: Vec<usize> = (0..values.len())
                    .filter(|&at| (((times[at] - times[0]) / length) as usize).min(buckets - 1) == stretch)
                    .collect();
                for wanted in [f64::min, f64::max] {
                    let extreme = own.iter().map(|&at| values[at]).reduce(wanted);
                    let is_kept = extreme.is_none_or(|value| {
                        own.iter().any(|at| values[*at] == value && places.contains(at))
                    });
                    prop_assert!(is_kept);
                }
            }
            let limit = length.max(20.0);
            for pair in kept.windows(3).filter(|window| window[1].is_none()) {
                let (Some(from), Some(to)) = (pair[0], pair[2]) else { panic!("a break at an end") };
                prop_assert!(times[to] - times[from] > limit);
            }
            let breaks = times.windows(2).filter(|pair| pair[1] - pair[0] > limit).count();
            prop_assert_eq!(kept.iter().filter(|value| value.is_none()).count(), breaks);
        }

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
