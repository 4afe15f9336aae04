use calib_core::Seed;
use calib_stats::{
    ChoiceOfResamples, Drawn, Estimate, Interval, Nested, Statistics, StatsError, hierarchical,
};

use super::{
    Agreement, Baseline, BaselineRegret, Grade, Judging, RuleChoice, SensorVerdict, Share, Truth,
    WindowTruth,
    dropped::dropped,
    errors::Errors,
    rule::{Chooser, Evidence, Rule},
    truth::{another_window, correlations, is_among_best, least, losses, mean_losses},
    warnings,
};
use crate::{Candidate, EnvironmentId, SweepError, UnitResult};

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
    let all = Measured::new(&own, candidates, judging)?;
    let means = all.members.iter().map(Errors::means).collect::<Result<Vec<_>, _>>()?;
    let dropped = dropped(&own, candidates.len(), &means);
    let chooser = Chooser {
        dropped: &dropped,
        default: candidates.iter().position(|candidate| candidate.is_default),
        values: candidates.len(),
    };
    let runs = Runs::new(&all)?;
    let (members, log) = (runs.members.whole(), runs.log.as_ref().map(Nested::whole));
    let evidence = Evidence { members: &members, log: log.as_ref() };
    let chosen = chooser.choose(judging.rule, evidence)?;
    let selection = chooser.selection(evidence)?;
    let resampled = Resampled::new(&runs, &chooser, chosen, judging, sensor)?;
    let rule = |rule| -> Result<RuleChoice, SweepError> {
        let chosen = chooser.choose(rule, evidence)?;
        Ok(RuleChoice { rule, chosen, regret: resampled.regret(chosen) })
    };
    let ranking = chooser.scores(judging.rule, evidence)?;
    let truth = Truthful { all: &all, candidates, judging, resampled: &resampled };
    let truth = all.online.as_ref().map(|online| truth.of(online, chosen, &ranking)).transpose()?;
    Ok(SensorVerdict {
        sensor: sensor.to_owned(),
        part: judging.part,
        rule: judging.rule,
        chosen,
        grade: Grade::of(truth.as_ref()),
        scores: ranking,
        stability: shares(resampled.choices.as_ref()),
        rules: Rule::ALL.into_iter().map(rule).collect::<Result<_, _>>()?,
        warnings: warnings::all(
            &own,
            candidates,
            (&selection, judging, chosen),
            &dropped,
            truth.as_ref(),
        ),
        members: all.members.iter().map(Errors::scores).collect::<Result<_, _>>()?,
        log_replay: all.log.as_ref().map(Errors::scores).transpose()?,
        selection,
        dropped,
        truth,
    })
}

/// What was measured, environment by environment.
struct Measured {
    members: Vec<Errors>,
    log: Option<Errors>,
    online: Option<Errors>,
}

impl Measured {
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

/// The same for resampling: members with their rollouts, windows with their runs.
struct Runs {
    members: Nested,
    log: Option<Nested>,
    online: Option<Nested>,
}

impl Runs {
    fn new(all: &Measured) -> Result<Self, StatsError> {
        let nested = |of: &Errors| Nested::new(of.units());
        Ok(Self {
            members: Nested::new(all.members.iter().flat_map(Errors::units).collect())?,
            log: all.log.as_ref().map(nested).transpose()?,
            online: all.online.as_ref().map(nested).transpose()?,
        })
    }
}

/// Regrets of all values, of all runs and over resamples; and what is chosen from resamples.
struct Resampled {
    /// Losses of all windows; empty without held-out data.
    losses: Vec<Vec<f64>>,
    /// Mean losses over them; none if every value diverged, or nothing was held out.
    mean_losses: Option<Vec<f64>>,
    /// Of the regret of each value, then of the mean regret, then of the error of the choice by the default's.
    intervals: Vec<Option<Interval>>,
    choices: Option<ChoiceOfResamples>,
}

impl Resampled {
    fn new(
        runs: &Runs,
        chooser: &Chooser<'_>,
        chosen: usize,
        judging: &Judging<'_>,
        sensor: &str,
    ) -> Result<Self, StatsError> {
        let seed: Seed = judging.seed.child("resamples").child(sensor);
        let mut rng = seed.rng();
        let inputs: Vec<&Nested> = [Some(&runs.members), runs.log.as_ref(), runs.online.as_ref()]
            .into_iter()
            .flatten()
            .collect();
        let has_log = runs.log.is_some();
        let statistic = |drawn: &[Drawn<'_>]| -> Result<Statistics, StatsError> {
            let evidence = Evidence { members: &drawn[0], log: has_log.then(|| &drawn[1]) };
            let windows = runs.online.as_ref().and(drawn.last());
            let losses = windows.and_then(|of| mean_losses(&losses(&of.means())));
            Ok(Statistics {
                numbers: numbers(losses.as_deref(), chooser, chosen),
                choices: vec![Some(chooser.choose(judging.rule, evidence)?)],
            })
        };
        let all = hierarchical(&inputs, judging.resamples, |below| rng.below(below), statistic)?;
        let losses = runs.online.as_ref().map_or_else(Vec::new, |of| losses(&of.whole().means()));
        let finite = |interval: &Interval| interval.low.is_finite() && interval.high.is_finite();
        Ok(Self {
            mean_losses: mean_losses(&losses),
            losses,
            intervals: all.numbers.iter().map(|of| of.interval.filter(finite)).collect(),
            choices: all.choices.into_iter().next(),
        })
    }

    fn estimate(&self, place: usize, value: f64) -> Estimate {
        let interval = self.intervals.get(place).copied().flatten();
        Estimate { value, interval: interval.filter(|_| value.is_finite()) }
    }

