use calib_core::Seed;
use calib_stats::{
    Bounded, ChoiceOfResamples, Drawn, Losses, Nested, StatsError, hierarchical, top_k_hit,
};

use super::{
    Agreement, BaselineRegret, ChoiceBaseline, Grade, Judging, RuleChoice, SensorVerdict, Share,
    Truth, WindowTruth,
    dropped::{LOWER, dropped},
    errors::Errors,
    measured::{MeasuredErrors, NestedRuns},
    nearby::share_nearby,
    rule::{ChoiceStanding, Chooser, Evidence},
    simple,
    truth::{correlations, least},
    warnings,
};
use crate::{Candidate, SweepError, UnitResult};

/// The results of one sensor.
pub(super) struct SensorResults<'a> {
    pub(super) sensor: &'a str,
    pub(super) candidates: &'a [Candidate],
    pub(super) own: Vec<&'a UnitResult>,
}

impl SensorResults<'_> {
    /// Returns the errors over the judged part of each run.
    ///
    /// # Errors
    /// Returns an error if a run has no step to score in this part.
    pub(super) fn measured(&self, judging: &Judging<'_>) -> Result<MeasuredErrors, SweepError> {
        MeasuredErrors::new(&self.own, self.candidates, judging)
    }

    /// Returns the verdict by these errors alone. It has no choices by other parts of the runs.
    pub(super) fn judged(
        &self,
        all: &MeasuredErrors,
        judging: &Judging<'_>,
    ) -> Result<SensorVerdict, SweepError> {
        let Self { sensor, candidates, ref own } = *self;
        let compared = all.compared().map(Errors::means).collect::<Result<Vec<_>, _>>()?;
        let dropped = dropped(own, candidates.len(), &compared);
        let default = candidates.iter().position(|candidate| candidate.is_default);
        let chooser = Chooser { dropped: &dropped, default, values: candidates.len() };
        let runs = NestedRuns::new(all)?;
        let whole = runs.whole();
        let evidence = whole.evidence();
        let chosen = chooser.choose(judging.rule, evidence)?;
        let selection = evidence.members.map(|_| chooser.selection(evidence)).transpose()?;
        let windows = runs.online.as_ref().map_or_else(Vec::new, |errors| errors.whole().means());
        let losses = Losses::new(&windows)?;
        let rules = runs.rules().map(|rule| -> Result<RuleChoice, SweepError> {
            let chosen = chooser.choose(rule, evidence)?;
            Ok(RuleChoice { rule, chosen, regret: losses.regret(chosen) })
        });
        let ranking = chooser.scores(judging.rule, evidence)?;
        let standing = ChoiceStanding::of(judging.rule, chosen, &ranking, selection.as_ref());
        let truth =
            TruthInputs { sensor, all, candidates, judging, losses: &losses, chooser: &chooser };
        let truth =
            all.online.as_ref().map(|online| truth.of(online, chosen, &ranking)).transpose()?;
        // Dropped settings cannot be resampled. Shares among the others alone would look too firm.
        let stability = match dropped[..] {
            [] => shares(&redrawn(&runs, &chooser, judging, sensor)?),
            _ => Vec::new(),
        };
        let simple = simple::compared(judging, sensor, &candidates[chosen], all)?;
        let learning_off = learning_off(candidates, chosen, truth.as_ref());
        let warnings = warnings::all(
            own,
            candidates,
            (selection.as_ref(), judging, chosen, standing),
            (&ranking, &dropped),
            truth.as_ref(),
        );
        Ok(SensorVerdict {
            sensor: sensor.to_owned(),
            part: judging.part,
            rule: judging.rule,
            chosen,
            grade: Grade::of(standing, truth.as_ref(), &simple, judging.stands_still, learning_off),
            scores: ranking,
            stability_nearby: share_nearby(&stability, candidates, chosen),
            stability,
            rules: rules.collect::<Result<_, _>>()?,
            learning_off,
            parts: Vec::new(),
            start_up_share: None,
            warnings,
            members: all.members.iter().map(Errors::scores).collect::<Result<_, _>>()?,
            log_replay: all.log.as_ref().map(Errors::scores).transpose()?,
            selection,
            dropped,
            truth,
            simple,
        })
    }
}

/// An agent that learns after the log is deployed only if its error is at most this share of the error of one that does
/// not. Learning is one more thing that can go wrong. Our choice.
const WORTH_LEARNING_ON: f64 = 0.99;

/// Returns [`SensorVerdict::learning_off`].
fn learning_off(candidates: &[Candidate], chosen: usize, truth: Option<&Truth>) -> Option<usize> {
    let default = candidates.iter().find(|candidate| candidate.is_default);
    let truth = truth?;
    let is_improved = truth.improves_on_the_default()
        && truth.choice.against_default.is_some_and(|ratio| ratio.value <= WORTH_LEARNING_ON);
    let unimproved = default.filter(|_| !is_improved);
    [Some(&candidates[chosen]), unimproved]
        .into_iter()
        .flatten()
        .find(|candidate| {
            candidate.agent.baseline.is_some() && candidate.agent.learning_rate == 0.0
        })
        .map(|candidate| candidate.index)
}

