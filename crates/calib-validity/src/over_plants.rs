//! Statistics with intervals over plants.

use calib_stats::{Interval, cantelli_bound, jackknife, jackknife_error};

/// Fewer plants say too little of how plants differ: there are no intervals over them.
pub const FEWEST_PLANTS: usize = 8;

/// The pairs of each plant.
#[derive(Clone, Debug)]
pub(crate) struct OverPlants {
    /// Numbers of the pairs, plant by plant.
    pairs: Vec<Vec<usize>>,
}

impl OverPlants {
    /// `plants` is the plant of each pair.
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

    /// The pairs of each plant for which `has` holds, without plants that have none.
    pub(crate) fn each(&self, has: impl Fn(usize) -> bool) -> Vec<Vec<usize>> {
        self.pairs
            .iter()
            .map(|pairs| -> Vec<usize> {
                pairs.iter().copied().filter(|&pair| has(pair)).collect()
            })
            .filter(|pairs| !pairs.is_empty())
            .collect()
    }

    /// 95 % t-interval of `statistic`, which is given numbers of pairs, by the jackknife over plants.
    ///
    /// None for fewer than eight plants that have something to say, and where the statistic is not defined without one of them.
    /// Statistics should be symmetrically distributed: logarithms of quotients, not quotients.
    pub(crate) fn interval(
        &self,
        has: impl Fn(usize) -> bool,
        statistic: impl Fn(&[usize]) -> Option<f64>,
    ) -> Option<Interval> {
        let plants = self.each(has);
        jackknife(statistic(&plants.concat())?, &without_each(&plants, statistic)?)
    }

    /// 95 % interval of the typical regret exp(mean) − 1 from the `logarithm` of 1 + regret in each pair: its lower end is that of Student's t,
    /// its upper end [`Self::upper_bound`], because the logarithms of small regrets are as skewed as they are.
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

    /// 95 % upper bound of a mean that is skewed; none as for [`Self::interval`], and where plants do not differ.
    pub(crate) fn upper_bound(
        &self,
        has: impl Fn(usize) -> bool,
        mean: impl Fn(&[usize]) -> Option<f64>,
    ) -> Option<f64> {
        let plants = self.each(has);
        cantelli_bound(mean(&plants.concat())?, jackknife_error(&without_each(&plants, mean)?)?)
    }
}

/// The statistic of all plants but each.
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

/// The mean of `value` over `pairs`; `None` for none.
pub(crate) fn mean_of(pairs: &[usize], value: impl Fn(usize) -> f64) -> Option<f64> {
    let sum: f64 = pairs.iter().map(|&pair| value(pair)).sum();
    (!pairs.is_empty()).then(|| sum / pairs.len() as f64)
}
