//! Statistics with intervals over plants.

use calib_core::{Rng, Seed};
use calib_stats::{Interval, StatsError, cluster_interval};

/// The pairs of each plant, and how often plants are drawn again.
#[derive(Clone, Debug)]
pub(crate) struct OverPlants {
    /// Numbers of the pairs, plant by plant.
    pairs: Vec<Vec<usize>>,
    resamples: usize,
    seed: Seed,
}

impl OverPlants {
    /// `plants` is the plant of each pair.
    pub(crate) fn new<'a>(
        plants: impl Iterator<Item = &'a str>,
        resamples: usize,
        seed: Seed,
    ) -> Self {
        let mut names: Vec<&str> = Vec::new();
        let mut pairs: Vec<Vec<usize>> = Vec::new();
        for (number, plant) in plants.enumerate() {
            if let Some(place) = names.iter().position(|name| *name == plant) {
                pairs[place].push(number);
            } else {
                names.push(plant);
                pairs.push(vec![number]);
            }
        }
        Self { pairs, resamples, seed }
    }

    /// The pairs of each plant for which `has` holds, without plants that have none.
    pub(crate) fn each(&self, has: impl Fn(usize) -> bool) -> Vec<Vec<usize>> {
        let of_plant = |pairs: &Vec<usize>| -> Vec<usize> {
            pairs.iter().copied().filter(|&pair| has(pair)).collect()
        };
        self.pairs.iter().map(of_plant).filter(|pairs| !pairs.is_empty()).collect()
    }

    /// 95 % interval of `statistic`, which is given numbers of pairs, some of them several times.
    ///
    /// Every interval has the same draws, so that methods are compared on the same plants. Plants that `has` says
    /// have nothing to say are left out.
    pub(crate) fn interval(
        &self,
        has: impl Fn(usize) -> bool,
        statistic: impl Fn(&[usize]) -> Option<f64>,
    ) -> Result<Option<Interval>, StatsError> {
        let plants = self.each(has);
        let mut rng: Rng = self.seed.rng();
        let draw = |below| rng.below(below);
        cluster_interval(plants.len(), self.resamples, draw, |drawn| {
            let pairs: Vec<usize> =
                drawn.iter().flat_map(|&plant| &plants[plant]).copied().collect();
            statistic(&pairs)
        })
    }
}

/// The mean of `value` over `pairs`; `None` for none.
pub(crate) fn mean_of(pairs: &[usize], value: impl Fn(usize) -> f64) -> Option<f64> {
    let sum: f64 = pairs.iter().map(|&pair| value(pair)).sum();
    (!pairs.is_empty()).then(|| sum / pairs.len() as f64)
}
