//! The report on agents that act: one page, and its figures as files.

use std::{
    io::Write as _,
    path::{Path, PathBuf},
};

use calib_base::{
    StepError,
    output::{count, span},
};
use calib_control::{ControlConfig, Distance, Importance, RewardRow};
use calib_files::write_atomically;
use calib_model_steps::{
    represent::{decisions, report_table},
    rollouts::figures as drawn,
};
use calib_report::{Cell, Overview, OverviewText, Table};
use calib_study::{Job, StepKind};

use super::{
    advice::rank_name, evaluation::ControlEvaluation, figures, reward_words::reward_told, show,
};

const PAGE: &str = "report.html";

/// Returns the path of the page.
pub(super) fn path(directory: &Path) -> PathBuf {
    directory.join(PAGE)
}

/// Writes the page, and each figure as SVG and PNG. Returns the file names.
pub(super) fn write(
    directory: &Path,
    job: &Job,
    evaluation: &ControlEvaluation,
) -> Result<Vec<String>, StepError> {
    let figures = figures::all(evaluation);
    let mut names = vec![PAGE.to_owned()];
    for (name, figure) in &figures {
        names.extend(drawn::write(directory, name, &figure.figure())?);
    }
    let page = Overview {
        title: job.own_title().map_or_else(
            || "Agents that act".to_owned(),
            |name| format!("{name}: agents that act"),
        ),
        subtitle: Some(show::line(&evaluation.log)),
        decision: Some(evaluation.advise(|advice| advice.decision())),
        findings: evaluation.advise(|advice| advice.findings()),
        warnings: evaluation.warnings(),
        texts: episode(job, evaluation).into_iter().chain(about_log(evaluation)).collect(),
        figures: figures.into_iter().map(|(_, figure)| figure).collect(),
        tables: [
            vec![candidates(evaluation), actions(evaluation)],
            held_out(evaluation).into_iter().collect(),
            maps(evaluation),
            represented(job, evaluation),
        ]
        .concat(),
        command: job.command(StepKind::Control),
    };
    let html = page.html();
    write_atomically(&path(directory), |file| file.write_all(html.as_bytes()))?;
    Ok(names)
}

/// Returns the section that says what a reward, a decision and an episode are.
fn episode(job: &Job, evaluation: &ControlEvaluation) -> Option<OverviewText> {
    let config = job.study().control.as_ref()?;
    Some(OverviewText {
        id: "episode",
        title: "What an episode is",
        paragraphs: vec![episode_told(config, evaluation.decision_secs)],
        items: Vec::new(),
    })
}

/// Returns sentences on what agents of a study do and get. `decision_secs` is the time from one decision to the next.
fn episode_told(config: &ControlConfig, decision_secs: f64) -> String {
    let row = match config.reward_row {
        RewardRow::Next if config.reward.columns().any(|name| config.actions.contains(name)) => {
            "the row that the step led to, and actions in the row before it"
        }
        RewardRow::Next => "the row that the step led to",
        RewardRow::Same => "the row of its action",
    };
    let decisions = match config.every {
        1 => format!(
            "Agents decide in every row, and from one decision to the next it is {}.",
            span(decision_secs)
        ),
        every => format!(
            "Agents decide once every {} rows (control.every), and from one decision to the next it is {}. The rewards of these rows are summed.",
            count(every),
            span(decision_secs)
        ),
    };
    let end = match &config.terminal {
        Some(terminal) => {
            format!("An episode ends in a row in which {terminal} is not 0 (control.terminal).")
        }
        None => "No episode ends in a terminal, because the study names none.".to_owned(),
    };
    format!(
        "{} It is read in {row}. {decisions} {end} In the models an episode is cut after {} decisions (control.timeout), which are {}.",
        reward_told(&config.reward),
        count(config.timeout),
        span(decision_secs * config.timeout as f64)
    )
}

/// Returns the section with the warnings about the log, if there are any.
fn about_log(evaluation: &ControlEvaluation) -> Option<OverviewText> {
    (!evaluation.log_warnings.is_empty()).then(|| OverviewText {
        id: "log",
        title: "About the log",
        paragraphs: Vec::new(),
        items: evaluation.log_warnings.clone(),
    })
}

/// Returns the table of tested representations, if neighbours are measured in one.
fn represented(job: &Job, evaluation: &ControlEvaluation) -> Vec<Table> {
    let manifest = (evaluation.log.distance == Distance::Laplacian)
        .then(|| decisions::manifest(job))
        .flatten();
    manifest.iter().map(report_table).collect()
}

fn texts<const N: usize>(texts: [&str; N]) -> Vec<String> {
    texts.map(str::to_owned).to_vec()
}