/// Returns the choices in resamples of members, of windows of the log and of their runs.
fn redrawn(
    runs: &NestedRuns,
    chooser: &Chooser<'_>,
    judging: &Judging<'_>,
    sensor: &str,
) -> Result<ChoiceOfResamples, StatsError> {
    let seed: Seed = judging.seed.child("resamples").child(sensor);
    let mut rng = seed.rng();
    let inputs: Vec<&Nested> = runs.members.iter().chain(&runs.log).collect();
    let has_members = runs.members.is_some();
    hierarchical(
        &inputs,
        judging.resamples,
        |below| rng.below(below),
        |drawn: &[Drawn<'_>]| {
            let (members, log) = drawn.split_at(usize::from(has_members));
            let evidence = Evidence { members: members.first(), log: log.first() };
            chooser.choose(judging.rule, evidence).map(Some)
        },
    )
}

/// Returns the share of resamples that choose each setting, largest first.
fn shares(choices: &ChoiceOfResamples) -> Vec<Share> {
    let counts = &choices.counts;
    let all: usize = counts.iter().sum();
    let mut shares: Vec<Share> = counts
        .iter()
        .enumerate()
        .filter(|(_, count)| **count > 0)
        .map(|(candidate, &count)| Share { candidate, share: count as f64 / all as f64 })
        .collect();
    shares.sort_by(|a, b| b.share.total_cmp(&a.share).then(a.candidate.cmp(&b.candidate)));
    shares
}

/// The inputs of a [`Truth`].
struct TruthInputs<'a> {
    sensor: &'a str,
    all: &'a MeasuredErrors,
    candidates: &'a [Candidate],
    judging: &'a Judging<'a>,
    losses: &'a Losses,
    chooser: &'a Chooser<'a>,
}

impl TruthInputs<'_> {
    fn of(&self, online: &Errors, chosen: usize, ranking: &[f64]) -> Result<Truth, SweepError> {
        let Self { sensor, candidates, judging, losses, .. } = self;
        let scores = online.scores()?;
        let means = losses.means();
        let (spearman, kendall) = match &means {
            Some(means) => correlations(ranking, means)?,
            None => (None, None),
        };
        let default = self.chooser.default.filter(|&default| default != chosen);
        let choice = Agreement {
            chosen,
            online_error: scores.candidates[chosen].mean,
            regret: losses.regret(chosen),
            against_default: default.and_then(|default| losses.quotient(chosen, default)),
            spearman,
            kendall,
            top_k_hit: match &means {
                Some(means) => top_k_hit(means, chosen, judging.top_k, LOWER)?,
                None => false,
            },
        };
        let windows = windows(online);
        let scored = windows.iter().map(|window| window.scored_steps).min().unwrap_or(0);
        let gammas = candidates.iter().map(|candidate| candidate.agent.gamma_for(sensor));
        let gamma = gammas.fold(0.0, f64::max);
        Ok(Truth {
            horizons: scored as f64 * (1.0 - gamma),
            windows,
            best: means.as_deref().map(least),
            regrets: means.map(|means| means.iter().map(|loss| loss.exp_m1()).collect()),
            choice,
            baselines: self.baselines()?,
            scores,
        })
    }

    /// Returns the regrets of other ways to choose.
    fn baselines(&self) -> Result<Vec<BaselineRegret>, SweepError> {
        let losses = self.losses;
        let log = self.all.log.as_ref();
        let replayed = log.map(|log| Ok::<_, SweepError>(self.best_of_kept(&log.means()?)));
        let latest = log.and_then(|log| Some(self.best_of_kept(&log.streams.first()?.means())));
        let means = losses.means();
        let best = means.as_deref().map(least);
        let random = means
            .map(|means| means.iter().map(|loss| loss.exp_m1()).sum::<f64>() / means.len() as f64);
        Ok(vec![
            self.regret_of(ChoiceBaseline::Default, self.chooser.default),
            self.regret_of(ChoiceBaseline::LogReplay, replayed.transpose()?),
            self.regret_of(ChoiceBaseline::LatestWindow, latest),
            unbounded(ChoiceBaseline::Random, random),
            self.regret_of(ChoiceBaseline::Hindsight, best),
            unbounded(ChoiceBaseline::AnotherWindow, losses.another_window()),
        ])
    }

    /// Returns the regret of a baseline that chooses this setting.
    fn regret_of(&self, baseline: ChoiceBaseline, chosen: Option<usize>) -> BaselineRegret {
        let regret = chosen.and_then(|chosen| self.losses.regret(chosen));
        BaselineRegret { baseline, chosen, regret }
    }

    /// Returns the best of the settings that were not dropped. Errors of dropped settings come from other streams.
    fn best_of_kept(&self, errors: &[f64]) -> usize {
        let mut errors = errors.to_vec();
        self.chooser.without_dropped(&mut errors);
        least(&errors)
    }
}

/// Returns the regret of a baseline that chooses no single setting. It has no bound, because neither pairs of windows
/// nor the settings of a grid are a random sample.
fn unbounded(baseline: ChoiceBaseline, regret: Option<f64>) -> BaselineRegret {
    let regret = regret.map(|value| Bounded { value, upper: None });
    BaselineRegret { baseline, chosen: None, regret }
}

/// Returns the held-out windows, each with its best setting.
fn windows(online: &Errors) -> Vec<WindowTruth> {
    online
        .streams
        .iter()
        .map(|stream| {
            let errors = stream.means();
            let best = least(&errors);
            WindowTruth {
                start_row: stream.start_row,
                runs: stream.runs.len(),
                scored_steps: stream.scored_steps,
                best: errors[best].is_finite().then_some(best),
            }
        })
        .collect()
}
