use calib_base::{
    StepError,
    outcome::{Outcome, Told},
    output::{Printer, count, counted, number, percent, results, table},
};
use calib_control::{FittedQValue, Importance};
use calib_report::{Cell, Table};
use calib_stats::{RankRule, Selection};
use calib_study::{Job, StepKind};

use super::{
    advice::rank_name,
    described::ActionLogSummary,
    evaluation::{ControlEvaluation, ControlSummary},
};

/// Number of settings that are shown.
const SHOWN: usize = 8;

/// Shown in place of the return if the program failed with a setting.
pub(crate) const FAILED: &str = "failed";

/// Marks a value by fitted Q evaluation that did not converge.
const NOT_CONVERGED: &str = "*";

/// Stands for a value by fitted Q evaluation that no episode can have.
pub(super) const IMPOSSIBLE: &str = "impossible";

impl Told for ControlEvaluation {
    fn outcome(&self) -> Outcome {
        if self.verdict.is_supported() { Outcome::Done } else { Outcome::Negative }
    }

    fn tell(&self, job: &Job, printer: &Printer) -> Result<(), StepError> {
        if printer.is_json() {
            printer.json(&ControlSummary::from(self))?;
            for warning in self.warnings() {
                printer.warn(&warning);
            }
            return Ok(());
        }
        let explains = printer.is_explaining();
        let told = self.advise(|advice| if explains { advice.why() } else { advice.summary() });
        for (place, line) in told.iter().enumerate() {
            let indent = if place == 0 { "" } else { "    " };
            printer.result(&format!("{indent}{line}"))?;
        }
        printer.lines(&candidates(self))?;
        if !self.held_out.is_empty() {
            printer.lines(&results(&held_out(self, Cell::Text(String::new()))))?;
        }
        if explains {
            printer.lines(&actions(&self.log))?;
        } else {
            printer.say(&format!("all reasons: {} --why", job.command(StepKind::Control)));
        }
        for warning in self.failed_settings() {
            printer.warn(&warning);
        }
        Ok(())
    }
}

/// Formats the size of a log, such as "2,000 transitions in 50 episodes, 1 of which ends in a terminal".
pub(crate) fn held(transitions: usize, episodes: usize, terminals: usize) -> String {
    let verb = if terminals == 1 { "ends" } else { "end" };
    format!(
        "{} in {}, {} of which {verb} in a terminal",
        counted(transitions, "transition"),
        counted(episodes, "episode"),
        count(terminals)
    )
}

/// Returns a line on the contents of the log.
pub(super) fn line(log: &ActionLogSummary) -> String {
    held(log.transitions, log.episodes, log.terminals)
}

/// Returns a table of the actions in the log, and where it shows their effect.
pub(super) fn actions(log: &ActionLogSummary) -> String {
    let rows: Vec<_> = log
        .actions
        .iter()
        .map(|action| {
            let share = action.transitions as f64 / log.transitions as f64;
            vec![
                action.name.clone(),
                count(action.transitions),
                percent(share),
                percent(action.covered),
            ]
        })
        .collect();
    let first = if log.settings.is_empty() { "action" } else { "nearest level" };
    let levels = table(&[first, "taken", "of the log", "known in states"], &rows);
    if log.settings.is_empty() { levels } else { format!("{}\n{levels}", settings(log)) }
}

/// Returns a table of the ranges of continuous actions.
fn settings(log: &ActionLogSummary) -> String {
    let rows: Vec<_> = log
        .settings
        .iter()
        .map(|setting| {
            let quantiles = setting.quantiles.iter().map(|&value| number(value));
            std::iter::once(setting.column.clone()).chain(quantiles).collect::<Vec<_>>()
        })
        .collect();
    table(&["set", "least", "5 %", "median", "95 %", "largest"], &rows)
}

/// Returns a table of the held-out periods, with the training range first. `covered` is shown for the training range, which
/// is not compared with itself.
pub(super) fn held_out(evaluation: &ControlEvaluation, covered: Cell) -> Table {
    let mut rows = vec![vec![
        Cell::Text("training range".to_owned()),
        Cell::Count(evaluation.log.transitions as u64),
        covered,
        Cell::Number(evaluation.verdict.behaviour.mean),
        Cell::Number(evaluation.mean_reward),
    ]];
    rows.extend(evaluation.held_out.iter().map(|period| {
        vec![
            Cell::Text(period.name()),
            Cell::Count(period.decisions as u64),
            Cell::Percent(period.uncovered),
            if period.has_an_episode() {
                Cell::Number(period.behaviour.mean)
            } else {
                Cell::Missing
            },
            Cell::Number(period.mean_reward),
        ]
    }));
    let columns = ["period", "decisions", "not covered", "recorded return", "reward of a step"];
    Table {
        title: "Held-out periods".to_owned(),
        caption: "Models and agents know nothing of these periods. Not covered: decisions in states that no decision of the training range is near, whatever the actions. The recorded return is that of an episode, and of what was done then, not of the chosen agent.".to_owned(),
        columns: columns.map(str::to_owned).to_vec(),
        rows,
        best: None,
    }
}

