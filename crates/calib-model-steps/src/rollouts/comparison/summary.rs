//! Means of distances over start states.

use std::collections::BTreeMap;

use calib_base::StepError;
use calib_core::Timestamp;
use calib_stats::{ClusterSummary, summarise_clusters};

use super::{
    facts::{Against, Comparison, MeasureSummary, PatternSummary, SensorComparison},
    measures::MEASURES,
    pair::{Distance, Pair},
};
use crate::STEP_PATTERNS;

/// Numbers of compared rollouts, and of those that were left out for each reason.
#[derive(Clone, Copy)]
pub(super) struct Counts {
    pub(super) rollouts: usize,
    pub(super) left_out: usize,
    pub(super) ended_early: usize,
}

/// Summarises the pairs of all sensors.
pub(super) fn summary(
    pairs: &[Pair],
    counts: Counts,
    against: Against,
) -> Result<Comparison, StepError> {
    let steps = pairs.iter().map(|pair| pair.steps as usize);
    let stretches = stretches(pairs);
    let sensors = sensors(pairs).into_iter().map(|name| {
        let own: Vec<&Pair> = pairs.iter().filter(|pair| pair.sensor == name).collect();
        of_sensor(name, &own)
    });
    Ok(Comparison {
        rollouts: counts.rollouts,
        start_states: stretches.len(),
        overlapping: overlapping(&stretches),
        left_out: counts.left_out,
        ended_early: counts.ended_early,
        fewest_steps: steps.clone().min().unwrap_or(0),
        most_steps: steps.max().unwrap_or(0),
        against,
        sensors: sensors.collect::<Result<_, StepError>>()?,
    })
}

/// Returns the sensors of the pairs, in their order.
fn sensors(pairs: &[Pair]) -> Vec<&str> {
    let mut names: Vec<&str> = Vec::new();
    for pair in pairs {
        if !names.contains(&pair.sensor.as_str()) {
            names.push(&pair.sensor);
        }
    }
    names
}

/// Returns the recorded stretch after each start state: its first row and its number of steps.
fn stretches(pairs: &[Pair]) -> Vec<(u32, u32)> {
    let starts: BTreeMap<Timestamp, (u32, u32)> =
        pairs.iter().map(|pair| (pair.start, (pair.wanted, pair.steps))).collect();
    starts.into_values().collect()
}

/// Returns the row after the last step of a stretch.
fn end((row, steps): (u32, u32)) -> u32 {
    row + steps
}

/// Returns how many of these stretches, in time order, share steps with another.
fn overlapping(stretches: &[(u32, u32)]) -> usize {
    let mut shares = vec![false; stretches.len()];
    // The earlier stretch that reaches farthest: the longest one need not be the last.
    let mut farthest: Option<usize> = None;
    for (place, &(row, steps)) in stretches.iter().enumerate() {
        match farthest {
            Some(before) if row < end(stretches[before]) => {
                shares[before] = true;
                shares[place] = true;
                if row + steps > end(stretches[before]) {
                    farthest = Some(place);
                }
            }
            _ => farthest = Some(place),
        }
    }
    shares.into_iter().filter(|&shares| shares).count()
}

fn of_sensor(name: &str, pairs: &[&Pair]) -> Result<SensorComparison, StepError> {
    let dtw = (STEP_PATTERNS.iter().enumerate())
        .filter_map(|(place, pattern)| of_pattern(pairs, place, pattern).transpose());
    let measures = MEASURES.iter().enumerate().map(|(place, measure)| {
        let value = of_distance(pairs, Distance::Measure(place))?;
        Ok(MeasureSummary { measure: measure.column.to_owned(), value })
    });
    Ok(SensorComparison {
        sensor: name.to_owned(),
        dtw: dtw.collect::<Result<_, StepError>>()?,
        measures: measures.collect::<Result<_, StepError>>()?,
    })
}

/// Summarises the step pattern at `place`; `None` if its distance is defined for no pair.
fn of_pattern(
    pairs: &[&Pair],
    place: usize,
    pattern: &str,
) -> Result<Option<PatternSummary>, StepError> {
    let Some(distance) = of_distance(pairs, Distance::Raw(place))? else { return Ok(None) };
    let normalized_distance = of_distance(pairs, Distance::Normalised(place))?;
    let step_pattern = pattern.to_owned();
    Ok(Some(PatternSummary { step_pattern, distance, normalized_distance }))
}

