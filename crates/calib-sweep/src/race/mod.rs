//! A race: values that are behind make no more runs, and none are made once one is left.

mod rounds;

use std::collections::{BTreeMap, BTreeSet};

use calib_agent::Part;
use calib_stats::{Look, SequentialTest, StatsError, mean};

pub(crate) use rounds::Streams;

use self::rounds::Rounds;
use crate::{EnvironmentId, SweepError, Unit, UnitResult, verdict::STREAMS_PER_INDEPENDENT};

/// When a value makes no more runs. What leads is the value that diverged in the fewest streams so far, and of these has the smallest mean
/// logarithm of the error over the others.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RaceRule {
    /// When it is surely worse than the leader.
    ///
    /// Round r is the r-th run of every member and a share of the windows of the log. After each round every value that is left is compared
    /// with the leader by [`SequentialTest`], on the differences ln error − ln error of the leader over the same streams and mini-batches.
    /// An observation is the mean over three streams, because streams of one log are not independent; the test's error rate is
    /// `error_rate` / (values − 1), so that the best value is dropped with a probability of at most `error_rate`. A value that diverged where
    /// the leader did not is dropped at once.
    ///
    /// Sources: races of models (Maron & Moore 1997) with the test in the place of their bounds; what an observation is is our choice.
    Surely {
        /// Probability with which the best value is dropped, at most.
        error_rate: f64,
    },
    /// When half of the others are better: V values, then ⌈V/2⌉, ⌈V/4⌉, … after 2, 4, 8, … streams of 2^⌈log₂ V⌉, so that about half of
    /// all streams are ever seen, by few values. Streams come in turn from members and log, as many as there are of each.
    ///
    /// Source: successive halving (Karnin, Koren & Somekh 2013; Jamieson & Talwalkar 2016), with streams as its resource.
    Halving,
}

/// A race among the values of a sweep.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Race {
    rounds: Rounds,
    values: usize,
    part: Part,
    drop: DropRule,
}

/// Who is dropped after a round.
#[derive(Clone, Debug, PartialEq)]
enum DropRule {
    /// None where there are too few observations for any look.
    Worse(Option<SequentialTest>),
    Half,
}

impl Race {
    /// Of `values` values on these streams.
    ///
    /// # Errors
    /// An error rate that is not above 0 and at most 0.5.
    pub(crate) fn new(
        streams: &Streams,
        values: usize,
        part: Part,
        rule: RaceRule,
    ) -> Result<Self, SweepError> {
        let (rounds, drop) = match rule {
            RaceRule::Surely { error_rate } => {
                let test = surely(streams.count() / STREAMS, values, error_rate)?;
                (streams.run_by_run(), DropRule::Worse(test))
            }
            RaceRule::Halving => (streams.doubling(values), DropRule::Half),
        };
        Ok(Self { rounds, values, part, drop })
    }

    /// The round in which a run is made; none for those that are made whatever happens.
    pub(crate) fn round(&self, environment: EnvironmentId, run: usize) -> Option<usize> {
        self.rounds.of((environment, run))
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
        for round in self.rounds.numbers() {
            if left.len() < 2 {
                break;
            }
            for &(environment, run) in self.rounds.runs(round) {
                let unit = Unit { sensor: sensor.to_owned(), environment, run };
                let Some(result) = results.get(&unit) else { return Ok(after) };
                for row in &result.rows {
                    let rmse = row.rmse(self.part).unwrap_or(f64::INFINITY);
                    logs[row.candidate].push(rmse.ln());
                }
            }
            match &self.drop {
                DropRule::Worse(test) => drop_worse(&mut left, &logs, test.as_ref())?,
                DropRule::Half => keep_best(&mut left, &logs, self.values.div_ceil(2 << round)),
            }
            after.push(left.clone());
        }
        Ok(after)
    }
}

/// The test of a race by certainty.
fn surely(
    observations: usize,
    values: usize,
    error_rate: f64,
) -> Result<Option<SequentialTest>, SweepError> {
    if !(error_rate > 0.0 && error_rate <= 0.5) {
        return Err(SweepError::RaceErrorRate { got: error_rate });
    }
    let others = values.saturating_sub(1).max(1) as f64;
    let test = (3..=200).contains(&observations);
    Ok(test.then(|| SequentialTest::new(observations, error_rate / others)).transpose()?)
}

