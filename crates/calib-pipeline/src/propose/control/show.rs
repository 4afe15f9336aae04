//! What was proposed for agents that act, in a few lines.

use calib_base::{
    StepError,
    outcome::Told,
    output::{Printer, count, counted, duration, percent, significant, span, table},
};
use calib_control::Algorithm;
use calib_study::shell_words;

use super::{ChosenControl, ProposedControlStudy};
use crate::control::held;

impl Told<()> for ProposedControlStudy {
    fn tell(&self, _subject: &(), printer: &Printer) -> Result<(), StepError> {
        if printer.is_json() {
            printer.json(&self.chosen)?;
        } else {
            printer.result(&found(self))?;
            printer.lines(&actions(self))?;
            lines(self).iter().try_for_each(|line| printer.result(line))?;
        }
        printer.say(&format!("looked and tried for {}", duration(self.took)));
        let study = shell_words([self.study().display().to_string()]);
        printer.next(&[format!("calib run {study}")]);
        Ok(())
    }
}

/// What the log holds.
fn found(proposed: &ProposedControlStudy) -> String {
    let chosen = &proposed.chosen;
    format!(
        "{}: {}; states of {}; mean recorded return {}",
        chosen.study.display(),
        held(chosen.transitions, chosen.episodes, chosen.terminals),
        counted(chosen.columns.len(), "column"),
        significant(chosen.mean_return)
    )
}

/// How often each action was taken.
fn actions(proposed: &ProposedControlStudy) -> String {
    let chosen = &proposed.chosen;
    let rows: Vec<_> = chosen
        .actions
        .iter()
        .map(|action| {
            let share = action.transitions as f64 / chosen.transitions as f64;
            vec![action.name.clone(), count(action.transitions), percent(share)]
        })
        .collect();
    let first = if chosen.levels.is_some() { "nearest level" } else { "action" };
    table(&[first, "taken", "of the log"], &rows)
}

/// The numbers of the default, and what they follow from.
fn numbers(chosen: &ChosenControl) -> String {
    let step_size = significant(chosen.step_size);
    let spread = format!("the spread of recorded returns is {}", significant(chosen.return_spread));
    match chosen.algorithm {
        Algorithm::ExpectedSarsa => {
            let temperature = significant(chosen.temperature);
            format!(
                "step size {step_size} and temperature {temperature}, in units of return: {spread}"
            )
        }
        Algorithm::QLearning => format!("step size {step_size}, in units of return: {spread}"),
        Algorithm::DeepQLearning => {
            format!("step size {step_size}, of weights of a network; {spread}")
        }
    }
}

/// What was chosen, and why.
fn lines(proposed: &ProposedControlStudy) -> [String; 4] {
    let ProposedControlStudy { chosen, timeout_reason, gamma_reason, runs, within, .. } = proposed;
    [
        format!("episodes of at most {}: {timeout_reason}", counted(chosen.timeout, "step")),
        format!("gamma {}: {gamma_reason}", chosen.gamma),
        numbers(chosen),
        format!(
            "{} x {} of {}: about {} of the {} that were asked for",
            counted(chosen.settings, "setting"),
            counted(*runs, "run"),
            counted(chosen.steps, "step"),
            span(chosen.expected_secs.round()),
            span(*within)
        ),
    ]
}
