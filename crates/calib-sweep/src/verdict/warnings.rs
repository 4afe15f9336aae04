use calib_agent::Part;
use calib_stats::Selection;

use super::{
    Dropped, ENOUGH_WINDOWS, Judging, PartChoice, Rule, SensorVerdict, SimpleComparison,
    differ::{differ, told_apart},
    rule::ChoiceStanding,
    simple::mean_of,
    truth::Truth,
};
use crate::{Candidate, UnitResult};

/// With fewer scored horizons than this, the error depends more on the scored stretch than on the setting.
const FEW_HORIZONS: f64 = 50.0;

/// Larger shares of the error in the first tenth of a run are reported. An agent that is past its start-up makes about a
/// tenth of its error there.
const MUCH_AT_THE_START: f64 = 0.3;

/// Held-out values further than this from the training mean, in spreads of the training range, may be at another level.
/// Our choice.
const OTHER_LEVEL: f64 = 2.0;

impl SensorVerdict {
    /// Whether the sensor may have another level than in training, by the error of the training mean. Excursions make
    /// this error as large as another level does.
    pub fn level_may_have_changed(&self) -> bool {
        level_may_have_changed(&self.simple)
    }
}

pub(super) fn level_may_have_changed(simple: &[SimpleComparison]) -> bool {
    mean_of(simple)
        .and_then(|mean| mean.online_error)
        .is_some_and(|error| error > OTHER_LEVEL && error.is_finite())
}

/// Returns warnings about the part of a run that errors measure: its start-up, or the rest. A part with another kind of
/// advice has no warning here: its setting is not what to use, and the report warns of the advice.
pub(super) fn of_parts(
    verdict: &SensorVerdict,
    candidates: &[Candidate],
    parts: &[PartChoice],
    start_up_share: Option<f64>,
) -> Vec<String> {
    let SensorVerdict { part, chosen, .. } = *verdict;
    let recommendation = verdict.recommendation();
    let mut warnings = Vec::new();
    if let Some(share) = start_up_share.filter(|&share| share > MUCH_AT_THE_START)
        && part == Part::WholeRun
    {
        warnings.push(format!(
            "the chosen agent makes {:.0} % of its squared error in the first tenth of its runs, so the choice is mostly about how fast it starts up; let it start from a simple predictor (agent.baseline), or score without the start-up \
             (sweep.scored = \"{}\")",
            100.0 * share,
            Part::AfterFirstQuarter.name()
        ));
    }
    let other = parts.iter().find(|choice| {
        choice.part != part
            && choice.recommendation == recommendation
            && !are_neighbours(candidates, choice.chosen, chosen)
    });
    if let Some(other) = other {
        warnings.push(format!(
            "errors {} decided; errors {} would choose {}; set sweep.scored = \"{}\" if that part is what counts at your plant",
            counted(part),
            counted(other.part),
            candidates[other.chosen].label(),
            other.part.name()
        ));
    }
    warnings
}

/// Returns the words for the steps that a part covers.
const fn counted(part: Part) -> &'static str {
    match part {
        Part::WholeRun => "over whole runs",
        Part::AfterFirstQuarter => "after the first quarter of each run",
        Part::FinalQuarter => "over the final quarter of each run",
    }
}

/// Whether two settings are equal, or neighbours in a grid of one hyperparameter.
fn are_neighbours(candidates: &[Candidate], a: usize, b: usize) -> bool {
    a == b || (candidates[a].values.len() == 1 && a.abs_diff(b) == 1)
}