    /// Regret of a value.
    fn regret(&self, value: usize) -> Option<Estimate> {
        Some(self.estimate(value, self.mean_losses.as_ref()?[value].exp_m1()))
    }

    /// Mean regret over all values.
    fn random(&self) -> Option<Estimate> {
        let losses = self.mean_losses.as_ref()?;
        Some(self.estimate(losses.len(), mean_regret(losses)))
    }

    /// Error of the choice by the default's.
    fn against(&self, default: usize, chosen: usize) -> Option<Estimate> {
        let losses = self.mean_losses.as_ref()?;
        let quotient = quotient(losses, default, chosen)?;
        Some(self.estimate(losses.len() + 1, quotient))
    }
}

/// What is estimated of a resample: [`Resampled::intervals`].
fn numbers(losses: Option<&[f64]>, chooser: &Chooser<'_>, chosen: usize) -> Vec<Option<f64>> {
    let Some(losses) = losses else { return vec![None; chooser.values + 2] };
    let regrets = losses.iter().map(|loss| Some(loss.exp_m1()));
    let against = chooser.default.and_then(|default| quotient(losses, default, chosen));
    regrets.chain([Some(mean_regret(losses)), against]).collect()
}

fn mean_regret(losses: &[f64]) -> f64 {
    losses.iter().map(|loss| loss.exp_m1()).sum::<f64>() / losses.len() as f64
}

/// None where both diverged.
fn quotient(losses: &[f64], default: usize, chosen: usize) -> Option<f64> {
    let difference = losses[chosen] - losses[default];
    (!difference.is_nan()).then(|| difference.exp())
}

/// How often each value is chosen, the most frequent first.
fn shares(choices: Option<&ChoiceOfResamples>) -> Vec<Share> {
    let counts = choices.map_or(&[][..], |of| &of.counts);
    let all: usize = counts.iter().sum();
    let share = |(candidate, &count): (usize, &usize)| Share {
        candidate,
        share: count as f64 / all as f64,
    };
    let mut shares: Vec<Share> =
        counts.iter().enumerate().filter(|(_, count)| **count > 0).map(share).collect();
    shares.sort_by(|a, b| b.share.total_cmp(&a.share).then(a.candidate.cmp(&b.candidate)));
    shares
}

/// What the truth is put together from.
struct Truthful<'a> {
    all: &'a Measured,
    candidates: &'a [Candidate],
    judging: &'a Judging<'a>,
    resampled: &'a Resampled,
}

impl Truthful<'_> {
    fn of(&self, online: &Errors, chosen: usize, ranking: &[f64]) -> Result<Truth, SweepError> {
        let Self { candidates, judging, resampled, .. } = self;
        let scores = online.scores()?;
        let losses = resampled.mean_losses.as_deref();
        let (spearman, kendall) = match losses {
            Some(losses) => correlations(ranking, losses)?,
            None => (None, None),
        };
        let default = self.default().filter(|&default| default != chosen);
        let choice = Agreement {
            chosen,
            online_error: scores.candidates[chosen].mean,
            regret: resampled.regret(chosen),
            against_default: default.and_then(|default| resampled.against(default, chosen)),
            spearman,
            kendall,
            top_k_hit: match losses {
                Some(losses) => is_among_best(losses, chosen, judging.top_k)?,
                None => false,
            },
        };
        let windows = windows(online);
        let scored = windows.iter().map(|window| window.scored_steps).min().unwrap_or(0);
        let gamma = candidates.iter().map(|of| of.agent.gamma).fold(0.0, f64::max);
        Ok(Truth {
            horizons: scored as f64 * (1.0 - gamma),
            windows,
            best: losses.map(least),
            regrets: losses.map(|losses| losses.iter().map(|loss| loss.exp_m1()).collect()),
            choice,
            baselines: self.baselines()?,
            scores,
        })
    }

    fn default(&self) -> Option<usize> {
        self.candidates.iter().position(|candidate| candidate.is_default)
    }

    /// What other ways to choose cost.
    fn baselines(&self) -> Result<Vec<BaselineRegret>, SweepError> {
        let resampled = self.resampled;
        let of_value = |baseline, value: Option<usize>| BaselineRegret {
            baseline,
            chosen: value,
            regret: value.and_then(|value| resampled.regret(value)),
        };
        let log = self.all.log.as_ref();
        let replayed = log.map(|log| Ok::<_, SweepError>(least(&log.means()?))).transpose()?;
        let latest = log.and_then(|log| Some(least(&log.streams.first()?.means())));
        let best = resampled.mean_losses.as_deref().map(least);
        // Copies of a window would judge its own choice: what another window costs has no interval.
        let another = another_window(&resampled.losses);
        let another = another.map(|loss| Estimate { value: loss.exp_m1(), interval: None });
        let of = |baseline, regret| BaselineRegret { baseline, chosen: None, regret };
        Ok(vec![
            of_value(Baseline::Default, self.default()),
            of_value(Baseline::LogReplay, replayed),
            of_value(Baseline::LatestWindow, latest),
            of(Baseline::Random, resampled.random()),
            of_value(Baseline::Hindsight, best),
            of(Baseline::AnotherWindow, another),
        ])
    }
}

/// Each window, and what is best in it.
fn windows(online: &Errors) -> Vec<WindowTruth> {
    let of = |stream: &super::errors::Stream| {
        let errors = stream.means();
        let best = least(&errors);
        WindowTruth {
            start_row: stream.start_row,
            runs: stream.runs.len(),
            scored_steps: stream.scored_steps,
            best: errors[best].is_finite().then_some(best),
        }
    };
    online.streams.iter().map(of).collect()
}
