//! A race: values that are surely worse than the leader make no more runs, and none are made once one is left.

use std::collections::{BTreeMap, BTreeSet};

use calib_agent::Part;
use calib_stats::{Look, SequentialTest, StatsError, mean};

use crate::{EnvironmentId, SweepError, Unit, UnitResult, verdict::STREAMS_PER_INDEPENDENT};

/// Rounds of a race, and when a value is dropped: `sweep.race`.
///
/// Round r is the r-th rollout of every member and a share of the windows of the log. After each round the leader is the value that diverged
/// in the fewest streams so far, and of these has the smallest mean logarithm of the error over the others, and every other one that is left is compared with it by
/// [`SequentialTest`], on the differences ln error − ln error of the leader over the same streams and mini-batches. An observation is the mean
/// over three streams, because streams of one log are not independent; the test's error rate is `error_rate` / (values − 1), so that the
/// best value is dropped with a probability of at most `error_rate`. A value that diverged where the leader did not is dropped at once.
///
/// Sources: races of models (Maron & Moore 1997) with the test in the place of their bounds; what an observation is is our choice.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Race {
    rounds: usize,
    /// Windows of the log, which are dealt to the rounds.
    windows: usize,
    members: Vec<usize>,
    values: usize,
    part: Part,
    /// None where there are too few observations for any look.
    test: Option<SequentialTest>,
}

impl Race {
    /// Of `values` values in `rounds` rounds of these members and of so many windows of the log.
    ///
    /// # Errors
    /// An error rate that is not above 0 and at most 0.5.
    pub(crate) fn new(
        (members, rounds): (Vec<usize>, usize),
        windows: usize,
        values: usize,
        part: Part,
        error_rate: f64,
    ) -> Result<Self, SweepError> {
        if !(error_rate > 0.0 && error_rate <= 0.5) {
            return Err(SweepError::RaceErrorRate { got: error_rate });
        }
        let observations = (members.len() * rounds + windows) / STREAMS;
        let others = values.saturating_sub(1).max(1) as f64;
        let test = (3..=200).contains(&observations);
        let test =
            test.then(|| SequentialTest::new(observations, error_rate / others)).transpose()?;
        Ok(Self { rounds, windows, members, values, part, test })
    }

    /// The round in which a run is made; none for those that are made whatever happens.
    pub(crate) fn round(&self, environment: EnvironmentId, run: usize) -> Option<usize> {
        match environment {
            EnvironmentId::Member(_) => Some(run),
            EnvironmentId::LogReplay => Some(run * self.rounds / self.windows.max(1)),
            EnvironmentId::Online => None,
        }
    }

    /// The runs of a round, in a fixed order.
    fn streams(&self, round: usize) -> Vec<(EnvironmentId, usize)> {
        let members = self.members.iter().map(|&member| (EnvironmentId::Member(member), round));
        let windows = (0..self.windows).map(|window| (EnvironmentId::LogReplay, window));
        let windows = windows.filter(|&(log, run)| self.round(log, run) == Some(round));
        members.chain(windows).collect()
    }

    /// The values that are left after each round whose results are there, as far as there is more than one.
    ///
    /// # Errors
    /// If an error is NaN.
    pub(crate) fn survivors(
        &self,
        sensor: &str,
        results: &BTreeMap<Unit, UnitResult>,
    ) -> Result<Vec<BTreeSet<usize>>, StatsError> {
        let mut left: BTreeSet<usize> = (0..self.values).collect();
        let mut logs: Vec<Vec<f64>> = vec![Vec::new(); self.values];
        let mut after = Vec::new();
        for round in 0..self.rounds {
            if left.len() < 2 {
                break;
            }
            for (environment, run) in self.streams(round) {
                let unit = Unit { sensor: sensor.to_owned(), environment, run };
                let Some(result) = results.get(&unit) else { return Ok(after) };
                for row in &result.rows {
                    let rmse = row.rmse(self.part).unwrap_or(f64::INFINITY);
                    logs[row.candidate].push(rmse.ln());
                }
            }
            self.drop_worse(&mut left, &logs)?;
            after.push(left.clone());
        }
        Ok(after)
    }

