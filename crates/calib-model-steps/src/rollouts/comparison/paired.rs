//! Compares the distances of two models, start state by start state.

use std::collections::{BTreeMap, BTreeSet};

use calib_base::StepError;
use calib_core::Timestamp;
use calib_stats::{
    ClusterSummary, Difference, cluster_means, paired_difference, unpaired_difference,
};
use schemars::JsonSchema;
use serde::Serialize;

use super::{
    Comparison, MEASURES,
    pair::{Distance, Pair},
};
use crate::{STEP_PATTERNS, rollouts::every_two};

/// A start state and the number of steps compared from it on. It is the same stretch in two models if both are
/// equal.
type Stretch = (Timestamp, u32);

/// A model whose rollouts were compared with the record.
pub struct ComparedModel<'a> {
    pub(crate) name: &'a str,
    pub(crate) comparison: &'a Comparison,
    /// Number of ensemble members.
    pub(crate) members: usize,
    pairs: BTreeMap<&'a str, Vec<&'a Pair>>,
}

/// Two models compared, in the summary of several models.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub struct PairedModels {
    pub(crate) models: [String; 2],
    pub(crate) sensors: Vec<PairedSensor>,
}

/// Distances of the first model minus those of the second, on one sensor.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub(crate) struct PairedSensor {
    pub(crate) sensor: String,
    pub(crate) dtw: Vec<PairedPattern>,
    pub(crate) measures: Vec<PairedMeasure>,
}

/// Dynamic time warping with one step pattern.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub(crate) struct PairedPattern {
    pub(crate) step_pattern: &'static str,
    pub(crate) distance: Option<Difference>,
    pub(crate) normalized_distance: Option<Difference>,
}

/// Differences by another measure.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub(crate) struct PairedMeasure {
    pub(crate) measure: &'static str,
    pub(crate) value: Option<Difference>,
}

impl<'a> ComparedModel<'a> {
    /// Returns the model `name` with `members` members, its comparison, and the pairs of that comparison.
    pub fn new(
        name: &'a str,
        members: usize,
        comparison: &'a Comparison,
        pairs: &'a [Pair],
    ) -> Self {
        let mut of_sensors: BTreeMap<&str, Vec<&Pair>> = BTreeMap::new();
        for pair in pairs {
            of_sensors.entry(&pair.sensor).or_default().push(pair);
        }
        Self { name, comparison, members, pairs: of_sensors }
    }

    /// Returns the mean of a distance.
    pub(super) fn summary(&self, sensor: &str, distance: Distance) -> Option<&'a ClusterSummary> {
        let own = self.comparison.sensors.iter().find(|compared| compared.sensor == sensor)?;
        match distance {
            Distance::Raw(place) => Some(&own.dtw.get(place)?.distance),
            Distance::Normalised(place) => own.dtw.get(place)?.normalized_distance.as_ref(),
            Distance::Measure(place) => own.measures.get(place)?.value.as_ref(),
        }
    }

    /// Returns its distance minus that of `other`. `None` if one has no distance, or they are compared with
    /// different records.
    pub(super) fn minus(
        &self,
        other: &Self,
        sensor: &str,
        distance: Distance,
    ) -> Result<Option<Difference>, StepError> {
        let own = self.known(sensor, distance);
        let others = other.known(sensor, distance);
        if own.is_empty() || others.is_empty() || !self.is_held_to_the_record_of(other) {
            return Ok(None);
        }
        let members = self.members > 1 && self.members == other.members;
        difference(&own, &others, members).map(Some)
    }

    /// Whether both are compared with a record from the same place.
    pub(super) fn is_held_to_the_record_of(&self, other: &Self) -> bool {
        let are_known = [self, other].iter().all(|model| !model.comparison.sensors.is_empty());
        !are_known || self.comparison.against == other.comparison.against
    }

    /// Returns the pairs of a sensor for which the distance is defined.
    fn known(&self, sensor: &str, distance: Distance) -> Vec<(&'a Pair, f64)> {
        let own = self.pairs.get(sensor).into_iter().flatten();
        own.filter_map(|pair| Some((*pair, distance.of(pair)?))).collect()
    }
}