/// Number of columns in the table of states.
const COLUMNS: usize = 6;

/// Returns a table of the states in which each action was taken: the median of each column, and the range of
/// nine tenths of its values.
pub(super) fn states(log: &ActionLogSummary) -> String {
    let rows: Vec<_> = log
        .actions
        .iter()
        .map(|action| {
            let own = action.states.iter().take(COLUMNS).map(|[low, middle, high]| {
                format!("{} ({} to {})", number(*middle), number(*low), number(*high))
            });
            std::iter::once(action.name.clone()).chain(own).collect::<Vec<_>>()
        })
        .collect();
    let mut header = vec!["taken where"];
    header.extend(log.columns.iter().take(COLUMNS).map(String::as_str));
    table(&header, &rows)
}

/// Returns all settings in the order of the rule, with the choice first among equal ones.
pub(super) fn by_rank(selection: &Selection, rule: RankRule) -> Vec<usize> {
    let mut order: Vec<usize> = (0..selection.mean_ranks.len()).collect();
    order.sort_by(|&a, &b| {
        let by_mean = selection.mean_ranks[a].total_cmp(&selection.mean_ranks[b]);
        let by_rule = match rule {
            RankRule::MeanRank => by_mean,
            RankRule::WorstRank => {
                selection.worst_ranks[a].cmp(&selection.worst_ranks[b]).then(by_mean)
            }
        };
        let is_other = |setting: usize| setting != selection.chosen;
        by_rule.then(is_other(a).cmp(&is_other(b))).then(a.cmp(&b))
    });
    order
}

/// Returns the best settings in the order of the rule, and the default.
pub(super) fn best(evaluation: &ControlEvaluation, count: usize) -> Vec<usize> {
    let verdict = &evaluation.verdict;
    let mut order = by_rank(&verdict.selection, verdict.rule);
    order.truncate(count);
    order.extend(verdict.default.filter(|default| !order.contains(default)));
    order
}

/// Returns a table of the best settings, with comparisons.
fn candidates(evaluation: &ControlEvaluation) -> String {
    let (verdict, selection) = (&evaluation.verdict, &evaluation.verdict.selection);
    let order = best(evaluation, SHOWN);
    let resamples = verdict.chosen_of_resamples.iter().sum::<usize>().max(1) as f64;
    let rows: Vec<_> = order
        .iter()
        .map(|&candidate| {
            let mut row = vec![
                evaluation.setting_name(candidate),
                role(evaluation, candidate).to_owned(),
                rank(evaluation, candidate),
                if evaluation.has_failed(candidate) {
                    FAILED.to_owned()
                } else {
                    number(selection.mean_errors[candidate])
                },
                percent(verdict.coverage[candidate].uncovered()),
                percent(verdict.chosen_of_resamples[candidate] as f64 / resamples),
            ];
            row.extend(evaluation.fitted_q_evaluation.get(candidate).map(fitted_q));
            row.extend(
                evaluation
                    .importance_sampling
                    .iter()
                    .flat_map(|estimates| importance(estimates[candidate])),
            );
            row.extend(evaluation.doubly_robust.iter().map(|values| {
                doubly_robust(values[candidate], &evaluation.fitted_q_evaluation[candidate])
            }));
            row
        })
        .collect();
    let mut header =
        vec!["setting", "", rank_name(verdict.rule), "model return", "not covered", "chosen again"];
    if !evaluation.fitted_q_evaluation.is_empty() {
        header.push("fitted Q");
    }
    if evaluation.importance_sampling.is_some() {
        header.extend(["importance", "of episodes"]);
    }
    if evaluation.doubly_robust.is_some() {
        header.push("doubly robust");
    }
    let table = table(&header, &rows);
    let more = match evaluation.candidates.len() - order.len() {
        0 => None,
        more => Some(format!("and {} in the report", counted(more, "more setting"))),
    };
    let shown = order.iter().filter_map(|&candidate| evaluation.fitted_q_evaluation.get(candidate));
    let notes = notes(&shown.collect::<Vec<_>>());
    [table].into_iter().chain(more).chain(notes).collect::<Vec<_>>().join("\n")
}

