//! Chooses the levels of a column of continuous actions.

use crate::FEW_STEPS;

/// The largest width of a cluster of values, as a share of the range. Our choice.
const WIDEST: f64 = 0.05;
/// The smallest empty space beside a cluster, as a multiple of the widest cluster's width. Our choice.
const SPACE: f64 = 2.0;
/// The most decimal places of a level that stands for a cluster.
const MOST_DIGITS: i32 = 12;

/// Returns the levels of a column, ascending; NaN stands for missing values. A column with at most `levels` different values keeps these.
/// If all values lie in at most `levels` narrow clusters, such as those of a valve that is read back with noise, each cluster has one
/// level. Otherwise the levels are an even grid from the least to the largest value, without levels that are nearest to no value.
pub(crate) fn of_column(column: &[f64], levels: usize) -> Vec<f64> {
    let sorted = sorted_values(column);
    let mut own = sorted.clone();
    own.dedup();
    if own.len() <= levels {
        return own;
    }
    clustered(&sorted, levels).unwrap_or_else(|| even(&own, levels))
}

/// Returns the values of a column, ascending, without missing ones, which are NaN.
pub(crate) fn sorted_values(column: &[f64]) -> Vec<f64> {
    // Adding 0 turns −0 into 0.
    let values = column.iter().map(|value| value + 0.0);
    let mut sorted: Vec<f64> = values.filter(|value| !value.is_nan()).collect();
    sorted.sort_by(f64::total_cmp);
    sorted
}

/// Returns one value per cluster of ascending values, or `None` if they do not lie in 2 to `most` narrow clusters.
fn clustered(sorted: &[f64], most: usize) -> Option<Vec<f64>> {
    let range = sorted.last()? - sorted.first()?;
    let clusters: Vec<&[f64]> =
        sorted.chunk_by(|value, next| next - value <= WIDEST * range).collect();
    if !(2..=most).contains(&clusters.len()) {
        return None;
    }
    let widest = clusters.iter().map(|cluster| width(cluster)).fold(0.0, f64::max);
    let spaces = clusters.windows(2).map(|pair| pair[1][0] - pair[0][pair[0].len() - 1]);
    let nearest = spaces.fold(f64::INFINITY, f64::min);
    let are_narrow = widest <= WIDEST * range && nearest >= SPACE * widest;
    let have_rows = clusters.iter().all(|cluster| cluster.len() >= FEW_STEPS);
    (are_narrow && have_rows).then(|| clusters.iter().map(|cluster| centre(cluster)).collect())
}

/// Returns the range of ascending values.
fn width(cluster: &[f64]) -> f64 {
    cluster[cluster.len() - 1] - cluster[0]
}

/// Returns the mean of ascending values, with only the digits that a number between them needs: 0.5 for 0.497 to 0.504.
fn centre(cluster: &[f64]) -> f64 {
    let mean = cluster.iter().sum::<f64>() / cluster.len() as f64;
    let between = cluster[0]..=cluster[cluster.len() - 1];
    let mut rounded = (0..=MOST_DIGITS).map(|digits| {
        let unit = 10_f64.powi(digits);
        // Adding 0 turns −0 into 0.
        (mean * unit).round() / unit + 0.0
    });
    rounded.find(|value| between.contains(value)).unwrap_or(cluster[cluster.len() / 2])
}

/// Returns an even grid from the least to the largest of ascending values, without levels that are nearest to none of them.
fn even(own: &[f64], levels: usize) -> Vec<f64> {
    let [low, high] = [own[0], own[own.len() - 1]];
    let last = levels - 1;
    let step = (high - low) / last as f64;
    let mut is_near = vec![false; levels];
    for value in own {
        is_near[(((value - low) / step).round() as usize).min(last)] = true;
    }
    let grid = (0..levels).filter(|&level| is_near[level]).map(|level| {
        let value = low + (high - low) * level as f64 / last as f64;
        // Levels are rounded to single precision, as most logs store it, so that their names are short.
        f64::from(value as f32)
    });
    grid.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the readings of a valve at one of `levels` in each row, with noise of up to `noise`.
    fn read_back(levels: &[f64], noise: f64, rows: usize) -> Vec<f64> {
        (0..rows)
            .map(|row: usize| {
                let off = (row * 37 % 101) as f64 / 50.0 - 1.0;
                levels[row % levels.len()] + off * noise
            })
            .collect()
    }

    #[test]
    fn a_noisy_reading_has_the_levels_that_were_set() {
        let valve = read_back(&[0.0, 0.5, 1.0], 0.009, 600);
        assert_eq!(of_column(&valve, 7), [0.0, 0.5, 1.0]);
        assert_eq!(of_column(&valve, 3), [0.0, 0.5, 1.0]);
        let uneven = read_back(&[0.0, 20.0, 100.0], 0.7, 600);
        assert_eq!(of_column(&uneven, 7), [0.0, 20.0, 100.0]);
        let mut known = valve;
        known.extend([f64::NAN; 9]);
        assert_eq!(of_column(&known, 7), [0.0, 0.5, 1.0], "what is missing is no value");
    }

    #[test]
    fn what_does_not_lie_in_narrow_clusters_has_an_even_grid() {
        let even = of_column(&read_back(&[50.0], 50.0, 500), 5);
        assert_eq!(even, [0.0, 25.0, 50.0, 75.0, 100.0]);
        // There are more clusters than levels.
        let valve = read_back(&[0.0, 0.25, 0.5, 0.75, 1.0], 0.009, 600);
        assert_eq!(of_column(&valve, 3).len(), 3);
        // A cluster of few rows may consist of slips.
        let mut rare = read_back(&[0.0, 0.5], 0.009, 600);
        rare.extend([1.0; 29]);
        assert_ne!(of_column(&rare, 7), [0.0, 0.5, 1.0]);
        rare.push(1.0);
        assert_eq!(of_column(&rare, 7), [0.0, 0.5, 1.0]);
    }

    #[test]
    fn a_level_that_is_nearest_to_no_row_is_left_out() {
        // The pump is off, or anywhere in the upper half.
        let mut pump = read_back(&[75.0], 25.0, 500);
        pump.extend([0.0; 100]);
        assert_eq!(of_column(&pump, 5), [0.0, 50.0, 75.0, 100.0]);
    }
}
