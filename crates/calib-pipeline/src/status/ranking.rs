//! Ranks settings by the available runs.

use std::collections::BTreeMap;

use calib_base::StepError;
use calib_stats::{mean, summarise};
use calib_sweep::EnvironmentId;
use calib_sweep_steps::sweep::planned::{PlannedSweep, StoredRun};
use schemars::JsonSchema;
use serde::Serialize;

/// Current ranking of the settings for one sensor. It is provisional while runs are missing. It is not a verdict: it does not
/// use held-out data.
#[derive(Debug, Serialize, JsonSchema)]
pub(crate) struct Ranking {
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) model: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) deployment: Option<String>,
    pub(crate) sensor: String,
    /// Number of finished runs in all environments, and of all runs; in a race, the latter is the maximum.
    pub(crate) runs: [usize; 2],
    /// Whether the ranking uses the runs that the study's rule needs. While there are none of these, it uses the runs in the
    /// models.
    pub(crate) by_rule: bool,
    /// The runs that the rule uses.
    pub(crate) decided_by: DecidedBy,
    /// The settings that have runs, the best first.
    pub(crate) settings: Vec<Ranked>,
}

/// The environments of the runs by which settings are ranked.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum DecidedBy {
    Log,
    Models,
    Both,
}

impl DecidedBy {
    fn of(planned: &PlannedSweep) -> Self {
        let environments = planned.environments_that_count();
        let is_on_log = environments.contains(&EnvironmentId::LogReplay);
        let is_in_models = environments.iter().any(|own| matches!(own, EnvironmentId::Member(_)));
        match (is_on_log, is_in_models) {
            (true, true) => Self::Both,
            (true, false) => Self::Log,
            (false, _) => Self::Models,
        }
    }
}

/// A setting in the ranking.
#[derive(Debug, Serialize, JsonSchema)]
pub(crate) struct Ranked {
    pub(crate) setting: String,
    pub(crate) is_default: bool,
    /// Number of runs in the ranking.
    pub(crate) runs: usize,
    /// Number of these runs that diverged.
    pub(crate) diverged: usize,
    /// Its error divided by the leader's error: the geometric mean over the streams that both have. None if it diverged.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) ratio: Option<f64>,
    /// 95 % interval of this ratio, by Student's t over the streams.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) interval: Option<[f64; 2]>,
}

/// Logarithms of a setting's errors, by the number of the unit.
type LogErrors = BTreeMap<usize, f64>;

/// Ranks the settings of a sweep for each sensor, in the order of the plan.
pub(super) fn rankings(
    planned: &PlannedSweep,
    stored: &[StoredRun<'_>],
    (model, deployment): (Option<&str>, Option<&str>),
) -> Result<Vec<Ranking>, StepError> {
    planned
        .sensors()
        .into_iter()
        .map(|sensor| {
            let own: Vec<&StoredRun<'_>> =
                stored.iter().filter(|run| run.sensor() == sensor).collect();
            let mut logs: Vec<LogErrors> = vec![LogErrors::new(); planned.labels.len()];
            let by_rule = own.iter().any(|run| planned.counts(run.environment()));
            for run in &own {
                let counts = if by_rule {
                    planned.counts(run.environment())
                } else {
                    matches!(run.environment(), EnvironmentId::Member(_))
                };
                if counts && let Some(logs) = logs.get_mut(run.candidate) {
                    logs.insert(run.unit, run.rmse.ln());
                }
            }
            let settings = ranked(&logs)?.into_iter().map(|(candidate, standing)| Ranked {
                setting: planned.labels[candidate].clone(),
                is_default: planned.default == Some(candidate),
                runs: logs[candidate].len(),
                diverged: diverged(&logs[candidate]),
                ratio: standing.ratio,
                interval: standing.interval,
            });
            Ok(Ranking {
                model: model.map(str::to_owned),
                deployment: deployment.map(str::to_owned),
                sensor: sensor.to_owned(),
                runs: [own.len(), planned.runs_of(sensor)],
                by_rule,
                decided_by: DecidedBy::of(planned),
                settings: settings.collect(),
            })
        })
        .collect()
}

/// A setting compared with the leader.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct AgainstLeader {
    ratio: Option<f64>,
    interval: Option<[f64; 2]>,
}

fn diverged(logs: &LogErrors) -> usize {
    logs.values().filter(|log| **log == f64::INFINITY).count()
}

