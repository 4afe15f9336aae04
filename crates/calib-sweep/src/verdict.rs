use calib_stats::{
    Direction, SMALL_MEAN_RATIO, Selection, Summary, kendall_tau_b, regret, spearman, summarise,
    top_k_hit,
};
use serde::{Deserialize, Serialize};

use crate::{
    Candidate, Dropped, EnvironmentId, Role, RunRow, SweepError, UnitResult,
    dropped::{dropped, select_among},
};

pub(crate) const LOWER: Direction = Direction::LowerIsBetter;

/// Errors of all candidates in one environment.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EnvironmentScores {
    /// Which environment.
    pub environment: EnvironmentId,
    /// NRMSE over runs, one a candidate.
    pub candidates: Vec<Summary>,
    /// RMSE / standard deviation of the returns, likewise: what to read where the mean return is small.
    pub rmse_over_std: Vec<Summary>,
}

/// How well a choice and its ranking agree with Online.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Agreement {
    /// The candidate that would be deployed.
    pub chosen: usize,
    /// Its mean Online error.
    pub online_error: f64,
    /// (Online error of the chosen − best Online error) / best; none if it cannot be said.
    pub regret: Option<f64>,
    /// Spearman's correlation of the ranking with the Online errors; none if undefined.
    pub spearman: Option<f64>,
    /// Kendall's τ-b of the ranking with the Online errors; none if undefined.
    pub kendall: Option<f64>,
    /// Whether the chosen candidate is among the best `top_k` Online.
    pub top_k_hit: bool,
}

/// What the sweep says about one sensor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SensorVerdict {
    /// The predicted sensor.
    pub sensor: String,
    /// Worst-rank selection over the members, among the grid's candidates.
    pub selection: Selection,
    /// Values that halving dropped, best first; they rank behind all others.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub dropped: Vec<Dropped>,
    /// Errors in each member, over the runs that were made.
    pub members: Vec<EnvironmentScores>,
    /// Errors Online: the grid's candidates, then the default if it is not among them.
    pub online: Option<EnvironmentScores>,
    /// Errors on replayed training windows.
    pub log_replay: Option<EnvironmentScores>,
    /// The best candidate Online, the default included.
    pub best_online: Option<usize>,
    /// The calibration model against Online.
    pub model_agreement: Option<Agreement>,
    /// Choosing by replaying the log, against Online.
    pub log_replay_agreement: Option<Agreement>,
    /// Keeping the `[agent]` section's own values, against Online.
    pub default_agreement: Option<Agreement>,
    /// What the reader should know: small mean returns, divergence, ties with everything.
    pub warnings: Vec<String>,
}

/// Judge one sensor from the results of its units.
///
/// # Errors
/// If results are missing or cannot be ranked.
pub fn verdict(
    sensor: &str,
    candidates: &[Candidate],
    results: &[UnitResult],
    top_k: usize,
) -> Result<SensorVerdict, SweepError> {
    let of_sensor: Vec<&UnitResult> =
        results.iter().filter(|result| result.unit.sensor == sensor).collect();
    let grid = candidates.iter().filter(|candidate| candidate.role == Role::Grid).count();
    let mut environments: Vec<EnvironmentId> =
        of_sensor.iter().map(|result| result.unit.environment).collect();
    environments.sort_unstable();
    environments.dedup();
    let scores = |environment: EnvironmentId| -> Result<EnvironmentScores, SweepError> {
        let trained = if environment == EnvironmentId::Online { candidates.len() } else { grid };
        let summaries = |score: fn(&RunRow) -> f64| {
            (0..trained)
                .map(|candidate| {
                    Ok(summarise(&scores_of(&of_sensor, environment, candidate, score))?)
                })
                .collect::<Result<Vec<Summary>, SweepError>>()
        };
        Ok(EnvironmentScores {
            environment,
            candidates: summaries(|row| row.nrmse)?,
            rmse_over_std: summaries(|row| row.rmse_over_std)?,
        })
    };
    let of =
        |wanted: EnvironmentId| environments.contains(&wanted).then(|| scores(wanted)).transpose();
    let members = environments
        .iter()
        .filter(|environment| matches!(environment, EnvironmentId::Member(_)))
        .map(|&environment| scores(environment))
        .collect::<Result<Vec<_>, _>>()?;
    let online = of(EnvironmentId::Online)?;
    let log_replay = of(EnvironmentId::LogReplay)?;

    let member_errors: Vec<Vec<f64>> = members.iter().map(means).collect();
    let dropped = dropped(&of_sensor, grid, &member_errors);
    let selection = select_among(&member_errors, &dropped)?;
    // Ties in the worst rank are settled as in the selection, so that the ranking that is compared
    // with Online is the one that chooses.
    let ranking = selection_order(&selection);

    let judge = |ranking: &[f64], chosen: usize| -> Result<Option<Agreement>, SweepError> {
        online
            .as_ref()
            .map(|online| agreement(&means(online), grid, ranking, chosen, top_k))
            .transpose()
    };
    let model_agreement = judge(&ranking, selection.chosen)?;
    let log_replay_agreement = match &log_replay {
        Some(scores) => {
            let errors = means(scores);
            judge(&errors, best(&errors))?
        }
        None => None,
    };
    let default_agreement = match candidates.iter().find(|candidate| candidate.is_default) {
        Some(default) => judge(&[], default.index)?,
        None => None,
    };
    let mut warnings = warnings(&of_sensor, &selection, grid);
    warnings.extend(told_dropped(&dropped, candidates));
    if candidates[..grid].iter().any(|candidate| candidate.agent.gamma != candidates[0].agent.gamma)
    {
        warnings.push(
            "the grid varies gamma: each value predicts another return, so their errors do not compare".to_owned(),
        );
    }
    Ok(SensorVerdict {
        sensor: sensor.to_owned(),
        best_online: online.as_ref().map(|online| best(&means(online))),
        selection,
        dropped,
        members,
        online,
        log_replay,
        model_agreement,
        log_replay_agreement,
        default_agreement,
        warnings,
    })
}