/// Summarises a distance over the start states of the pairs for which it is defined; `None` without such
/// pairs.
fn of_distance(pairs: &[&Pair], distance: Distance) -> Result<Option<ClusterSummary>, StepError> {
    let known = pairs.iter().filter_map(|pair| Some((pair.start, distance.of(pair)?)));
    let (starts, values): (Vec<Timestamp>, Vec<f64>) = known.unzip();
    if values.is_empty() {
        return Ok(None);
    }
    Ok(Some(summarise_clusters(&starts, &values)?))
}

/// Pools comparisons as if all rollouts had been compared at once; `None` without comparisons.
///
/// # Errors
/// If an interval cannot be computed.
pub fn pool(all: &[(&Comparison, &[Pair])]) -> Result<Option<(Comparison, Vec<Pair>)>, StepError> {
    let Some((first, _)) = all.iter().find(|(own, _)| !own.sensors.is_empty()) else {
        return Ok(None);
    };
    let counts = Counts {
        rollouts: sum(all, |own| own.rollouts),
        left_out: sum(all, |own| own.left_out),
        ended_early: sum(all, |own| own.ended_early),
    };
    let pairs: Vec<Pair> = all.iter().flat_map(|(_, pairs)| pairs.iter().cloned()).collect();
    let whole = summary(&pairs, counts, first.against)?;
    // Rows of each deployment are counted from its own beginning.
    let overlapping = sum(all, |own| own.overlapping);
    Ok(Some((Comparison { overlapping, ..whole }, pairs)))
}

/// Sums one number of all comparisons.
fn sum(all: &[(&Comparison, &[Pair])], part: fn(&Comparison) -> usize) -> usize {
    all.iter().map(|(comparison, _)| part(comparison)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rollouts::comparison::pair::tests::pair;

    fn summarised(pairs: &[Pair]) -> Comparison {
        let counts = Counts { rollouts: pairs.len(), left_out: 0, ended_early: 0 };
        summary(pairs, counts, Against::Model).expect("valid")
    }

    #[test]
    fn members_of_a_start_are_one_observation() {
        let pairs = [pair(0, 5, 1.0), pair(1, 5, 3.0), pair(0, 90, 4.0), pair(1, 90, 6.0)];
        let told = summarised(&pairs);
        assert_eq!((told.rollouts, told.start_states, told.overlapping), (4, 2, 0));
        let warping = told.sensors[0].dtw[0].distance;
        assert_eq!((warping.runs, warping.clusters, warping.mean), (4, 2, 3.5));
        assert!(warping.interval.is_some());
        let one = summarised(&pairs[..2]);
        assert_eq!(one.sensors[0].dtw[0].distance.interval, None, "one start says nothing");
        let none = summarised(&[]);
        assert!(none.sensors.is_empty() && none.start_states == 0);
    }

    #[test]
    fn what_is_not_defined_does_not_count() {
        let mut pairs = [pair(0, 5, 1.0), pair(1, 5, 3.0), pair(0, 90, 4.0)];
        pairs[1].measures = vec![None; MEASURES.len()];
        let told = summarised(&pairs);
        let measure = told.sensors[0].measures[0].value.expect("two are");
        assert_eq!((measure.runs, measure.clusters), (2, 2));
        for pair in &mut pairs {
            pair.measures = vec![None; MEASURES.len()];
        }
        assert!(summarised(&pairs).sensors[0].measures[0].value.is_none());
    }

    #[test]
    fn stretches_that_share_steps_are_counted() {
        // Ten steps each: rows 5 to 15, 14 to 24, 24 to 34. The last begins where the second ends.
        assert_eq!(overlapping(&[(5, 10), (14, 10), (24, 10)]), 2);
        // One stretch is inside a longer one, which also overlaps the next.
        assert_eq!(overlapping(&[(0, 100), (5, 10), (50, 10), (100, 10)]), 3);
        assert_eq!(overlapping(&[]), 0);
    }
}
