//! Verdicts and sensitivity curves of a sweep as rows of the report.

use calib_agent::{Part, SimplePredictor};
use calib_report::{
    Alternative, Dimension, ErrorCurve, ErrorSource, HeldOutResult, PartRow, RankCurve, Reason,
    Samples, Sensitivity, Separation, Setting, SimpleRow, Simpler, Sources, TopK, Verdict, listed,
};
use calib_stats::Summary;
use calib_study::Study;
use calib_sweep::{
    Candidate, ChoiceBaseline, EnvironmentScores, ErrorScale, GridEnd, PartChoice, Rule, Sampling,
    SensorVerdict, SimpleComparison, Truth,
};
use serde_json::Value;

use crate::sweep::{SweepFacts, streams::part_name};

/// Returns the swept field, or all of them if there are several.
pub(crate) fn field(candidates: &[Candidate]) -> String {
    let fields = candidates[0].values.iter().map(|(field, _)| field.as_str());
    fields.collect::<Vec<_>>().join(", ")
}

/// Returns a setting for display: a number if a single numeric field is swept, otherwise its label.
pub(crate) fn setting(candidate: &Candidate) -> Setting {
    match candidate.values.as_slice() {
        [(_, value)] => single(value),
        _ => Setting::Name(candidate.label()),
    }
}

/// Returns the verdict on one sensor in words: what to deploy, then the reasons.
pub(crate) fn advice(verdict: &Verdict) -> Vec<String> {
    [verdict.headline()].into_iter().chain(verdict.reasons()).collect()
}

/// Returns the report row of a sensor. `outside_training` is the share of held-out values outside the training range.
pub(crate) fn verdict_row(
    verdict: &SensorVerdict,
    outside_training: Option<f64>,
    sweep: &SweepFacts,
    study: &Study,
    model: &str,
) -> Verdict {
    let candidates = &sweep.candidates;
    let selection = verdict.selection.as_ref();
    let of_members: usize = verdict.members.iter().map(|scores| scores.streams).sum();
    let of_log = verdict.log_replay.as_ref().map_or(0, |scores| scores.streams);
    let of_all = of_members + of_log;
    let unit = sweep.simple.units.get(&verdict.sensor).copied();
    let sources = match (&verdict.log_replay, selection) {
        (Some(_), None) => Sources::Log,
        (Some(_), Some(_)) => Sources::MembersAndLog,
        (None, _) => Sources::Members,
    };
    Verdict {
        sensor: verdict.sensor.clone(),
        field: field(candidates),
        model: model.to_owned(),
        chosen: setting(&candidates[verdict.chosen]),
        grade: verdict.grade,
        reason: match verdict.rule {
            Rule::WorstRank => Reason::WorstRank,
            Rule::MeanRank => Reason::MeanRank,
            Rule::MeanError => Reason::MeanError,
            Rule::MeanLogError => Reason::MeanLogError { streams: of_members },
            Rule::Pooled => Reason::Pooled { streams: of_all, sources },
            Rule::LogReplay => Reason::LogReplay { streams: of_all - of_members },
            Rule::OneStandardError => Reason::OneStandardError { streams: of_all, sources },
        },
        evidence: separation(&verdict.scores),
        tie_set: selection.map_or_else(Vec::new, |ranks| {
            ranks.tie_set.iter().map(|&tied| setting(&candidates[tied])).collect()
        }),
        worst_rank: selection.map_or(0, |ranks| ranks.worst_ranks[verdict.chosen]),
        values: candidates.len(),
        members: verdict.members.len(),
        stability: verdict
            .stability
            .iter()
            .map(|choice| (setting(&candidates[choice.candidate]), choice.share))
            .collect(),
        stability_nearby: verdict.stability_nearby,
        outside_training,
        elsewhere: verdict.elsewhere(),
        online: verdict.truth.as_ref().map(|truth| agreement(verdict, truth, sweep, study)),
        alternatives: alternatives(verdict, candidates),
        simple: verdict.simple.iter().filter_map(|simple| simple_row(simple, unit)).collect(),
        agent_on_log: agent_on_log(verdict),
        parts: verdict.parts.iter().map(|choice| part_row(choice, candidates)).collect(),
        start_up_share: verdict.start_up_share,
        simpler: verdict.simpler().map(|simple| beside(simple, verdict, sweep)),
        matched: verdict
            .preferred_simple()
            .filter(|_| verdict.simpler().is_none())
            .map(|simple| beside(simple, verdict, sweep)),
        frozen: frozen(verdict, sweep),
        learns_nothing: verdict.learning_off == Some(verdict.chosen),
        notes: verdict.warnings.iter().cloned().chain(at_the_end(verdict, sweep)).collect(),
    }
}