/// A score of one candidate in each run of an environment.
fn scores_of(
    results: &[&UnitResult],
    environment: EnvironmentId,
    candidate: usize,
    score: fn(&RunRow) -> f64,
) -> Vec<f64> {
    results
        .iter()
        .filter(|result| result.unit.environment == environment)
        .flat_map(|result| &result.rows)
        .filter(|row| row.candidate == candidate)
        .map(score)
        .collect()
}

fn means(scores: &EnvironmentScores) -> Vec<f64> {
    scores.candidates.iter().map(|summary| summary.mean).collect()
}

/// The first of the smallest errors.
fn best(errors: &[f64]) -> usize {
    (0..errors.len()).min_by(|&a, &b| errors[a].total_cmp(&errors[b])).unwrap_or(0)
}

/// Position of each candidate when the worst rank decides, then mean rank, then mean error.
fn selection_order(selection: &Selection) -> Vec<f64> {
    let key = |candidate: usize| {
        let rank = selection.worst_ranks[candidate];
        (rank, selection.mean_ranks[candidate], selection.mean_errors[candidate])
    };
    let count = selection.worst_ranks.len();
    let before = |a: usize, b: usize| key(a).partial_cmp(&key(b)) == Some(std::cmp::Ordering::Less);
    (0..count)
        .map(|candidate| (0..count).filter(|&other| before(other, candidate)).count() as f64)
        .collect()
}

/// Compare a ranking (small is good; empty for a lone choice) with the Online errors.
fn agreement(
    online: &[f64],
    grid: usize,
    ranking: &[f64],
    chosen: usize,
    top_k: usize,
) -> Result<Agreement, SweepError> {
    // A default outside the grid may beat the grid: regret is then measured against it,
    // because it, too, could have been deployed.
    let correlate = ranking.len() == grid && grid > 1;
    Ok(Agreement {
        chosen,
        online_error: online[chosen],
        regret: regret(online, chosen, LOWER)?,
        spearman: if correlate { spearman(ranking, &online[..grid])? } else { None },
        kendall: if correlate { kendall_tau_b(ranking, &online[..grid])? } else { None },
        top_k_hit: top_k_hit(online, chosen, top_k, LOWER)?,
    })
}

/// Whether the members prefer any value to another: by worst rank, or at least by mean rank.
pub fn told_apart(selection: &Selection) -> bool {
    let ranks: Vec<_> = selection.worst_ranks.iter().zip(&selection.mean_ranks).collect();
    ranks.len() == 1 || ranks.windows(2).any(|pair| pair[0] != pair[1])
}

/// What was dropped when, for the reader.
fn told_dropped(dropped: &[Dropped], candidates: &[Candidate]) -> Option<String> {
    let of_runs = dropped.first()?.of_runs;
    let each: Vec<String> = dropped
        .iter()
        .map(|dropped| format!("{} after {}", candidates[dropped.candidate].label(), dropped.runs))
        .collect();
    Some(format!(
        "halving dropped {} of {} values before they had made all {of_runs} runs of every member ({}): they rank behind \
         all others, which are ranked among themselves; held-out data, where there is any, has judged all values",
        dropped.len(),
        candidates.iter().filter(|candidate| candidate.role == Role::Grid).count(),
        each.join("; ")
    ))
}

fn warnings(results: &[&UnitResult], selection: &Selection, grid: usize) -> Vec<String> {
    let mut warnings = Vec::new();
    let rows: Vec<_> = results.iter().flat_map(|result| &result.rows).collect();
    let small =
        rows.iter().filter(|row| row.mean_return.abs() < SMALL_MEAN_RATIO * row.return_std).count();
    if small > 0 {
        warnings.push(format!(
            "the mean return is small against its spread in {small} of {} runs: NRMSE divides by a number \
             near zero there, so look at rmse_over_std in summary.json and runs.parquet as well",
            rows.len()
        ));
    }
    if rows.iter().any(|row| row.updates == 0 && row.diverged_at.is_none()) {
        warnings.push(
            "some runs made no update: the stream is shorter than batch_size, so nothing was learnt".to_owned(),
        );
    }
    let not_finite = results.iter().filter(|result| result.not_finite.is_some());
    let (failed, without) =
        not_finite.fold((0, 0), |(runs, rows), result| (runs + 1, rows + result.rows.len()));
    if failed > 0 {
        warnings.push(format!(
            "the model's rollout left the finite numbers in {failed} of {} runs: every value has an infinite error \
             there, so the member cannot tell values apart",
            results.len()
        ));
    }
    let diverged = rows.iter().filter(|row| row.diverged_at.is_some()).count() - without;
    if diverged > 0 {
        warnings.push(format!("{diverged} of {} runs diverged; they rank last", rows.len()));
    }
    if !told_apart(selection) {
        warnings.push("all values tie: the members do not tell them apart".to_owned());
    } else if grid > 1 && selection.tie_set.len() == grid {
        warnings.push("all values tie in worst rank; the mean rank decides".to_owned());
    }
    if selection.mean_errors[selection.chosen].is_infinite() {
        warnings.push("every value diverged in some member: none can be recommended".to_owned());
    }
    warnings
}
