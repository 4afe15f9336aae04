use calib_control::Doubt;
use calib_stats::{Difference, Interval};

use super::files::{Told, ToldToMachines};
use crate::{
    base::outcome::Outcome,
    output::{Printer, count, percent, significant, table},
};

/// Candidates that are shown.
const SHOWN: usize = 8;

/// Show the verdict; negative where the log does not support it.
pub(super) fn show(told: &Told, printer: &Printer) -> anyhow::Result<Outcome> {
    if printer.is_for_machines() {
        printer.json(&ToldToMachines::from(told))?;
    } else {
        printer.lines(&actions(told))?;
        printer.lines(&candidates(told))?;
        printer.lines(&sentences(told).join("\n"))?;
    }
    let verdict = &told.verdict;
    for doubt in &verdict.doubts {
        printer.warn(&reason(doubt, told));
    }
    Ok(if verdict.is_supported() { Outcome::Done } else { Outcome::Negative })
}

/// What the log did, and where it says what an action does.
fn actions(told: &Told) -> String {
    let row = |action: &super::files::ActionTold| {
        let share = action.transitions as f64 / told.transitions as f64;
        vec![
            action.name.clone(),
            count(action.transitions),
            percent(share),
            percent(action.covered),
        ]
    };
    let rows: Vec<_> = told.actions.iter().map(row).collect();
    table(&["action", "taken", "of the log", "known in states"], &rows)
}

/// The best candidates by the rule, and what is compared with them.
fn candidates(told: &Told) -> String {
    let (verdict, selection) = (&told.verdict, &told.verdict.selection);
    let mut order: Vec<usize> = (0..told.candidates.len()).collect();
    order.sort_by(|&a, &b| {
        let rank = |of: usize| (selection.worst_ranks[of], selection.mean_ranks[of]);
        let (one, other) = (rank(a), rank(b));
        one.0.cmp(&other.0).then(one.1.total_cmp(&other.1)).then(a.cmp(&b))
    });
    order.truncate(SHOWN);
    order.extend(verdict.default.filter(|of| !order.contains(of)));
    let resamples = verdict.chosen_of_resamples.iter().sum::<usize>().max(1) as f64;
    let row = |&candidate: &usize| {
        let mark = match candidate {
            of if of == verdict.chosen => "chosen",
            of if Some(of) == verdict.default => "default",
            _ => "",
        };
        let fitted = told.fitted_q_evaluation[candidate];
        vec![
            name(told, candidate),
            mark.to_owned(),
            selection.worst_ranks[candidate].to_string(),
            significant(selection.mean_errors[candidate]),
            percent(verdict.coverage[candidate].uncovered()),
            percent(verdict.chosen_of_resamples[candidate] as f64 / resamples),
            fitted.map_or_else(|| "diverged".to_owned(), significant),
        ]
    };
    let rows: Vec<_> = order.iter().map(row).collect();
    table(
        &["candidate", "", "worst rank", "model return", "not covered", "chosen again", "fitted Q"],
        &rows,
    )
}

/// What distinguishes a candidate.
fn name(told: &Told, candidate: usize) -> String {
    let fields = &told.fields[candidate];
    if fields.is_empty() {
        return "the agent".to_owned();
    }
    let one = |(field, value): &(String, String)| format!("{field}={value}");
    fields.iter().map(one).collect::<Vec<_>>().join(" ")
}

fn sentences(told: &Told) -> Vec<String> {
    let verdict = &told.verdict;
    let verb = if verdict.is_supported() {
        "deploy"
    } else {
        "the log does not support a choice; it would be"
    };
    let mut lines = vec![format!("{verb}: {}", name(told, verdict.chosen))];
    match &verdict.over_default {
        Some(_) if verdict.default == Some(verdict.chosen) => {
            lines.push("that is the default".to_owned());
        }
        Some(over) => lines.push(format!("over the default: {}", difference(over))),
        None => lines.push("the default is not in the grid".to_owned()),
    }
    lines.push(format!("over a random candidate: {}", difference(&verdict.over_random)));
    if let Some(behaviour) = verdict.behaviour {
        lines.push(format!(
            "recorded episodes: mean return {}{}",
            significant(behaviour.mean),
            behaviour.interval.map_or_else(String::new, interval)
        ));
    }
    lines.push(
        "returns in the model rank candidates; they do not say what the plant will give".to_owned(),
    );
    lines
}

fn difference(of: &Difference) -> String {
    let sign = if of.mean >= 0.0 { "+" } else { "" };
    let interval = of.interval.map_or_else(String::new, interval);
    format!("{sign}{} in the model, over members{interval}", significant(of.mean))
}

fn interval(of: Interval) -> String {
    format!(" (95 %: {} to {})", significant(of.low), significant(of.high))
}

/// Why the log does not support the choice, and what to do.
fn reason(doubt: &Doubt, told: &Told) -> String {
    match doubt {
        Doubt::ActionNeverTaken { action } => {
            let name = told.actions.get(*action).map_or("?", |of| of.name.as_str());
            format!("{name} was never taken: no model knows what it does; record some steps with it")
        }
        Doubt::Uncovered { share } => format!(
            "{} of the chosen candidate's steps lie where the log has no such action; record more varied actions, \
             or allow more with control.most_uncovered",
            percent(*share)
        ),
        Doubt::FewTerminals { terminals } => format!(
            "only {} episodes end in a terminal, and choices depend on what leads there; record more, or allow fewer \
             with control.fewest_terminals",
            count(*terminals)
        ),
        Doubt::NotToldApart => {
            "all candidates rank alike in every member; sweep values that differ more, or longer (control.steps)"
                .to_owned()
        }
        Doubt::Diverged => "the chosen candidate diverged in a member; sweep smaller step sizes".to_owned(),
    }
}