/// Compares every two of the models that are compared with the same record.
///
/// # Errors
/// If an interval cannot be computed.
pub fn all_pairs(models: &[ComparedModel<'_>]) -> Result<Vec<PairedModels>, StepError> {
    let mut all = Vec::new();
    for (one, other) in every_two(models) {
        all.extend(two(one, other)?);
    }
    Ok(all)
}

fn two(
    one: &ComparedModel<'_>,
    other: &ComparedModel<'_>,
) -> Result<Option<PairedModels>, StepError> {
    let shared = one.comparison.sensors.iter().map(|compared| compared.sensor.as_str());
    let shared = shared.filter(|sensor| other.pairs.contains_key(sensor));
    let sensors: Vec<PairedSensor> =
        shared.map(|sensor| of_sensor(one, other, sensor)).collect::<Result<_, StepError>>()?;
    if sensors.is_empty() || !one.is_held_to_the_record_of(other) {
        return Ok(None);
    }
    Ok(Some(PairedModels { models: [one, other].map(|model| model.name.to_owned()), sensors }))
}

fn of_sensor(
    one: &ComparedModel<'_>,
    other: &ComparedModel<'_>,
    sensor: &str,
) -> Result<PairedSensor, StepError> {
    let dtw = STEP_PATTERNS.iter().enumerate().map(|(place, step_pattern)| {
        let distance = one.minus(other, sensor, Distance::Raw(place))?;
        let normalized_distance = one.minus(other, sensor, Distance::Normalised(place))?;
        Ok(PairedPattern { step_pattern, distance, normalized_distance })
    });
    let measures = MEASURES.iter().enumerate().map(|(place, measure)| {
        let value = one.minus(other, sensor, Distance::Measure(place))?;
        Ok(PairedMeasure { measure: measure.column, value })
    });
    Ok(PairedSensor {
        sensor: sensor.to_owned(),
        dtw: dtw.collect::<Result<_, StepError>>()?,
        measures: measures.collect::<Result<_, StepError>>()?,
    })
}

/// Returns the difference, paired by stretch if at least half of the start states of one model are also the
/// other's. Otherwise the two are independent samples, as with random start states of different models, a few of
/// which may coincide.
fn difference(
    own: &[(&Pair, f64)],
    others: &[(&Pair, f64)],
    members: bool,
) -> Result<Difference, StepError> {
    let all = stretches(own);
    let all_others = stretches(others);
    let shared: Vec<&Stretch> = all.intersection(&all_others).collect();
    if shared.is_empty() || 2 * shared.len() < all.len().min(all_others.len()) {
        let (x_starts, x) = sample(own);
        let (y_starts, y) = sample(others);
        return Ok(unpaired_difference((&x_starts, &x), (&y_starts, &y))?);
    }
    let mut starts = Vec::new();
    let mut x = Vec::new();
    let mut y = Vec::new();
    let means = (means(own)?, means(others)?);
    let own = by_rollout(own);
    let others = by_rollout(others);
    for stretch in shared {
        let same = own.range((*stretch, 0, 0)..=(*stretch, u32::MAX, u32::MAX));
        let matched = same.filter_map(|(key, x)| Some((*x, *others.get(key)?)));
        let mut matched: Vec<(f64, f64)> = matched.filter(|_| members).collect();
        if matched.is_empty() {
            matched.push((means.0[stretch], means.1[stretch]));
        }
        for (own, other) in matched {
            starts.push(stretch);
            x.push(own);
            y.push(other);
        }
    }
    Ok(paired_difference(&starts, &x, &y)?)
}

fn stretch(pair: &Pair) -> Stretch {
    (pair.start, pair.steps)
}

fn stretches(pairs: &[(&Pair, f64)]) -> BTreeSet<Stretch> {
    pairs.iter().map(|(pair, _)| stretch(pair)).collect()
}

/// Returns the values, and the start state of each.
fn sample(pairs: &[(&Pair, f64)]) -> (Vec<Timestamp>, Vec<f64>) {
    pairs.iter().map(|(pair, value)| (pair.start, *value)).unzip()
}

/// Returns the value of each rollout, by its stretch, its member and its number.
fn by_rollout(pairs: &[(&Pair, f64)]) -> BTreeMap<(Stretch, u32, u32), f64> {
    pairs.iter().map(|(pair, value)| ((stretch(pair), pair.member, pair.rollout), *value)).collect()
}

/// Returns means over the rollouts of each stretch.
fn means(pairs: &[(&Pair, f64)]) -> Result<BTreeMap<Stretch, f64>, StepError> {
    let (stretches, values): (Vec<Stretch>, Vec<f64>) =
        pairs.iter().map(|(pair, value)| (stretch(pair), *value)).unzip();
    Ok(cluster_means(&stretches, &values)?
        .into_iter()
        .map(|(stretch, mean)| (*stretch, mean))
        .collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rollouts::comparison::{
        Against,
        pair::tests::pair,
        summary::{Counts, summary},
    };

    fn comparison(pairs: &[Pair], against: Against) -> Comparison {
        let counts = Counts { rollouts: pairs.len(), left_out: 0, ended_early: 0 };
        summary(pairs, counts, against).expect("valid")
    }

    /// Returns the first model's distance minus the second's, each given with its number of members.
    fn minus(one: (usize, &[Pair]), other: (usize, &[Pair])) -> Difference {
        let first = comparison(one.1, Against::Model);
        let second = comparison(other.1, Against::Model);
        let one = ComparedModel::new("one", one.0, &first, one.1);
        let other = ComparedModel::new("other", other.0, &second, other.1);
        one.minus(&other, "PIT300", Distance::Raw(0)).expect("valid").expect("defined")
    }

    #[test]
    fn members_are_paired_with_the_same_member() {
        // Member 1 of the second model lacks the second start state, so only member 0 counts there.
        let one = [pair(0, 5, 1.0), pair(1, 5, 5.0), pair(0, 90, 2.0), pair(1, 90, 60.0)];
        let other = [pair(0, 5, 2.0), pair(1, 5, 7.0), pair(0, 90, 6.0)];
        let difference = minus((2, &one), (2, &other));
        assert_eq!(
            (difference.mean, difference.clusters, difference.smaller),
            (-2.75, [2, 2], Some([2, 0]))
        );
        // Models with different numbers of members leave out different blocks, so means over members are compared:
        // (3 - 4.5) and (31 - 6).
        let difference = minus((2, &one), (3, &other));
        assert_eq!((difference.mean, difference.smaller), (11.75, Some([1, 1])));
    }

    #[test]
    fn a_network_is_compared_with_the_mean_of_an_ensemble() {
        let ensemble = [pair(0, 5, 1.0), pair(1, 5, 3.0), pair(0, 90, 4.0), pair(1, 90, 6.0)];
        let network = [pair(0, 5, 3.0), pair(0, 90, 3.0), pair(0, 150, 9.0)];
        let difference = minus((2, &ensemble), (1, &network));
        assert_eq!(
            (difference.mean, difference.clusters, difference.smaller),
            (0.5, [2, 2], Some([1, 1]))
        );
    }

    #[test]
    fn models_that_share_hardly_any_start_are_independent_samples() {
        let one: Vec<Pair> = [1, 20, 40, 60].map(|row| pair(0, row, f64::from(row))).to_vec();
        let other: Vec<Pair> = [1, 25, 45, 65].map(|row| pair(0, row, f64::from(row))).to_vec();
        let difference = minus((1, &one), (1, &other));
        assert_eq!((difference.smaller, difference.clusters), (None, [4, 4]));
        assert!(difference.interval.is_some());
        // Another number of steps is another stretch.
        let shorter: Vec<Pair> = one.iter().map(|pair| Pair { steps: 9, ..pair.clone() }).collect();
        assert_eq!(minus((1, &one), (1, &shorter)).smaller, None);
    }

    #[test]
    fn models_held_to_different_records_are_not_compared() {
        let pairs = [pair(0, 5, 1.0), pair(0, 90, 4.0)];
        let first = comparison(&pairs, Against::Model);
        let second = comparison(&pairs, Against::Deployment);
        let empty = comparison(&[], Against::Model);
        let models = [
            ComparedModel::new("a", 1, &first, &pairs),
            ComparedModel::new("b", 1, &second, &pairs),
            ComparedModel::new("c", 1, &first, &pairs),
            ComparedModel::new("d", 1, &empty, &[]),
        ];
        let all = all_pairs(&models).expect("valid");
        let named: Vec<&[String; 2]> = all.iter().map(|paired| &paired.models).collect();
        assert_eq!(named, [&["a".to_owned(), "c".to_owned()]]);
        let difference = all[0].sensors[0].measures[0].value.expect("defined");
        assert_eq!((difference.mean, difference.smaller), (0.0, Some([0, 0])));
    }
}
