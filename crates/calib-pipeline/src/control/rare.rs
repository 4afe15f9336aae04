//! Warnings about actions that are rare in a log.

use calib_base::{
    StepError, bail,
    output::{Printer, count},
};
use calib_control::{ControlConfig, LEAST_LEVELS};
use calib_core::abridged_list;

/// Number of actions that a warning names.
const NAMED: usize = 3;

/// Refuses a log with a single action, and warns about rare actions.
pub(super) fn check_actions(
    names: &[String],
    counts: &[usize],
    config: &ControlConfig,
    printer: &Printer,
) -> Result<(), StepError> {
    if let Some(told) = only_action(names, config.every) {
        bail!(told);
    }
    if let Some(told) = hardly_taken(names, counts, config) {
        printer.warn(&told);
    }
    Ok(())
}

/// Returns the message for a log with a single action in all rows, or in every `every`-th row. Models then know no
/// other action, and agents have no choice.
pub(super) fn only_action(actions: &[String], every: usize) -> Option<String> {
    let [action] = actions else { return None };
    let rows = match every {
        1 => "every row".to_owned(),
        every => format!("every row in which agents decide (control.every = {every})"),
    };
    Some(format!(
        "control.actions: it is {action} in {rows}, so there is nothing to choose; name columns that were set to several values, or use a log in \
         which they were"
    ))
}

/// Returns the warning about actions that were taken in few or no steps, including levels. `names` and `counts` have the
/// name and the number of steps of each action. `None` if there are none.
pub(crate) fn hardly_taken(
    names: &[String],
    counts: &[usize],
    config: &ControlConfig,
) -> Option<String> {
    let hardly = calib_control::hardly_taken(counts);
    let counted = match hardly.len() {
        0 => return None,
        1 => "1 action was".to_owned(),
        several => format!("{} actions were", count(several)),
    };
    let steps = count(counts.iter().sum());
    let examples =
        hardly.iter().map(|&action| format!("{} ({} of {steps})", names[action], counts[action]));
    Some(format!(
        "{counted} hardly ever taken: {}. Models know little of what follows. If slips of the log are the reason, correct them there, or add \
         their values to data.missing_values if no column has them otherwise. If not, {}",
        abridged_list(examples, NAMED),
        fewer_actions(config)
    ))
}

/// Returns the advice on how to have fewer such actions.
fn fewer_actions(config: &ControlConfig) -> &'static str {
    match (config.levels, config.actions.len()) {
        // Levels have a probability density, and no probabilities.
        (None, _) if config.probability.is_some() => {
            "merge such actions with others in the log, or use a longer log"
        }
        (None, _) => "merge such actions with others in the log, or set control.levels",
        (Some(levels), _) if levels > LEAST_LEVELS => "set control.levels lower",
        (Some(_), 1) => "use a longer log",
        (Some(_), _) => "name fewer columns of actions",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn config(levels: Option<usize>, columns: usize) -> ControlConfig {
        let actions = vec!["dose".to_owned(); columns];
        ControlConfig { levels, actions, ..ControlConfig::default() }
    }

    #[test]
    fn actions_that_were_hardly_taken_are_counted_and_named() {
        let names: Vec<String> = (0..6).map(|dose| format!("dose={dose}")).collect();
        let config = config(None, 1);
        assert_eq!(hardly_taken(&names, &[30, 500, 30, 30, 30, 30], &config), None);
        let one = hardly_taken(&names, &[500, 500, 500, 499, 1_000, 1], &config).expect("one");
        assert!(one.starts_with("1 action was hardly ever taken: dose=5 (1 of 3,000). "), "{one}");
        let several = hardly_taken(&names, &[3_000, 0, 1, 2, 3, 500], &config).expect("four");
        let named = "4 actions were hardly ever taken: dose=1 (0 of 3,506), dose=2 (1 of 3,506), dose=3 (2 of 3,506), …. ";
        assert!(several.starts_with(named), "{several}");
    }

    #[test]
    fn a_single_action_leaves_nothing_to_choose() {
        let actions = ["valve=0", "valve=1"].map(str::to_owned);
        assert_eq!(only_action(&actions, 1), None);
        let told = only_action(&actions[..1], 1).expect("one");
        assert!(told.starts_with("control.actions: it is valve=0 in every row, so"), "{told}");
        let told = only_action(&actions[..1], 3).expect("one");
        assert!(told.contains("in which agents decide (control.every = 3)"), "{told}");
    }

    #[test]
    fn what_is_proposed_is_possible() {
        let advice =
            |levels: Option<usize>, columns: usize| fewer_actions(&config(levels, columns));
        assert!(advice(None, 1).ends_with("set control.levels"));
        assert_eq!(advice(Some(3), 2), "set control.levels lower");
        assert_eq!(advice(Some(2), 2), "name fewer columns of actions");
        assert_eq!(advice(Some(2), 1), "use a longer log");
        let logged = ControlConfig { probability: Some("odds".to_owned()), ..config(None, 1) };
        assert!(fewer_actions(&logged).ends_with("use a longer log"), "levels have no probability");
    }
}
