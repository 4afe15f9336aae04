//! The columns that `calib init` is told are actions, rewards and terminals.

use calib_base::{StepError, bail, ensure};
use calib_control::{ControlConfig, LEAST_LEVELS};
use calib_data::{ChannelSketch, Sketch};
use calib_propose::DecisionColumns;

use crate::propose::look::similar;

/// Whether the log may hold columns that were not looked at, because `data.include` or `data.exclude` was given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum LookedAt {
    Whole,
    Part,
}

/// Refuse a column that is named as two things.
pub(super) fn refuse_repeated(columns: &DecisionColumns) -> Result<(), StepError> {
    let named: Vec<(&str, &String)> = columns.with_arguments().collect();
    for (place, (argument, name)) in named.iter().enumerate() {
        if let Some((before, _)) = named[..place].iter().find(|(_, other)| other == name) {
            bail!("{argument} {name}: {before} names this column already; name another one");
        }
    }
    Ok(())
}

/// Refuse columns that are not there, have no numbers, or decide nothing.
pub(super) fn check(
    columns: &DecisionColumns,
    sketch: &Sketch,
    looked_at: LookedAt,
) -> Result<(), StepError> {
    for (argument, name) in columns.with_arguments() {
        let Some(channel) = channel(sketch, name) else {
            // What was left out of the states is read all the same.
            if looked_at == LookedAt::Part {
                continue;
            }
            let names = sketch.channels.iter().map(|channel| channel.name.as_str());
            bail!(
                "{argument} {name}: the log has no column of numbers with this name{} `calib inspect` shows all columns",
                similar(name, names)
            );
        };
        let Some([low, _]) = channel.range else {
            bail!(
                "{argument} {name}: the column is empty, or holds text; write its values as numbers, or name another one"
            );
        };
        let is_constant = channel.distinct == Some(1);
        ensure!(
            !(argument == "--action" && is_constant),
            "{argument} {name}: it is {low} in every row, so there is nothing to choose; name a column that was set to several values"
        );
        let is_complete = channel.present.iter().all(|&share| share >= 1.0);
        ensure!(
            !(argument == "--terminal" && is_constant && is_complete && low != 0.0),
            "{argument} {name}: it is {low} in every row, so every row ends an episode and no action leads anywhere; name a column that is 0 \
             where an episode goes on"
        );
    }
    Ok(())
}

/// Values that each column of the actions has; none where there are very many.
pub(super) fn distinct(columns: &DecisionColumns, sketch: &Sketch) -> Vec<Option<u32>> {
    let channels = columns.actions.iter().map(|name| channel(sketch, name));
    channels.map(|channel| channel.and_then(|channel| channel.distinct)).collect()
}

/// How a study that has actions which were hardly ever taken has fewer.
pub(super) fn fewer_actions(config: &ControlConfig) -> &'static str {
    match (config.levels, config.actions.len()) {
        (None, _) => "set control.levels",
        (Some(levels), _) if levels > LEAST_LEVELS => "set control.levels lower",
        (Some(_), 1) => "use a longer log",
        (Some(_), _) => "name fewer columns with --action",
    }
}

fn channel<'a>(sketch: &'a Sketch, name: &str) -> Option<&'a ChannelSketch> {
    sketch.channels.iter().find(|channel| channel.name == name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_levels_cannot_be_fewer() {
        let advice = |levels: Option<usize>, columns: usize| {
            let actions = vec!["dose".to_owned(); columns];
            fewer_actions(&ControlConfig { levels, actions, ..ControlConfig::default() })
        };
        assert_eq!(advice(None, 1), "set control.levels");
        assert_eq!(advice(Some(3), 2), "set control.levels lower");
        assert_eq!(advice(Some(2), 2), "name fewer columns with --action");
        assert_eq!(advice(Some(2), 1), "use a longer log");
    }

    #[test]
    fn a_column_is_one_thing() {
        let columns = |terminal: &str| DecisionColumns {
            actions: vec!["dose".to_owned(), "interval".to_owned()],
            reward: "gain".to_owned(),
            terminal: Some(terminal.to_owned()),
            probability: None,
        };
        refuse_repeated(&columns("stopped")).expect("all differ");
        let told = refuse_repeated(&columns("dose")).expect_err("twice").to_string();
        assert!(told.starts_with("--terminal dose: --action names this column already"), "{told}");
    }
}