/// Returns the error of a simple predictor in the windows on which it is compared. `unit` is the factor from a normalised
/// return to the sensor's unit.
fn simple_row(simple: &SimpleComparison, unit: Option<f64>) -> Option<SimpleRow> {
    let is_of_log = simple.log_windows.is_some();
    Some(SimpleRow {
        predictor: simple.predictor,
        error: if is_of_log { simple.log_error? } else { simple.online_error? },
        typical_error: unit
            .zip(simple.online_rmse)
            .filter(|_| !is_of_log)
            .map(|(unit, rmse)| rmse * unit),
        ratio: simple.ratio,
    })
}

/// Returns the error of the chosen agent on windows of the log, as a geometric mean, if simple predictors are compared
/// with it there.
fn agent_on_log(verdict: &SensorVerdict) -> Option<f64> {
    let mut compared = verdict.simple.iter().filter(|simple| simple.log_windows.is_some());
    compared.find_map(|simple| Some(simple.ratio?.value * simple.log_error?))
}

/// Returns other ways to choose, with their regrets.
fn alternatives(verdict: &SensorVerdict, candidates: &[Candidate]) -> Vec<Alternative> {
    let baselines = verdict.truth.iter().flat_map(|truth| &truth.baselines);
    baselines
        // Left out if log replay decides: this baseline averages the same errors differently, and would look like a
        // second log replay.
        .filter(|other| {
            other.baseline != ChoiceBaseline::LogReplay || verdict.rule != Rule::LogReplay
        })
        .map(|other| Alternative {
            baseline: other.baseline,
            value: other.chosen.map(|chosen| setting(&candidates[chosen])),
            regret: other.regret,
        })
        .collect()
}

/// Returns choice and advice by one part of the runs.
fn part_row(choice: &PartChoice, candidates: &[Candidate]) -> PartRow {
    PartRow {
        part: run_part(choice.part),
        chosen: setting(&candidates[choice.chosen]),
        error: choice.online_error_of_verdict,
        recommendation: choice.recommendation,
        simple: choice.predictor,
        compared: choice.simple.as_ref().map(|simple| simple.predictor),
        ratio: choice.simple.as_ref().and_then(|simple| simple.ratio),
    }
}

/// Returns the heading for a part of a run.
const fn run_part(part: Part) -> &'static str {
    match part {
        Part::WholeRun => "whole run",
        Part::AfterFirstQuarter => "last three quarters",
        Part::FinalQuarter => "final quarter",
    }
}

/// Compares a simple predictor with the chosen agent.
fn beside(simple: &SimpleComparison, verdict: &SensorVerdict, sweep: &SweepFacts) -> Simpler {
    let chosen = &sweep.candidates[verdict.chosen];
    let unit = sweep.simple.units.get(&verdict.sensor);
    let scale = ErrorScale::find(&sweep.scales, &verdict.sensor, chosen);
    let truth = verdict.truth.as_ref().filter(|_| simple.log_windows.is_none());
    let agent = truth.map(|truth| truth.choice.online_error * scale);
    Simpler {
        predictor: simple.predictor,
        ratio: simple.ratio,
        is_better: simple.is_better(),
        typical_errors: unit
            .zip(simple.online_rmse.zip(agent))
            .map(|(unit, (predictor, agent))| [predictor, agent].map(|error| error * unit)),
        runaway_windows: simple.runaway_windows,
        has_baseline: chosen.agent.baseline.is_some(),
        starts_from: sweep.simple.best.get(&verdict.sensor).copied().filter(|best| {
            chosen.agent.baseline == Some(SimplePredictor::Best) && *best != simple.predictor
        }),
    }
}

/// Returns the simple predictor that the default or the choice equals, if it learns nothing more and is to be used.
pub(crate) fn frozen(verdict: &SensorVerdict, sweep: &SweepFacts) -> Option<SimplePredictor> {
    let best = sweep.simple.best.get(&verdict.sensor).copied();
    sweep.candidates[verdict.learning_off?].start(best)
}

