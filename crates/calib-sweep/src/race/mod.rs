//! A race by successive halving: the worse half of the settings makes no more runs, until one setting is left.

mod rounds;

use std::collections::{BTreeMap, BTreeSet};

use calib_agent::Part;

pub(crate) use rounds::RacedStreams;

use self::rounds::Rounds;
use crate::{EnvironmentId, Unit, UnitResult};

/// A race among the settings of a sweep, as [`Plan::race`](crate::Plan::race) describes it.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Race {
    rounds: Rounds,
    values: usize,
    part: Part,
}

impl Race {
    /// Creates a race of `values` settings on these streams.
    pub(crate) fn new(streams: &RacedStreams, values: usize, part: Part) -> Self {
        Self { rounds: streams.rounds(values), values, part }
    }

    /// Returns the round of a run, or `None` for runs that are always made.
    pub(crate) fn round(&self, environment: EnvironmentId, run: usize) -> Option<usize> {
        self.rounds.round_of((environment, run))
    }

    /// Returns the settings that are left after each round with complete results, as long as more than one is left.
    pub(crate) fn survivors(
        &self,
        sensor: &str,
        results: &BTreeMap<Unit, UnitResult>,
    ) -> Vec<BTreeSet<usize>> {
        let mut left: BTreeSet<usize> = (0..self.values).collect();
        let mut logs: Vec<Vec<f64>> = vec![Vec::new(); self.values];
        let mut after = Vec::new();
        for round in self.rounds.numbers() {
            if left.len() < 2 {
                break;
            }
            for &(environment, run) in self.rounds.runs(round) {
                let unit = Unit { sensor: sensor.to_owned(), environment, run };
                let Some(result) = results.get(&unit) else { return after };
                for row in &result.rows {
                    let rmse = row.rmse(self.part).unwrap_or(f64::INFINITY);
                    logs[row.candidate].push(rmse.ln());
                }
            }
            left = best(left, &logs, self.values.div_ceil(2 << round));
            after.push(left.clone());
        }
        after
    }
}

/// Returns the `most` best settings of `left`.
fn best(left: BTreeSet<usize>, logs: &[Vec<f64>], most: usize) -> BTreeSet<usize> {
    let mut ordered: Vec<usize> = left.into_iter().collect();
    ordered.sort_by(|&a, &b| {
        let a = standing(&logs[a]);
        let b = standing(&logs[b]);
        a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))
    });
    ordered.into_iter().take(most).collect()
}

/// Returns the ranking of a setting: the number of streams in which it diverged, and its mean logarithm of the error in
/// the others.
pub(crate) fn standing(logs: &[f64]) -> (usize, f64) {
    let finite: Vec<f64> = logs.iter().copied().filter(|log| *log < f64::INFINITY).collect();
    let mean = finite.iter().sum::<f64>() / finite.len().max(1) as f64;
    (logs.len() - finite.len(), mean)
}

/// Applies a race to the results of a complete sweep of `values` settings. Rows of dropped settings are removed, and so
/// are runs after one setting is left. This shows what a race saves, and whether it changes the choice.
pub fn raced(results: &[UnitResult], values: usize, part: Part) -> Vec<UnitResult> {
    let by_unit: BTreeMap<Unit, UnitResult> =
        results.iter().map(|result| (result.unit.clone(), result.clone())).collect();
    let sensors: BTreeSet<&String> = results.iter().map(|result| &result.unit.sensor).collect();
    let mut members = BTreeSet::new();
    let mut runs = 0;
    let mut windows = 0;
    for unit in by_unit.keys() {
        match unit.environment {
            EnvironmentId::Member(member) => {
                members.insert(member);
                runs = runs.max(unit.run + 1);
            }
            EnvironmentId::LogReplay => windows = windows.max(unit.run + 1),
            EnvironmentId::Online => {}
        }
    }
    let streams = RacedStreams { members: members.into_iter().collect(), runs, windows };
    let race = Race::new(&streams, values, part);
    let left: BTreeMap<&String, Vec<BTreeSet<usize>>> =
        sensors.into_iter().map(|sensor| (sensor, race.survivors(sensor, &by_unit))).collect();
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
    made
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_better_half_is_kept() {
        let inf = f64::INFINITY;
        let logs = [vec![0.3, 0.3], vec![0.1, inf], vec![0.1, 0.2], vec![inf, inf], vec![0.2, 0.3]];
        for (most, expected) in [(3, vec![0, 2, 4]), (2, vec![2, 4]), (1, vec![2])] {
            let kept = Vec::from_iter(best((0..logs.len()).collect(), &logs, most));
            assert_eq!(kept, expected, "of at most {most}");
        }
        let kept = Vec::from_iter(best((0..logs.len()).collect(), &logs, 4));
        assert_eq!(kept, [0, 1, 2, 4], "who diverged less often is better");
    }
}
