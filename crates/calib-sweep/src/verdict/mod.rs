//! What a sweep says about one sensor.

mod draw;
mod dropped;
mod errors;
mod grade;
mod rule;
#[cfg(test)]
mod tests;
mod truth;
mod warnings;

use calib_agent::Part;
use calib_core::Seed;
use calib_stats::{Direction, Estimate, Selection};
use serde::{Deserialize, Serialize};

pub use dropped::Dropped;
pub use errors::EnvironmentScores;
pub use grade::Grade;
pub use rule::Rule;
pub use truth::{Agreement, Baseline, BaselineRegret, Truth, WindowTruth};

use crate::{Candidate, EnvironmentId, ErrorScale, SweepError, UnitResult};
use draw::{Drawn, Sizes};
use dropped::dropped;
use errors::Errors;
use rule::Evidence;
use truth::{Windows, correlations, estimate, is_among_best, least, regret};

pub(crate) const LOWER: Direction = Direction::LowerIsBetter;

/// How results are judged.
#[derive(Clone, Copy, Debug)]
pub struct Judging<'a> {
    /// The part of a run whose error counts.
    pub part: Part,
    /// How a value is chosen.
    pub rule: Rule,
    /// The choice counts as a hit among this many best.
    pub top_k: usize,
    /// What the errors of each sensor are divided by.
    pub scales: &'a [ErrorScale],
    /// Resamples of intervals; 0 gives none.
    pub resamples: usize,
    /// Root of the resamples' seeds.
    pub seed: Seed,
}

/// How often a value is chosen from other draws of the evidence.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Share {
    /// The candidate.
    pub candidate: usize,
    /// Share of the resamples in which the rule chooses it.
    pub share: f64,
}

/// What a rule chooses, and what that costs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RuleChoice {
    /// The rule.
    pub rule: Rule,
    /// Its choice.
    pub chosen: usize,
    /// The regret of that; none without held-out data.
    pub regret: Option<Estimate>,
}

/// What the sweep says about one sensor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SensorVerdict {
    /// The predicted sensor.
    pub sensor: String,
    /// The part of a run whose error counts.
    pub part: Part,
    /// The rule that chose.
    pub rule: Rule,
    /// Its choice.
    pub chosen: usize,
    /// How well held-out data supports it.
    pub grade: Grade,
    /// What is chosen from other draws of members, runs and windows of the log, the most frequent first.
    pub stability: Vec<Share>,
    /// What each rule chooses.
    pub rules: Vec<RuleChoice>,
    /// Ranks over the members, and the worst-rank selection among them.
    pub selection: Selection,
    /// Values that were dropped, best first; they rank behind all others.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub dropped: Vec<Dropped>,
    /// Errors in each member, over the runs that were made.
    pub members: Vec<EnvironmentScores>,
    /// Errors on replayed training windows.
    pub log_replay: Option<EnvironmentScores>,
    /// What held-out data says.
    pub truth: Option<Truth>,
    /// What the reader should know: few horizons, divergence, ties with everything.
    pub warnings: Vec<String>,
}

