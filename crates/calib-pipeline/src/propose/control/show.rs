//! Prints a proposal for agents that act in a few lines.

use calib_base::{
    StepError,
    outcome::Told,
    output::{Printer, count, counted, duration, number, percent, span, table},
};
use calib_control::Algorithm;
use calib_study::shell_words;

use super::{ChosenControl, ProposedControlStudy};
use crate::{control::held, propose::show::beside_within};

/// Number of state columns that are named.
const NAMED: usize = 10;

impl Told<()> for ProposedControlStudy {
    fn tell(&self, _subject: &(), printer: &Printer) -> Result<(), StepError> {
        if printer.is_json() {
            printer.json(&self.chosen)?;
        } else {
            printer.result(&found(self))?;
            printer.result(&state(&self.chosen.columns))?;
            printer.lines(&actions(self))?;
            lines(self).iter().try_for_each(|line| printer.result(line))?;
        }
        printer.say(&format!("looked and tried for {}", duration(self.took)));
        let study = shell_words([self.study().display().to_string()]);
        printer.next(&[format!("calib run {study}")]);
        Ok(())
    }
}

/// Returns a line on the contents of the log.
fn found(proposed: &ProposedControlStudy) -> String {
    let chosen = &proposed.chosen;
    format!(
        "{}: {}; states of {}; mean recorded return {}",
        chosen.study.display(),
        held(chosen.transitions, chosen.episodes, chosen.terminals),
        counted(chosen.columns.len(), "column"),
        number(chosen.mean_return)
    )
}

/// Returns a line on the state columns.
fn state(columns: &[String]) -> String {
    let named = &columns[..columns.len().min(NAMED)];
    let more = columns.len() - named.len();
    let rest = if more > 0 { format!(" and {} more", count(more)) } else { String::new() };
    format!("state: {}{rest}", named.join(", "))
}

/// Returns a line on how often each action was taken.
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

/// Returns the values of the default, with their reasons.
fn numbers(chosen: &ChosenControl) -> String {
    let step_size = number(chosen.step_size);
    let spread = format!("the spread of recorded returns is {}", number(chosen.return_spread));
    match chosen.algorithm {
        Algorithm::ExpectedSarsa => {
            let temperature = number(chosen.temperature);
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

/// Returns lines on the chosen values, with reasons.
fn lines(proposed: &ProposedControlStudy) -> [String; 4] {
    let ProposedControlStudy { chosen, timeout_reason, gamma_reason, runs, within, .. } = proposed;
    let fixed = proposed.fixed_beyond.map_or_else(String::new, |secs| {
        format!("; {} of this time do not depend on the steps", span(secs))
    });
    let time = match chosen.expected_secs {
        Some(secs) => beside_within(secs, *within),
        None => format!("how long they take was not measured in {}", span(*within)),
    };
    [
        format!("episodes of at most {}: {timeout_reason}", counted(chosen.timeout, "step")),
        format!("gamma {}: {gamma_reason}", chosen.gamma),
        numbers(chosen),
        format!(
            "{} x {} of {}: {time}{fixed}",
            counted(chosen.settings, "setting"),
            counted(*runs, "run"),
            counted(chosen.steps, "step")
        ),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_columns_of_the_state_are_named() {
        let columns: Vec<String> = (1..=12).map(|number| format!("T{number}")).collect();
        assert_eq!(state(&columns[..2]), "state: T1, T2");
        let ten = "state: T1, T2, T3, T4, T5, T6, T7, T8, T9, T10";
        assert_eq!(state(&columns[..10]), ten);
        assert_eq!(state(&columns), format!("{ten} and 2 more"));
    }
}