/// Returns lines below the table that explain what the values by fitted Q evaluation have instead of a number or behind it.
fn notes(shown: &[&FittedQValue]) -> Vec<String> {
    let mut notes = Vec::new();
    if shown.iter().any(|fitted| fitted.value.is_finite() && !fitted.converged) {
        let passes = FittedQValue::MOST_PASSES;
        notes.push(format!(
            "{NOT_CONVERGED} fitted Q evaluation did not converge within {passes} passes"
        ));
    }
    if shown.iter().any(|fitted| fitted.is_impossible()) {
        notes.push(format!(
            "{IMPOSSIBLE}: no episode can have the value of fitted Q evaluation, given the recorded rewards. That happens if the log hardly has \
             the actions that the setting takes"
        ));
    }
    notes
}

/// Returns "chosen" or "default", or an empty text for other settings.
pub(super) fn role(evaluation: &ControlEvaluation, candidate: usize) -> &'static str {
    let verdict = &evaluation.verdict;
    if candidate == verdict.chosen {
        "chosen"
    } else if Some(candidate) == verdict.default {
        "default"
    } else {
        ""
    }
}

/// Returns the rank that the rule uses.
pub(super) fn rank(evaluation: &ControlEvaluation, candidate: usize) -> String {
    let selection = &evaluation.verdict.selection;
    match evaluation.verdict.rule {
        RankRule::MeanRank => format!("{:.1}", selection.mean_ranks[candidate]),
        RankRule::WorstRank => selection.worst_ranks[candidate].to_string(),
    }
}

/// Formats a value by fitted Q evaluation, with a mark if it did not converge, unless no episode can have it.
fn fitted_q(fitted: &FittedQValue) -> String {
    if !fitted.value.is_finite() {
        "diverged".to_owned()
    } else if fitted.is_impossible() {
        IMPOSSIBLE.to_owned()
    } else if fitted.converged {
        number(fitted.value)
    } else {
        format!("{}{NOT_CONVERGED}", number(fitted.value))
    }
}

/// Formats a value by importance sampling, and the number of episodes that it rests on.
fn importance(estimate: Importance) -> [String; 2] {
    let value = estimate.value.map_or_else(|| "none".to_owned(), number);
    [value, format!("{:.1}", estimate.effective_episodes)]
}

/// Formats a doubly robust value. It is missing if fitted Q evaluation diverged, or importance sampling gives
/// none.
fn doubly_robust(value: Option<f64>, fitted: &FittedQValue) -> String {
    match value {
        Some(value) => number(value),
        None if fitted.value.is_finite() => "none".to_owned(),
        None => "diverged".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_are_in_the_order_of_the_rule() {
        let selection = Selection {
            chosen: 2,
            tie_set: vec![1, 2],
            worst_ranks: vec![3, 2, 2],
            mean_ranks: vec![1.5, 2.0, 2.0],
            mean_errors: vec![0.0; 3],
            ranks: Vec::new(),
        };
        assert_eq!(by_rank(&selection, RankRule::MeanRank), [0, 2, 1]);
        assert_eq!(by_rank(&selection, RankRule::WorstRank), [2, 1, 0]);
    }

    #[test]
    fn values_that_did_not_converge_have_a_mark_with_a_note() {
        let settled = FittedQValue { value: 43.4, passes: 20, converged: true, possible: true };
        let drifting = FittedQValue { passes: 160, converged: false, ..settled };
        let diverged = FittedQValue { value: f64::NEG_INFINITY, possible: false, ..drifting };
        let beyond = FittedQValue { possible: false, ..settled };
        // More passes may bring it to a possible value.
        let far = FittedQValue { possible: false, ..drifting };
        assert_eq!(
            [settled, drifting, diverged, beyond, far].map(|value| fitted_q(&value)),
            ["43.4", "43.4*", "diverged", "impossible", "43.4*"]
        );
        assert!(notes(&[&settled, &diverged]).is_empty());
        let told = notes(&[&settled, &drifting]);
        assert_eq!(told, ["* fitted Q evaluation did not converge within 160 passes"]);
        assert_eq!(notes(&[&far]), told);
        assert!(notes(&[&beyond])[0].starts_with("impossible: no episode can have"));
    }
}