/// Those of `left`, the leader first.
fn by_standing(left: &BTreeSet<usize>, logs: &[Vec<f64>]) -> Vec<usize> {
    let mut ordered: Vec<usize> = left.iter().copied().collect();
    ordered.sort_by(|&a, &b| {
        let a = standing(&logs[a]);
        let b = standing(&logs[b]);
        a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))
    });
    ordered
}

/// Leave all but the `most` best of `left` out.
fn keep_best(left: &mut BTreeSet<usize>, logs: &[Vec<f64>], most: usize) {
    *left = by_standing(left, logs).into_iter().take(most).collect();
}

/// Leave those of `left` out that are worse than the leader.
fn drop_worse(
    left: &mut BTreeSet<usize>,
    logs: &[Vec<f64>],
    test: Option<&SequentialTest>,
) -> Result<(), StatsError> {
    let ordered = by_standing(left, logs);
    let Some((&leader, others)) = ordered.split_first() else { return Ok(()) };
    for &value in others {
        if is_worse(&logs[value], &logs[leader], test)? {
            left.remove(&value);
        }
    }
    Ok(())
}

fn is_worse(
    own: &[f64],
    leader: &[f64],
    test: Option<&SequentialTest>,
) -> Result<bool, StatsError> {
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
    let Some(test) = test else { return Ok(false) };
    let threes = differences.chunks_exact(STREAMS);
    let observations: Vec<f64> = threes.map(mean).collect::<Result<_, _>>()?;
    Ok(test.look(&observations)? == Look::Worse)
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
    rule: RaceRule,
) -> Result<Vec<UnitResult>, SweepError> {
    let by_unit: BTreeMap<Unit, UnitResult> =
        results.iter().map(|result| (result.unit.clone(), result.clone())).collect();
    let sensors: BTreeSet<&String> = results.iter().map(|result| &result.unit.sensor).collect();
    let mut members = BTreeSet::new();
    let mut rounds = 0;
    let mut windows = 0;
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
    let streams = Streams::new(members.into_iter().collect(), rounds, windows);
    let race = Race::new(&streams, values, part, rule)?;
    let left: BTreeMap<&String, Vec<BTreeSet<usize>>> = sensors
        .into_iter()
        .map(|sensor| Ok((sensor, race.survivors(sensor, &by_unit)?)))
        .collect::<Result<_, StatsError>>()?;
    let mut made = Vec::new();
    for result in results {
        let Unit { sensor, environment, run } = &result.unit;
        let Some(before) = race.round(*environment, *run).and_then(|round| round.checked_sub(1))
        else {
            made.push(result.clone());
            continue;
        };
        let Some(survivors) = left[sensor].get(before).filter(|survivors| survivors.len() > 1)
        else {
            continue;
        };
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
        let test = surely(4, logs.len(), 0.05).expect("valid");
        let mut left = (0..logs.len()).collect();
        drop_worse(&mut left, logs, test.as_ref()).expect("no NaN");
        left.into_iter().collect()
    }

    #[test]
    fn the_better_half_is_kept() {
        let inf = f64::INFINITY;
        let logs = [vec![0.3, 0.3], vec![0.1, inf], vec![0.1, 0.2], vec![inf, inf], vec![0.2, 0.3]];
        let keep = |most: usize| {
            let mut left = (0..logs.len()).collect();
            keep_best(&mut left, &logs, most);
            left.into_iter().collect::<Vec<usize>>()
        };
        assert_eq!((keep(3), keep(2), keep(1)), (vec![0, 2, 4], vec![2, 4], vec![2]));
        assert_eq!(keep(4), [0, 1, 2, 4], "who diverged less often is better");
    }

    #[test]
    fn divergence_in_different_streams_decides_nothing() {
        let inf = f64::INFINITY;
        let low = f64::NEG_INFINITY;
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