/// Returns the table of all settings, in the order of the rule.
fn candidates(evaluation: &ControlEvaluation) -> Table {
    let (verdict, selection) = (&evaluation.verdict, &evaluation.verdict.selection);
    let mut columns =
        texts(["setting", "", rank_name(evaluation.verdict.rule), "model return", "not covered"]);
    let mut caption = "By rank over the ensemble members of all models. The return in the model ranks settings, and is not what the plant will give. Not covered: steps for which the log has no such action near.".to_owned();
    if !evaluation.fitted_q_evaluation.is_empty() {
        columns.push("fitted Q".to_owned());
        caption.push_str(" Fitted Q, and importance sampling where probabilities were logged, need no model. They are discounted by gamma and not cut after the timeout, unlike returns in the model. Where fitted Q did not converge, more passes over the log would give another value. An impossible one is beyond what the recorded rewards can add up to, which happens if the log hardly has the actions that the setting takes. Importance sampling rests on so many episodes.");
    }
    if evaluation.importance_sampling.is_some() {
        columns.extend(texts(["importance", "of episodes"]));
    }
    if evaluation.doubly_robust.is_some() {
        columns.push("doubly robust".to_owned());
        caption.push_str(
            " The doubly robust estimate corrects fitted Q on the same episodes, and needs both.",
        );
    }
    Table {
        title: "Settings".to_owned(),
        caption,
        columns,
        rows: show::best(evaluation, evaluation.candidates.len())
            .into_iter()
            .map(|candidate: usize| {
                let mut row = vec![
                    Cell::Text(evaluation.setting_name(candidate)),
                    Cell::Text(show::role(evaluation, candidate).to_owned()),
                    Cell::Text(show::rank(evaluation, candidate)),
                    if evaluation.has_failed(candidate) {
                        Cell::Text(show::FAILED.to_owned())
                    } else {
                        Cell::Number(selection.mean_errors[candidate])
                    },
                    Cell::Percent(verdict.coverage[candidate].uncovered()),
                ];
                row.extend(evaluation.fitted_q_evaluation.get(candidate).map(|fitted| {
                    if fitted.is_impossible() {
                        Cell::Text(show::IMPOSSIBLE.to_owned())
                    } else if fitted.converged || fitted.value.is_infinite() {
                        Cell::Number(fitted.value)
                    } else {
                        let value = calib_core::number(fitted.value);
                        Cell::Text(format!("{value} (did not converge)"))
                    }
                }));
                if let Some(estimates) = &evaluation.importance_sampling {
                    let Importance { value, effective_episodes } = estimates[candidate];
                    row.extend([
                        value.map_or(Cell::Missing, Cell::Number),
                        Cell::Number(effective_episodes),
                    ]);
                }
                if let Some(values) = &evaluation.doubly_robust {
                    row.push(values[candidate].map_or(Cell::Missing, Cell::Number));
                }
                row
            })
            .collect(),
        best: None,
    }
}

fn actions(evaluation: &ControlEvaluation) -> Table {
    let log = &evaluation.log;
    Table {
        title: "Actions".to_owned(),
        caption: "How often each action was taken, and in what share of the recorded states a step with it lies within the radius.".to_owned(),
        columns: texts(["action", "taken", "of the log", "known in states"]),
        rows: log.actions.iter().map(|action| {
        vec![
            Cell::Text(action.name.clone()),
            Cell::Count(action.transitions as u64),
            Cell::Percent(action.transitions as f64 / log.transitions as f64),
            Cell::Percent(action.covered),
        ]
    }).collect(),
        best: None,
    }
}

/// Returns the table of the held-out periods, if there are any.
fn held_out(evaluation: &ControlEvaluation) -> Option<Table> {
    (!evaluation.held_out.is_empty()).then(|| show::held_out(evaluation, Cell::Missing))
}

/// Returns the numbers of the maps, one table per column.
fn maps(evaluation: &ControlEvaluation) -> Vec<Table> {
    evaluation.log.map.iter().take(figures::MAPS).map(|map| {
        Table {
            title: format!("Coverage along {}", map.column),
            caption: "Share of the recorded states of each fifth of the column near which the action was taken.".to_owned(),
            columns: std::iter::once("action".to_owned()).chain(map.upper.iter().map(|upper| format!("to {}", calib_core::number(*upper)))).collect(),
            rows: evaluation.log.actions.iter().zip(&map.covered).map(|(action, covered)| {
            let shares = covered.iter().map(|&share| Cell::Percent(share));
            std::iter::once(Cell::Text(action.name.clone())).chain(shares).collect()
        }).collect(),
            best: None,
        }
    }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn told(keys: &str) -> String {
        let config: ControlConfig = toml::from_str(keys).expect("valid");
        episode_told(&config, 60.0)
    }

    #[test]
    fn an_episode_is_told_in_words() {
        assert_eq!(
            told("reward = 'gain'\ntimeout = 50"),
            "The reward of a step is the column gain. It is read in the row that the step led to. Agents decide in every row, and from one \
             decision to the next it is 1 min. No episode ends in a terminal, because the study names none. In the models an episode is cut after \
             50 decisions (control.timeout), which are 50 min."
        );
        let dosed = told("actions = ['dose']\nreward = [{ column = 'dose', weight = -1 }]");
        let part = "is -1 × dose. It is read in the row that the step led to, and actions in the row before it. ";
        assert!(dosed.contains(part), "{dosed}");
        let steps = told("reward_row = 'same'\nevery = 3\nterminal = 'trip'");
        for part in [
            "It is read in the row of its action. ",
            "Agents decide once every 3 rows (control.every), and",
            "An episode ends in a row in which trip is not 0 (control.terminal).",
        ] {
            assert!(steps.contains(part), "{steps}");
        }
    }
}