/// Returns the mean of the finite logarithms; infinite if there are none.
fn mean_log(logs: &LogErrors) -> f64 {
    let finite: Vec<f64> = logs.values().copied().filter(|log| *log < f64::INFINITY).collect();
    mean(&finite).unwrap_or(f64::INFINITY)
}

/// Returns the settings that have runs, best first. The leader is among those with the most runs. It diverged in the
/// fewest of them, and has the smallest mean logarithm on ties. Other settings are compared with it on common streams,
/// because a race or a smaller grid leaves some with fewer.
fn ranked(logs: &[LogErrors]) -> Result<Vec<(usize, AgainstLeader)>, StepError> {
    let most = logs.iter().map(LogErrors::len).max().unwrap_or(0);
    if most == 0 {
        return Ok(Vec::new());
    }
    let with_most = (0..logs.len()).filter(|candidate| logs[*candidate].len() == most);
    let leader = with_most.min_by(|a, b| {
        let [a, b] = [a, b].map(|candidate| &logs[*candidate]);
        diverged(a).cmp(&diverged(b)).then(mean_log(a).total_cmp(&mean_log(b)))
    });
    let Some(leader) = leader else { return Ok(Vec::new()) };
    let with_runs = (0..logs.len()).filter(|candidate| !logs[*candidate].is_empty());
    let mut all = with_runs
        .map(|candidate| Ok((candidate, against(&logs[candidate], &logs[leader])?)))
        .collect::<Result<Vec<(usize, AgainstLeader)>, StepError>>()?;
    all.sort_by(|(a, own), (b, other)| {
        let by_divergence = diverged(&logs[*a]).cmp(&diverged(&logs[*b]));
        let [own, other] = [own, other].map(|one| one.ratio.unwrap_or(f64::INFINITY));
        (*a != leader).cmp(&(*b != leader)).then(by_divergence).then(own.total_cmp(&other))
    });
    Ok(all)
}

/// Returns the ratio of a setting's error to the leader's, on common streams.
fn against(own: &LogErrors, leader: &LogErrors) -> Result<AgainstLeader, StepError> {
    let both = own.iter().filter_map(|(unit, log)| Some((log, leader.get(unit)?)));
    let differences: Vec<f64> =
        both.map(|(own, leader)| if own == leader { 0.0 } else { own - leader }).collect();
    if differences.is_empty() || differences.iter().any(|difference| !difference.is_finite()) {
        return Ok(AgainstLeader::default());
    }
    let summary = summarise(&differences)?;
    let interval = summary.interval.map(|interval| [interval.low.exp(), interval.high.exp()]);
    Ok(AgainstLeader { ratio: Some(summary.mean.exp()), interval })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn logs(errors: &[f64]) -> LogErrors {
        errors.iter().map(|error| error.ln()).enumerate().collect()
    }

    #[test]
    fn settings_are_compared_with_the_leader_on_common_streams() {
        let short: LogErrors = [(2, 12.0_f64.ln())].into();
        let all = [logs(&[2.0, 4.0, 8.0]), logs(&[1.0, 2.0, 4.0]), short, LogErrors::new()];
        let ranked = ranked(&all).expect("ranked");
        let order: Vec<usize> = ranked.iter().map(|(candidate, _)| *candidate).collect();
        assert_eq!(order, [1, 0, 2], "one without runs has no place");
        let ratios: Vec<f64> = ranked.iter().filter_map(|(_, standing)| standing.ratio).collect();
        assert!(
            ratios.iter().zip([1.0, 2.0, 3.0]).all(|(a, b)| (a - b).abs() < 1e-12),
            "{ratios:?}"
        );
        let [low, high] = ranked[1].1.interval.expect("three streams");
        assert!((low - 2.0).abs() < 1e-9 && (high - 2.0).abs() < 1e-9, "{low} {high}");
        assert_eq!(ranked[2].1.interval, None, "one stream says nothing of chance");
    }

    #[test]
    fn what_diverges_is_behind() {
        let inf = f64::INFINITY;
        let all = [logs(&[0.1, inf]), logs(&[3.0, 3.0]), logs(&[inf, inf])];
        let ranked = ranked(&all).expect("ranked");
        let order: Vec<usize> = ranked.iter().map(|(candidate, _)| *candidate).collect();
        assert_eq!(order, [1, 0, 2]);
        assert_eq!(ranked[1].1, AgainstLeader::default());
    }
}
