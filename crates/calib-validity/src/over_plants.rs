//! Statistics with intervals over plants.

use calib_stats::{Interval, cantelli_bound, jackknife, jackknife_error};

/// Minimum number of plants for an interval. Fewer plants tell too little about how plants differ.
pub const FEWEST_PLANTS: usize = 8;

/// The pairs of each plant.
#[derive(Clone, Debug)]
pub(crate) struct OverPlants {
    /// Numbers of the pairs, plant by plant.
    pairs: Vec<Vec<usize>>,
}

impl OverPlants {
    /// Groups pairs by plant; `plants` gives the plant of each pair.
    pub(crate) fn new<'a>(plants: impl Iterator<Item = &'a str>) -> Self {
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
        Self { pairs }
    }

    /// Returns the pairs of each plant for which `has` is true, without plants that have no such pair.
    pub(crate) fn each(&self, has: impl Fn(usize) -> bool) -> Vec<Vec<usize>> {
        self.pairs
            .iter()
            .map(|pairs| -> Vec<usize> {
                pairs.iter().copied().filter(|&pair| has(pair)).collect()
            })
            .filter(|pairs| !pairs.is_empty())
            .collect()
    }

    /// Returns the 95 % t-interval of `statistic`, a function of pair numbers, by the jackknife over plants.
    ///
    /// `None` for fewer than eight plants with such pairs, and where the statistic is not defined without one of them.
    /// Statistics should be symmetrically distributed: logarithms of ratios, not ratios.
    pub(crate) fn interval(
        &self,
        has: impl Fn(usize) -> bool,
        statistic: impl Fn(&[usize]) -> Option<f64>,
    ) -> Option<Interval> {
        let plants = self.each(has);
        jackknife(statistic(&plants.concat())?, &without_each(&plants, statistic)?)
    }

    /// Returns the 95 % interval of the typical regret exp(mean) − 1 from the `logarithm` of 1 + regret in each pair.
    /// Its lower end is that of Student's t. Its upper end is [`Self::upper_bound`], because the logarithms of small
    /// regrets are as skewed as the regrets.
    pub(crate) fn typical_interval(
        &self,
        has: impl Fn(usize) -> bool + Copy,
        logarithm: impl Fn(usize) -> f64 + Copy,
    ) -> Option<Interval> {
        let mean = |pairs: &[usize]| mean_of(pairs, logarithm);
        let low = self.interval(has, mean)?.low;
        let high = self.upper_bound(has, mean)?;
        Some(Interval { low: low.max(0.0).exp_m1(), high: high.exp_m1() })
    }

    /// Returns the 95 % upper bound of a skewed mean. `None` as for [`Self::interval`], and where plants do not differ.
    pub(crate) fn upper_bound(
        &self,
        has: impl Fn(usize) -> bool,
        mean: impl Fn(&[usize]) -> Option<f64>,
    ) -> Option<f64> {
        let plants = self.each(has);
        cantelli_bound(mean(&plants.concat())?, jackknife_error(&without_each(&plants, mean)?)?)
    }
}

/// Returns the statistic of all plants without each one in turn.
fn without_each(
    plants: &[Vec<usize>],
    statistic: impl Fn(&[usize]) -> Option<f64>,
) -> Option<Vec<f64>> {
    if plants.len() < FEWEST_PLANTS {
        return None;
    }
    (0..plants.len())
        .map(|left_out| {
            let others: Vec<Vec<usize>> = [&plants[..left_out], &plants[left_out + 1..]].concat();
            statistic(&others.concat())
        })
        .collect()
}

/// Returns the mean of `value` over `pairs`, or `None` without pairs.
pub(crate) fn mean_of(pairs: &[usize], value: impl Fn(usize) -> f64) -> Option<f64> {
    let sum: f64 = pairs.iter().map(|&pair| value(pair)).sum();
    (!pairs.is_empty()).then(|| sum / pairs.len() as f64)
}