/// Returns a note if the best setting is at an end of a numeric key of the grid, beyond which better ones may lie.
fn at_the_end(verdict: &SensorVerdict, sweep: &SweepFacts) -> Option<String> {
    let candidates = &sweep.candidates;
    let online = verdict.truth.as_ref();
    let told_apart = match online {
        Some(truth) => {
            truth.regrets.as_deref().is_some_and(|regrets| separation(regrets) == Separation::Apart)
        }
        None => separation(&verdict.scores) == Separation::Apart,
    };
    let stands_still = sweep.standing_still.contains(&verdict.sensor);
    if sweep.study.sweep.sampling != Sampling::Grid || !told_apart || stands_still {
        return None;
    }
    let best = online.map_or(Some(verdict.chosen), |truth| truth.best)?;
    let keys = &candidates[best].values;
    let ends: Vec<String> = keys
        .iter()
        .enumerate()
        .filter_map(|(place, (key, _))| {
            let end = end_of(candidates, best, place)?.name();
            Some(if keys.len() == 1 {
                format!("is the {end}")
            } else {
                format!("has the {end} {key}")
            })
        })
        .collect();
    if ends.is_empty() {
        return None;
    }
    let whose = if online.is_some() { "the best setting on held-out data" } else { "the choice" };
    Some(format!(
        "{whose} {} of the grid: better ones may lie beyond it; add some to sweep.grid",
        listed(&ends)
    ))
}

/// Returns the end of the grid at which a setting is by the number at this place of its values.
fn end_of(candidates: &[Candidate], best: usize, place: usize) -> Option<GridEnd> {
    let numbers: Vec<f64> = candidates
        .iter()
        .map(|candidate| single(&candidate.values[place].1).as_number())
        .collect::<Option<_>>()?;
    GridEnd::at(numbers[best], numbers)
}

fn agreement(
    verdict: &SensorVerdict,
    truth: &Truth,
    sweep: &SweepFacts,
    study: &Study,
) -> HeldOutResult {
    let candidates = &sweep.candidates;
    let best = truth.best.unwrap_or(verdict.chosen);
    let choice = &truth.choice;
    HeldOutResult {
        part: part_name(verdict.part).to_owned(),
        windows: truth.windows.len(),
        runs: truth.scores.runs,
        // The best setting of a window has no regret there. If no setting has any regret, all errors are equal.
        values: truth.regrets.as_deref().map_or(Separation::Apart, separation),
        stands_still: sweep.standing_still.contains(&verdict.sensor),
        chosen_error: choice.online_error,
        chosen_skill: truth.scores.skill[verdict.chosen],
        best: setting(&candidates[best]),
        best_error: truth.scores.candidates[best].mean,
        best_skill: truth.scores.skill[best],
        regret: choice.regret,
        against_default: choice.against_default,
        spearman: choice.spearman,
        kendall: choice.kendall,
        // With as many best settings as there are settings, a hit means nothing.
        top_k: (study.evaluate.top_k < candidates.len())
            .then_some(TopK { k: study.evaluate.top_k, hit: choice.top_k_hit }),
    }
}

/// Returns the sensitivity curves of a sensor.
pub(crate) fn sensitivity(verdict: &SensorVerdict, sweep: &SweepFacts, model: &str) -> Sensitivity {
    let candidates = &sweep.candidates[..];
    let mut errors = Vec::new();
    if let Some(truth) = &verdict.truth {
        errors.push(error_curve(&truth.scores, "held-out period", ErrorSource::Online));
        errors.extend(simple_line(verdict, sweep));
    }
    let evidence = evidence(verdict, model);
    // If log replay decides alone, the evidence is drawn. The mean over windows would be nearly the same curve.
    let replay = verdict.log_replay.as_ref();
    if let Some(replay) = replay.filter(|_| evidence.is_none() || verdict.selection.is_some()) {
        errors.push(error_curve(replay, "log replay", ErrorSource::LogReplay));
    }
    errors.extend(evidence);
    Sensitivity {
        sensor: verdict.sensor.clone(),
        field: field(candidates),
        values: candidates.iter().map(setting).collect(),
        errors,
        worst_ranks: verdict
            .selection
            .iter()
            .map(|ranks| RankCurve {
                label: format!("{model}, worst rank"),
                worst_ranks: ranks.worst_ranks.clone(),
            })
            .collect(),
        chosen: Some(verdict.chosen),
        default: candidates.iter().position(|candidate| candidate.is_default),
        dimensions: dimensions(candidates),
    }
}

/// Returns the errors in one environment: over its windows, or over the runs if there is one window.
fn error_curve(scores: &EnvironmentScores, label: &str, source: ErrorSource) -> ErrorCurve {
    ErrorCurve {
        label: label.to_owned(),
        source,
        over: if scores.streams == 1 { Samples::Runs } else { Samples::Windows },
        summaries: scores
            .candidates
            .iter()
            .map(|scores| (scores.runs > 0).then_some(*scores))
            .collect(),
    }
}

