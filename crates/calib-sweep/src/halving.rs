//! Successive halving over runs.

use std::collections::{BTreeMap, BTreeSet};

use calib_agent::Part;
use serde::{Deserialize, Serialize};

use crate::{EnvironmentId, SweepError, Unit, UnitResult};

/// Drop hopeless values early: the `[sweep.halving]` section.
///
/// A rung is a number of runs. When every member has made that many, the `keep` share of the values with the
/// lowest mean error goes on to the runs that follow, and the others are dropped, but for the default. The error is the mean over
/// members of the mean RMSE over the runs made so far, infinite if any diverged; of equal ones the earlier value
/// goes on.
///
/// Rungs count runs and not steps, because which learning rate is best depends on how long one learns: a run cut
/// short would judge another question. Each run that is made is made in full.
///
/// Source: Jamieson & Talwalkar 2016, with runs as the resource (our choice).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct HalvingConfig {
    /// Share of the values that go on, above 0 and below 1 (default 0.5), rounded up.
    pub keep: f64,
    /// Runs of every member after which values are dropped, increasing and fewer than `member_runs`
    /// (default, and if empty: 1, 2, 4, 8, …).
    pub rungs: Vec<usize>,
}

impl Default for HalvingConfig {
    fn default() -> Self {
        Self { keep: 0.5, rungs: Vec::new() }
    }
}

impl HalvingConfig {
    /// The rungs of a sweep of `member_runs` runs.
    ///
    /// # Errors
    /// If the share or a rung is outside its range.
    pub fn rungs(&self, member_runs: usize) -> Result<Vec<usize>, SweepError> {
        let refuse = |reason: String| Err(SweepError::Halving { reason });
        if !(self.keep > 0.0 && self.keep < 1.0) {
            return refuse(format!("keep must be above 0 and below 1, got {}", self.keep));
        }
        let rungs = if self.rungs.is_empty() {
            std::iter::successors(Some(1), |rung| Some(2 * rung))
                .take_while(|&rung| rung < member_runs)
                .collect()
        } else {
            self.rungs.clone()
        };
        let increasing = rungs.is_sorted_by(|a, b| a < b);
        let inside = rungs.iter().all(|rung| (1..member_runs).contains(rung));
        if rungs.is_empty() || !increasing || !inside {
            return refuse(format!(
                "rungs must be increasing numbers of runs from 1 to {}, one less than sweep.member_runs, got {rungs:?}",
                member_runs.saturating_sub(1)
            ));
        }
        Ok(rungs)
    }
}

/// When values are dropped, and how many go on.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Halving {
    pub(crate) keep: f64,
    pub(crate) rungs: Vec<usize>,
}

/// The values that went on from each rung that has been decided, for each sensor.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Survivors(BTreeMap<String, Vec<BTreeSet<usize>>>);

impl Survivors {
    /// Rungs that have been decided for `sensor`.
    pub(crate) fn decided(&self, sensor: &str) -> usize {
        self.0.get(sensor).map_or(0, Vec::len)
    }

    /// Whether `candidate` is still there after `rungs` decided rungs.
    pub(crate) fn contains(&self, sensor: &str, rungs: usize, candidate: usize) -> bool {
        let after = |rung: usize| &self.0[sensor][rung];
        rungs.checked_sub(1).is_none_or(|last| after(last).contains(&candidate))
    }

    /// Decide the next rung of `sensor` if all results that it needs are there; whether it was decided.
    pub(crate) fn decide(
        &mut self,
        halving: &Halving,
        sensor: &str,
        members: &[usize],
        (part, default): (Part, Option<usize>),
        results: &BTreeMap<Unit, UnitResult>,
    ) -> bool {
        let Some(&runs) = halving.rungs.get(self.decided(sensor)) else { return false };
        let mut errors: BTreeMap<usize, Vec<f64>> = BTreeMap::new();
        for &member in members {
            let mut sums: BTreeMap<usize, f64> = BTreeMap::new();
            for run in 0..runs {
                let environment = EnvironmentId::Member(member);
                let unit = Unit { sensor: sensor.to_owned(), environment, run };
                let Some(result) = results.get(&unit) else { return false };
                // Only those that went on so far are in the last of these runs.
                if run + 1 == runs {
                    sums.retain(|candidate, _| {
                        result.rows.iter().any(|row| row.candidate == *candidate)
                    });
                }
                for row in &result.rows {
                    let rmse = row.rmse(part).unwrap_or(f64::INFINITY);
                    *sums.entry(row.candidate).or_insert(0.0) += rmse / runs as f64;
                }
            }
            for (candidate, mean) in sums {
                errors.entry(candidate).or_default().push(mean);
            }
        }
        let mut ranked: Vec<(f64, usize)> = errors
            .iter()
            .map(|(&candidate, of)| (of.iter().sum::<f64>() / of.len() as f64, candidate))
            .collect();
        ranked.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let kept = ((halving.keep * ranked.len() as f64).ceil() as usize).max(1);
        let going_on = ranked[..kept].iter().map(|&(_, candidate)| candidate);
        // What nobody has to decide is what all others are compared with.
        let going_on =
            going_on.chain(default.filter(|default| errors.contains_key(default))).collect();
        self.0.entry(sensor.to_owned()).or_default().push(going_on);
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rungs_double_unless_they_are_given() {
        let rungs =
            |rungs: &[usize], keep, runs| HalvingConfig { keep, rungs: rungs.to_vec() }.rungs(runs);
        assert_eq!(rungs(&[], 0.5, 10).expect("valid"), [1, 2, 4, 8]);
        assert_eq!(rungs(&[1, 3], 0.5, 4).expect("valid"), [1, 3]);
        for (of, keep, runs) in [
            (&[3, 1][..], 0.5, 9),
            (&[2, 2], 0.5, 9),
            (&[0], 0.5, 9),
            (&[9], 0.5, 9),
            (&[], 0.5, 1),
        ] {
            let error = rungs(of, keep, runs).expect_err("refused").to_string();
            assert!(error.contains("sweep.halving: rungs must be increasing"), "{error}");
        }
        for keep in [0.0, 1.0, f64::NAN] {
            let error = rungs(&[], keep, 4).expect_err("refused").to_string();
            assert!(error.contains("keep must be above 0 and below 1"), "{error}");
        }
    }
}