/// Judge one sensor from the results of its units.
///
/// # Errors
/// If results are missing, cannot be ranked, or have no step to score.
pub fn verdict(
    sensor: &str,
    candidates: &[Candidate],
    results: &[UnitResult],
    judging: &Judging<'_>,
) -> Result<SensorVerdict, SweepError> {
    let own: Vec<&UnitResult> =
        results.iter().filter(|result| result.unit.sensor == sensor).collect();
    let all = Environments::new(&own, candidates, judging)?;
    let values = candidates.len();
    let means = all.members.iter().map(Errors::means).collect::<Result<Vec<_>, _>>()?;
    let dropped = dropped(&own, values, &means);
    let default = candidates.iter().position(|candidate| candidate.is_default);
    let evidence = Evidence {
        members: &all.members,
        log: all.log.as_ref(),
        dropped: &dropped,
        default,
        values,
    };
    let sizes = Sizes::of(&all.members, all.log.as_ref(), all.online.as_ref());
    let whole = sizes.all();
    let mut rng = judging.seed.child("resamples").child(sensor).rng();
    let resamples: Vec<Drawn> = (0..judging.resamples).map(|_| sizes.draw(&mut rng)).collect();
    let chosen = evidence.choose(judging.rule, &whole)?;
    let selection = evidence.selection(&whole)?;
    let windows = all.online.as_ref().map(|errors| Windows { errors, values });
    let truth = match &windows {
        None => None,
        Some(windows) => {
            let draws = Draws { whole: &whole, resamples: &resamples };
            Some(truth(chosen, (&evidence, windows), candidates, judging, draws)?)
        }
    };
    let rules = Rule::ALL.into_iter().map(|rule| {
        let chosen = evidence.choose(rule, &whole)?;
        let loss =
            |drawn: &Drawn| Some(regret(windows.as_ref()?.mean_losses(&drawn.windows)?[chosen]));
        Ok(RuleChoice { rule, chosen, regret: estimate(&whole, &resamples, loss)? })
    });
    Ok(SensorVerdict {
        sensor: sensor.to_owned(),
        part: judging.part,
        rule: judging.rule,
        chosen,
        grade: Grade::of(truth.as_ref()),
        stability: stability(&evidence, judging.rule, &resamples)?,
        rules: rules.collect::<Result<_, SweepError>>()?,
        warnings: warnings::all(&own, candidates, (&selection, chosen), &dropped, truth.as_ref()),
        members: all.members.iter().map(Errors::scores).collect::<Result<_, _>>()?,
        log_replay: all.log.as_ref().map(Errors::scores).transpose()?,
        selection,
        dropped,
        truth,
    })
}

/// What was measured, environment by environment.
struct Environments {
    members: Vec<Errors>,
    log: Option<Errors>,
    online: Option<Errors>,
}

impl Environments {
    fn new(
        results: &[&UnitResult],
        candidates: &[Candidate],
        judging: &Judging<'_>,
    ) -> Result<Self, SweepError> {
        let mut ids: Vec<EnvironmentId> =
            results.iter().map(|result| result.unit.environment).collect();
        ids.sort_unstable();
        ids.dedup();
        let of = |id| Errors::new(id, results, (judging.part, judging.scales), candidates);
        let one = |id: EnvironmentId| ids.contains(&id).then(|| of(id)).transpose();
        let is_member = |id: &&EnvironmentId| matches!(id, EnvironmentId::Member(_));
        Ok(Self {
            members: ids.iter().filter(is_member).map(|&id| of(id)).collect::<Result<_, _>>()?,
            log: one(EnvironmentId::LogReplay)?,
            online: one(EnvironmentId::Online)?,
        })
    }
}

/// Everything once, and resamples of it.
#[derive(Clone, Copy)]
struct Draws<'a> {
    whole: &'a Drawn,
    resamples: &'a [Drawn],
}

impl Draws<'_> {
    fn estimate(
        &self,
        statistic: impl Fn(&Drawn) -> Option<f64>,
    ) -> Result<Option<Estimate>, SweepError> {
        estimate(self.whole, self.resamples, statistic)
    }
}

/// How often each value is chosen over resamples.
fn stability(
    evidence: &Evidence<'_>,
    rule: Rule,
    resamples: &[Drawn],
) -> Result<Vec<Share>, SweepError> {
    let mut counts = vec![0_usize; evidence.values];
    for drawn in resamples {
        counts[evidence.choose(rule, drawn)?] += 1;
    }
    let share = |(candidate, &count): (usize, &usize)| Share {
        candidate,
        share: count as f64 / resamples.len() as f64,
    };
    let mut shares: Vec<Share> =
        counts.iter().enumerate().filter(|(_, count)| **count > 0).map(share).collect();
    shares.sort_by(|a, b| b.share.total_cmp(&a.share).then(a.candidate.cmp(&b.candidate)));
    Ok(shares)
}