/// Returns the error of the simple predictor that the verdict names, as a line over all settings. It is the predictor
/// to use, or else the one that the log prefers.
fn simple_line(verdict: &SensorVerdict, sweep: &SweepFacts) -> Option<ErrorCurve> {
    let start = frozen(verdict, sweep);
    let started = verdict.simple.iter().find(|simple| Some(simple.predictor) == start);
    let named = verdict.simpler().or(started).or_else(|| verdict.preferred_simple())?;
    let windows = verdict.truth.as_ref()?.windows.len();
    let mean = named.online_error?;
    let summary = Summary { mean, std: None, interval: None, runs: windows, diverged: 0 };
    Some(ErrorCurve {
        label: format!("{}, no agent", named.predictor.label()),
        source: ErrorSource::Simple,
        over: Samples::Windows,
        summaries: vec![Some(summary); sweep.candidates.len()],
    })
}

/// Returns the swept hyperparameters, if there are several.
fn dimensions(candidates: &[Candidate]) -> Vec<Dimension> {
    let fields = &candidates[0].values;
    if fields.len() < 2 {
        return Vec::new();
    }
    fields
        .iter()
        .enumerate()
        .map(|(place, (field, _))| Dimension {
            field: field.clone(),
            values: candidates.iter().map(|candidate| single(&candidate.values[place].1)).collect(),
        })
        .collect()
}

/// Returns a value of one hyperparameter: a number, or a name.
fn single(value: &Value) -> Setting {
    value.as_f64().map_or_else(|| Setting::Name(calib_sweep::written(value)), Setting::Number)
}

/// Returns the curve that decided, if settings are chosen by mean logarithms: geometric means of the errors.
fn evidence(verdict: &SensorVerdict, model: &str) -> Option<ErrorCurve> {
    if !verdict.rule.is_by_logarithms() {
        return None;
    }
    let log = verdict.log_replay.iter().filter(|_| verdict.rule != Rule::MeanLogError);
    let is_log_alone = verdict.rule == Rule::LogReplay && verdict.log_replay.is_some();
    let members = verdict.members.iter().filter(|_| !is_log_alone);
    let streams = members.chain(log).map(|scores| scores.streams).sum();
    let summaries = verdict.scores.iter().enumerate().map(|(value, &mean_log)| {
        let mean = mean_log.exp();
        let diverged = usize::from(mean.is_infinite());
        // A setting that a race dropped was not measured on all streams, and cannot be compared.
        let is_dropped = verdict.dropped.iter().any(|dropped| dropped.candidate == value);
        (!is_dropped).then_some(Summary {
            mean,
            std: None,
            interval: None,
            runs: streams,
            diverged,
        })
    });
    let whose = match (verdict.rule, &verdict.log_replay) {
        (Rule::LogReplay, Some(_)) => "log replay".to_owned(),
        _ if verdict.selection.is_none() => "log replay".to_owned(),
        (Rule::MeanLogError, _) | (_, None) => model.to_owned(),
        (_, Some(_)) => format!("{model} and log replay"),
    };
    Some(ErrorCurve {
        label: format!("{whose} (decides)"),
        source: ErrorSource::Evidence,
        over: Samples::Streams,
        summaries: summaries.collect(),
    })
}

/// Returns whether any of these numbers differ. A single number counts as different.
fn separation(numbers: &[f64]) -> Separation {
    let differ = numbers.len() < 2 || numbers.windows(2).any(|pair| pair[0] != pair[1]);
    if differ { Separation::Apart } else { Separation::Alike }
}

#[cfg(test)]
mod tests {
    use calib_agent::AgentConfig;
    use serde_json::json;

    use super::*;

    fn candidate(rate: f64, lambda: f64) -> Candidate {
        let values = [("learning_rate", rate), ("lambda", lambda)]
            .map(|(key, value)| (key.to_owned(), json!(value)))
            .to_vec();
        Candidate { index: 0, is_default: false, values, agent: AgentConfig::default() }
    }

    #[test]
    fn each_key_has_its_own_ends() {
        let mut candidates = Vec::new();
        for rate in [0.0, 0.1, 1.0] {
            candidates.extend([0.0, 0.9].map(|lambda| candidate(rate, lambda)));
        }
        let ends: Vec<_> = (0..6).map(|best| end_of(&candidates, best, 0)).collect();
        // Nothing lies below a rate of 0, and two values have no inside.
        let largest = Some(GridEnd::Largest);
        assert_eq!(ends, [None, None, None, None, largest, largest]);
        assert!((0..6).all(|best| end_of(&candidates, best, 1).is_none()));
        let positive = [0.3, 0.1, 1.0].map(|rate| candidate(rate, 0.0));
        assert_eq!(end_of(&positive, 1, 0), Some(GridEnd::Smallest));
    }
}
