use calib_core::{Monitor, Seed};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{KnnError, KnnModel, definition::by_definition, distance::stored, verify::sampled};

/// Share of true neighbours in the tables of a model.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Recall {
    /// Number of table rows that were searched again.
    pub rows: usize,
    /// Share of the neighbours at most as far as the true `k`-th neighbour.
    pub recall: f64,
    /// Interval for the recall over all rows, with about 95 % confidence: Wilson's interval with one trial per row. The
    /// neighbours of one row are dependent, and the recall of one row varies at most as much as one trial. For independent
    /// trials the interval covers 95 % on average over shares. It covers less for some shares: down to 84 % near 0 and 1
    /// (Brown, Cai and `DasGupta`, 2001).
    #[serde(default = "anywhere")]
    pub interval: [f64; 2],
    /// Mean over rows of the `k`-th distance in the table divided by the true one; 1 where both are 0.
    pub distance_ratio: f64,
    /// Rows whose true `k`-th distance is 0 and whose table distance is not: their ratio is undefined.
    #[serde(default)]
    pub copies_missed: usize,
}

/// Returns the interval of a stored recall that has none: the whole range.
fn anywhere() -> [f64; 2] {
    [0.0, 1.0]
}

/// Compares `sample` random rows of every member with brute force in f64 over all sources of the member.
///
/// The states are read once for all rows together. The distances in the tables are not checked; [`faults`](crate::faults)
/// does that. Progress counts sources.
///
/// # Errors
/// If the monitor interrupts.
pub fn recall(
    model: &KnnModel,
    sample: usize,
    seed: Seed,
    monitor: &dyn Monitor,
) -> Result<Recall, KnnError> {
    let cells = sampled(model, sample, seed);
    let lists = by_definition(model, &cells, monitor)?;
    let mut found = 0;
    let mut copies_missed = 0;
    let mut ratios = Vec::with_capacity(cells.len());
    for (&(number, transition), exact) in cells.iter().zip(&lists) {
        let (_, distances) = model.member(number).neighbors(transition);
        let furthest = exact.last().map_or(f32::INFINITY, |&(squared, _)| stored(squared));
        found += distances.iter().filter(|&&distance| distance <= furthest).count();
        let last = distances.last().copied().unwrap_or(f32::INFINITY);
        if furthest > 0.0 {
            ratios.push(f64::from(last) / f64::from(furthest));
        } else if last > 0.0 {
            copies_missed += 1;
        } else {
            ratios.push(1.0);
        }
    }
    let rows = cells.len();
    let recall = found as f64 / (rows * model.k()).max(1) as f64;
    let mean = ratios.iter().sum::<f64>() / ratios.len().max(1) as f64;
    Ok(Recall {
        rows,
        recall,
        interval: wilson(recall, rows),
        distance_ratio: if ratios.is_empty() { 1.0 } else { mean },
        copies_missed,
    })
}

/// Returns Wilson's 95 % interval (1927) for a share of `trials`. It is approximate, like every such interval.
fn wilson(share: f64, trials: usize) -> [f64; 2] {
    if trials == 0 {
        return anywhere();
    }
    let n = trials as f64;
    let z = 1.959_963_984_540_054_f64;
    let centre = share + z * z / (2.0 * n);
    let half = z * (share * (1.0 - share) / n + z * z / (4.0 * n * n)).max(0.0).sqrt();
    [centre - half, centre + half].map(|end| (end / (1.0 + z * z / n)).clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use calib_core::{Segments, Silent, States, Transitions};

    use super::*;
    use crate::ModelConfig;

    #[test]
    fn the_interval_is_wilsons() {
        // Newcombe (1998), table I: 81 of 263, and 0 of 20.
        let [low, high] = wilson(81.0 / 263.0, 263);
        assert!((low - 0.2553).abs() < 5e-5 && (high - 0.3662).abs() < 5e-5, "{low} {high}");
        let [low, high] = wilson(0.0, 20);
        assert!(low == 0.0 && (high - 0.1611).abs() < 5e-5, "{low} {high}");
        assert_eq!(wilson(1.0, 100)[1], 1.0);
        assert_eq!(wilson(0.0, 0), [0.0, 1.0]);
    }

    #[test]
    fn a_recall_that_was_written_without_an_interval_is_read() {
        let old = "rows = 100\nrecall = 0.9\ndistance_ratio = 1.1\n";
        let old: Recall = toml::from_str(old).expect("it was one");
        assert_eq!((old.interval, old.copies_missed), ([0.0, 1.0], 0));
    }

    #[test]
    fn copies_that_are_missed_are_told() {
        // Every state occurs five times in succession. One row in six can be a neighbour, so that most rows miss their
        // copies.
        let values = (0..1200_u16).map(|row| f32::from(row / 5)).collect();
        let states = States::new(values, 1200, 1).expect("finite");
        let transitions = Transitions::new(Segments::from_lengths([1200]).expect("one"));
        let [exact, every_sixth] = [1, 6].map(|prototypes| {
            let config = ModelConfig { prototypes, remove_traps: false, ..ModelConfig::default() };
            let model = KnnModel::build(states.clone(), transitions.clone(), &config, &Silent);
            recall(&model.expect("built"), 50, Seed::new(3), &Silent).expect("not interrupted")
        });
        assert_eq!((exact.recall, exact.distance_ratio, exact.copies_missed), (1.0, 1.0, 0));
        assert!(every_sixth.copies_missed > 200, "{every_sixth:?}");
        assert!(every_sixth.interval[0] < every_sixth.recall);
        assert!(every_sixth.interval[1] > every_sixth.recall);
    }
}