fn truth(
    chosen: usize,
    (evidence, windows): (&Evidence<'_>, &Windows<'_>),
    candidates: &[Candidate],
    judging: &Judging<'_>,
    draws: Draws<'_>,
) -> Result<Truth, SweepError> {
    let all = &draws.whole.windows;
    let losses = windows.mean_losses(all);
    let regret_of = |value: usize| {
        draws.estimate(|drawn| Some(regret(windows.mean_losses(&drawn.windows)?[value])))
    };
    let scores = windows.errors.scores()?;
    let ranking = evidence.scores(judging.rule, draws.whole)?;
    let (spearman, kendall) = match &losses {
        Some(losses) => correlations(&ranking, losses)?,
        None => (None, None),
    };
    let against_default = match evidence.default.filter(|&default| default != chosen) {
        Some(default) => draws.estimate(|drawn| {
            let losses = windows.mean_losses(&drawn.windows)?;
            let difference = losses[chosen] - losses[default];
            (!difference.is_nan()).then(|| difference.exp())
        })?,
        None => None,
    };
    let choice = Agreement {
        chosen,
        online_error: scores.candidates[chosen].mean,
        regret: regret_of(chosen)?,
        against_default,
        spearman,
        kendall,
        top_k_hit: match &losses {
            Some(losses) => is_among_best(losses, chosen, judging.top_k)?,
            None => false,
        },
    };
    let of_value = |baseline, value: Option<usize>| -> Result<BaselineRegret, SweepError> {
        let regret = value.map(regret_of).transpose()?.flatten();
        Ok(BaselineRegret { baseline, chosen: value, regret })
    };
    let log = evidence.log.map(Errors::means).transpose()?;
    let latest = evidence.log.and_then(|log| {
        let first = log.streams.first()?;
        let errors = (0..evidence.values).map(|value| first.mean(value, 0..first.runs.len()));
        Some(least(&errors.collect::<Vec<f64>>()))
    });
    let best = windows.best(all);
    let statistic = |baseline, of: &dyn Fn(&Drawn) -> Option<f64>| {
        Ok::<_, SweepError>(BaselineRegret { baseline, chosen: None, regret: draws.estimate(of)? })
    };
    let baselines = vec![
        of_value(Baseline::Default, evidence.default)?,
        of_value(Baseline::LogReplay, log.as_deref().map(least))?,
        of_value(Baseline::LatestWindow, latest)?,
        statistic(Baseline::Random, &|drawn| {
            let losses = windows.mean_losses(&drawn.windows)?;
            Some(losses.iter().map(|&loss| regret(loss)).sum::<f64>() / losses.len() as f64)
        })?,
        of_value(Baseline::Hindsight, best)?,
        // Copies of a window would judge its own choice: this one has no interval.
        BaselineRegret {
            baseline: Baseline::AnotherWindow,
            chosen: None,
            regret: windows
                .another_window(all)
                .map(|loss| Estimate { value: regret(loss), interval: None }),
        },
    ];
    let gamma = candidates.iter().map(|of| of.agent.gamma).fold(0.0, f64::max);
    let each = windows.each(draws.whole);
    let least_scored = each.iter().map(|window| window.scored_steps).min().unwrap_or(0);
    Ok(Truth {
        windows: each,
        horizons: least_scored as f64 * (1.0 - gamma),
        best,
        regrets: losses.map(|losses| losses.into_iter().map(regret).collect()),
        choice,
        baselines,
        scores,
    })
}

/// Whether the members prefer any value to another: by worst rank, or at least by mean rank.
pub fn told_apart(selection: &Selection) -> bool {
    let ranks: Vec<_> = selection.worst_ranks.iter().zip(&selection.mean_ranks).collect();
    ranks.len() == 1 || ranks.windows(2).any(|pair| pair[0] != pair[1])
}