/// Returns the warnings of a verdict.
pub(super) fn all(
    results: &[&UnitResult],
    candidates: &[Candidate],
    (selection, judging, chosen, standing): (
        Option<&Selection>,
        &Judging<'_>,
        usize,
        ChoiceStanding,
    ),
    (scores, dropped): (&[f64], &[Dropped]),
    truth: Option<&Truth>,
) -> Vec<String> {
    let mut warnings = Vec::new();
    warnings.extend(truth.and_then(|truth| little_held_out(truth, judging.part)));
    let rows: Vec<_> = results.iter().flat_map(|result| &result.rows).collect();
    if rows.iter().any(|row| row.updates == 0 && row.diverged_at.is_none()) {
        warnings.push(
            "some runs made no update, because they are shorter than agent.batch_size, so nothing was learned; lower agent.batch_size, or raise sweep.steps".to_owned(),
        );
    }
    let not_finite = results.iter().filter(|result| result.not_finite.is_some());
    let (failed, without) =
        not_finite.fold((0, 0), |(runs, rows), result| (runs + 1, rows + result.rows.len()));
    if failed > 0 {
        warnings.push(format!(
            "the model's rollout diverged to infinity or NaN in {failed} of {} runs: every setting has an infinite error there, so these runs show no difference between settings",
            results.len()
        ));
    }
    let diverged = rows.iter().filter(|row| row.diverged_at.is_some()).count() - without;
    if diverged > 0 {
        warnings.push(format!("{diverged} of {} runs diverged; they rank last", rows.len()));
    }
    if !selection.map_or_else(|| differ(scores), told_apart) {
        warnings.push("all settings tie: the evidence shows no clear difference between them; use longer runs (sweep.steps), or settings that differ more".to_owned());
    } else if judging.rule == Rule::WorstRank
        && candidates.len() > 1
        && selection.is_some_and(|selection| selection.tie_set.len() == candidates.len())
    {
        warnings.push("all settings tie in worst rank; the mean rank decides".to_owned());
    }
    if standing == ChoiceStanding::Diverged {
        let label = candidates[chosen].label();
        warnings.push(format!(
            "every setting diverged in at least one training run, so calib recommends none of them ({label} is the first by the rule); add smaller learning rates to sweep.grid"
        ));
    }
    warnings.extend(truth.and_then(lost_windows));
    let places = if selection.is_some() { "in the models and on the log" } else { "on the log" };
    warnings.extend(told_dropped(dropped, candidates, places));
    warnings
}

/// Returns a warning if few or short windows were held out. If both hold, the remedy of one would make the other worse.
fn little_held_out(truth: &Truth, part: Part) -> Option<String> {
    let count = truth.windows.len();
    let windows = if count == 1 { "window" } else { "windows" };
    let shortest = if count == 1 { "" } else { "the shortest " };
    let horizons = truth.horizons;
    // 500 · (1 − 0.9) is slightly less than 50 in binary.
    let are_short = horizons < FEW_HORIZONS - 1e-6;
    match (count < ENOUGH_WINDOWS, are_short) {
        (false, false) => None,
        (true, false) => Some(format!(
            "the held-out data has {count} {windows}, so little tells a difference from chance; hold out more (data.held_out, or \
             data.train_fraction), or use shorter runs (sweep.steps)"
        )),
        (true, true) => Some(format!(
            "the held-out data has {count} {windows}, {shortest}only {horizons:.1} times as long as what an agent predicts ahead, so little tells a difference from \
             chance; hold out more (data.held_out, or data.train_fraction), or predict less far ahead (agent.gamma)"
        )),
        (false, true) => {
            let whole = match part {
                Part::WholeRun => "",
                Part::AfterFirstQuarter | Part::FinalQuarter => ", or sweep.scored = \"whole_run\"",
            };
            Some(format!(
                "the shortest held-out window is only {horizons:.1} times as long as what an agent predicts ahead, so the verdict depends on what happened in \
                 those {count} as much as on the settings; use longer runs (sweep.steps), and hold out enough for them{whole}"
            ))
        }
    }
}

/// Returns a warning if every setting diverged in some window.
fn lost_windows(truth: &Truth) -> Option<String> {
    let lost = truth.windows.iter().filter(|window| window.best.is_none()).count();
    (lost > 0).then(|| {
        format!(
            "every setting diverged in {lost} of {} held-out windows: regrets are of the others",
            truth.windows.len()
        )
    })
}

/// Returns a warning that lists the dropped settings and their numbers of runs. `places` says where the runs were made.
fn told_dropped(dropped: &[Dropped], candidates: &[Candidate], places: &str) -> Option<String> {
    let of_runs = dropped.first()?.of_runs;
    let each: Vec<String> = dropped
        .iter()
        .map(|dropped| format!("{} after {}", candidates[dropped.candidate].label(), dropped.runs))
        .collect();
    Some(format!(
        "the race dropped {} of {} settings before they had made all of the {of_runs} runs that the others made, {places} ({}): they rank behind all others; held-out data, where there is any, has judged all settings",
        dropped.len(),
        candidates.len(),
        each.join("; ")
    ))
}