    /// Leave those of `left` out that are worse than the leader.
    fn drop_worse(&self, left: &mut BTreeSet<usize>, logs: &[Vec<f64>]) -> Result<(), StatsError> {
        let leader = left.iter().copied().min_by(|&a, &b| {
            let (a, b) = (standing(&logs[a]), standing(&logs[b]));
            a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))
        });
        let Some(leader) = leader else { return Ok(()) };
        for value in left.clone() {
            if value != leader && self.is_worse(&logs[value], &logs[leader])? {
                left.remove(&value);
            }
        }
        Ok(())
    }

    fn is_worse(&self, own: &[f64], leader: &[f64]) -> Result<bool, StatsError> {
        let difference = |(own, leader): (&f64, &f64)| {
            // Where both diverged there is none; errors of 0 likewise.
            if own == leader { 0.0 } else { own - leader }
        };
        let differences: Vec<f64> = own.iter().zip(leader).map(difference).collect();
        // Where the leader diverged and this one did not, neither is surely worse.
        if differences.contains(&f64::NEG_INFINITY) {
            return Ok(false);
        }
        if differences.contains(&f64::INFINITY) {
            return Ok(true);
        }
        let Some(test) = &self.test else { return Ok(false) };
        let threes = differences.chunks_exact(STREAMS);
        let observations: Vec<f64> = threes.map(mean).collect::<Result<_, _>>()?;
        Ok(test.look(&observations)? == Look::Worse)
    }
}

/// How a value stands: in how many streams it diverged, and its mean logarithm in the others.
fn standing(logs: &[f64]) -> (usize, f64) {
    let finite: Vec<f64> = logs.iter().copied().filter(|log| *log < f64::INFINITY).collect();
    let mean = finite.iter().sum::<f64>() / finite.len().max(1) as f64;
    (logs.len() - finite.len(), mean)
}

/// What a race would have made of the results of a whole sweep of `values` values: those that are dropped are left out of the rows that
/// follow, and runs are once one value is left. What is saved, and whether the choice is another, can be read off.
///
/// # Errors
/// An error rate that is not above 0 and at most 0.5, or errors that are NaN.
pub fn raced(
    results: &[UnitResult],
    values: usize,
    part: Part,
    error_rate: f64,
) -> Result<Vec<UnitResult>, SweepError> {
    let by_unit: BTreeMap<Unit, UnitResult> =
        results.iter().map(|result| (result.unit.clone(), result.clone())).collect();
    let sensors: BTreeSet<&String> = results.iter().map(|result| &result.unit.sensor).collect();
    let (mut members, mut rounds, mut windows) = (BTreeSet::new(), 0, 0);
    for unit in by_unit.keys() {
        match unit.environment {
            EnvironmentId::Member(member) => {
                members.insert(member);
                rounds = rounds.max(unit.run + 1);
            }
            EnvironmentId::LogReplay => windows = windows.max(unit.run + 1),
            EnvironmentId::Online => {}
        }
    }
    let members = members.into_iter().collect();
    let race = Race::new((members, rounds), windows, values, part, error_rate)?;
    let left: BTreeMap<&String, Vec<BTreeSet<usize>>> = sensors
        .into_iter()
        .map(|sensor| Ok((sensor, race.survivors(sensor, &by_unit)?)))
        .collect::<Result<_, StatsError>>()?;
    let mut made = Vec::new();
    for result in results {
        let Unit { sensor, environment, run } = &result.unit;
        let Some(before) = race.round(*environment, *run).and_then(|of| of.checked_sub(1)) else {
            made.push(result.clone());
            continue;
        };
        let Some(survivors) = left[sensor].get(before).filter(|of| of.len() > 1) else { continue };
        let rows = result.rows.iter().filter(|row| survivors.contains(&row.candidate));
        made.push(UnitResult { rows: rows.cloned().collect(), ..result.clone() });
    }
    Ok(made)
}

/// Streams of one observation.
const STREAMS: usize = STREAMS_PER_INDEPENDENT as usize;

#[cfg(test)]
mod tests {
    use super::*;

    fn left(logs: &[Vec<f64>]) -> Vec<usize> {
        let race = Race::new((vec![0, 1], 6), 0, logs.len(), Part::WholeRun, 0.05).expect("valid");
        let mut left = (0..logs.len()).collect();
        race.drop_worse(&mut left, logs).expect("no NaN");
        left.into_iter().collect()
    }

    #[test]
    fn divergence_in_different_streams_decides_nothing() {
        let (inf, low) = (f64::INFINITY, f64::NEG_INFINITY);
        assert_eq!(left(&[vec![inf, 0.1, 0.1, 0.1], vec![0.1, inf, 0.1, 0.1]]), [0, 1]);
        assert_eq!(
            left(&[vec![inf, inf, 0.1], vec![0.1, 0.1, inf]]),
            [0, 1],
            "the leader diverged too"
        );
        assert_eq!(left(&[vec![inf, 0.1, 0.1], vec![9.0, 9.0, 9.0]]), [1], "and here it did not");
        // Errors of 0 beside a divergence.
        assert_eq!(left(&[vec![low, inf, 0.1], vec![0.1, 0.2, inf]]), [0, 1]);
    }
}
