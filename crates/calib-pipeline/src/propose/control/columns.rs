//! The columns that the arguments of `calib init` name as actions, rewards and terminals.

use calib_base::{StepError, bail, ensure, options::ProposeOptions};
use calib_control::ControlConfig;
use calib_data::{ChannelSketch, Sketch, entry_of};
use calib_propose::DecisionColumns;

use crate::propose::{given::gives, look::similar};

/// The key of a reward of terms.
pub(super) const REWARD: &str = "control.reward";

/// Words in names of columns that are rarely part of the state.
const TELLING: [&str; 6] = ["action", "done", "probability", "return", "reward", "terminal"];

/// Whether the log may have columns that were not examined, because `data.include` or `data.exclude` was given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum LookedAt {
    Whole,
    Part,
}

/// Refuses a column that is named for two roles.
pub(super) fn refuse_repeated(columns: &DecisionColumns) -> Result<(), StepError> {
    let named: Vec<(&str, &String)> = columns.with_arguments().collect();
    for (place, (argument, name)) in named.iter().enumerate() {
        if let Some((before, _)) = named[..place].iter().find(|(_, other)| other == name) {
            bail!("{argument} {name}: {before} names this column already; name another one");
        }
    }
    Ok(())
}

/// Refuses two rewards, and none.
pub(super) fn require_reward(
    columns: &DecisionColumns,
    args: &ProposeOptions,
) -> Result<(), StepError> {
    let has_terms = gives(args, REWARD);
    if let Some(name) = columns.reward.as_ref().filter(|_| has_terms) {
        bail!(
            "--reward {name}: --set {REWARD} gives a reward too; leave one of them out, and name the column in a term if it counts"
        );
    }
    ensure!(
        has_terms || columns.reward.is_some(),
        "--action {}: agents need a reward; name its column with --reward, or give its terms with --set '{REWARD}=[...]'",
        columns.actions.join(" --action ")
    );
    Ok(())
}

/// Refuses a recorded reward that `--set` names. calib checks the column of `--reward` before it reads the decisions.
pub(super) fn require_terms(
    columns: &DecisionColumns,
    config: &ControlConfig,
) -> Result<(), StepError> {
    if columns.reward.is_none()
        && let Some(name) = config.reward.recorded_column()
    {
        bail!(
            "--set {REWARD}: {name} is one column, which holds the reward; name it with --reward"
        );
    }
    Ok(())
}

/// Refuses columns that are missing, have no numbers, or have no effect.
pub(super) fn check(
    columns: &DecisionColumns,
    sketch: &Sketch,
    looked_at: LookedAt,
) -> Result<(), StepError> {
    for (argument, name) in columns.with_arguments() {
        let Some(channel) = channel(sketch, name) else {
            // A column that is left out of the states can still be read.
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
            if let Some(text) = &channel.text {
                bail!(
                    "{argument} {name}: the column holds no number, but text, such as {text:?}; write its values as numbers, or name another one"
                );
            }
            bail!("{argument} {name}: the column is empty; name another one");
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

/// Returns the number of different values of each action column. `None` for a column with very many.
pub(super) fn distinct(columns: &DecisionColumns, sketch: &Sketch) -> Vec<Option<u32>> {
    let channels = columns.actions.iter().map(|name| channel(sketch, name));
    channels.map(|channel| channel.and_then(|channel| channel.distinct)).collect()
}

/// Returns a warning about state columns with names of actions, rewards or endings.
pub(super) fn unnamed(state: &[String]) -> Option<String> {
    let found: Vec<&str> =
        state.iter().map(String::as_str).filter(|name| is_telling(name)).collect();
    if found.is_empty() {
        return None;
    }
    let entries: Vec<String> =
        found.iter().map(|name| format!("{:?}", entry_of(name, |_| false))).collect();
    Some(format!(
        "the state has {}, which may be what an agent does or gets: name such a column with --action, --reward, --terminal or \
         --probability, or leave it out with --set 'data.exclude=[{}]'",
        found.join(", "),
        entries.join(", ")
    ))
}

/// Whether the last word of a name means an action, a reward or the end of an episode. `return` does,
/// `return_temperature` does not.
fn is_telling(name: &str) -> bool {
    let last = name.rsplit(|letter: char| !letter.is_alphanumeric()).next().unwrap_or(name);
    TELLING.iter().any(|word| last.eq_ignore_ascii_case(word))
}

fn channel<'a>(sketch: &'a Sketch, name: &str) -> Option<&'a ChannelSketch> {
    sketch.channels.iter().find(|channel| channel.name == name)
}

#[cfg(test)]
mod tests {
    use calib_files::ExistingFile;

    use super::*;

    #[test]
    fn columns_that_are_no_state_are_told() {
        let state = ["level", "return_temperature", "interaction", "done_by"].map(str::to_owned);
        assert_eq!(unnamed(&state), None);
        let state = ["level", "Is.Done", "RETURN"].map(str::to_owned);
        let both = unnamed(&state).expect("two");
        assert!(both.starts_with("the state has Is.Done, RETURN, which may be"), "{both}");
        assert!(both.ends_with("--set 'data.exclude=[\"Is.Done\", \"RETURN\"]'"), "{both}");
    }

    #[test]
    fn a_reward_is_a_column_or_terms() {
        let args = |set: &[&str]| ProposeOptions {
            logs: "log.csv".into(),
            study: "study.toml".into(),
            within: 1.0,
            sensors: Vec::new(),
            horizon: None,
            set: set.iter().map(|&one| one.to_owned()).collect(),
            existing: ExistingFile::Kept,
        };
        let terms = args(&["control.reward=[{ column = \"level\" }]"]);
        let named = columns("stopped");
        let unnamed = DecisionColumns { reward: None, ..named.clone() };
        require_reward(&named, &args(&[])).expect("a column");
        require_reward(&unnamed, &terms).expect("terms");
        for (columns, args, expected) in [
            (&named, &terms, "--reward gain: --set control.reward gives a reward too"),
            (&unnamed, &args(&[]), "--action dose --action interval: agents need a reward"),
        ] {
            let told = require_reward(columns, args).expect_err("refused").to_string();
            assert!(told.starts_with(expected), "{told}");
        }
        let config = ControlConfig::default();
        require_terms(&named, &config).expect("named with --reward");
        let told = require_terms(&unnamed, &config).expect_err("refused").to_string();
        assert!(told.starts_with("--set control.reward: reward is one column"), "{told}");
    }

    fn columns(terminal: &str) -> DecisionColumns {
        DecisionColumns {
            actions: vec!["dose".to_owned(), "interval".to_owned()],
            reward: Some("gain".to_owned()),
            terminal: Some(terminal.to_owned()),
            probability: None,
        }
    }

    #[test]
    fn a_column_is_one_thing() {
        refuse_repeated(&columns("stopped")).expect("all differ");
        let told = refuse_repeated(&columns("dose")).expect_err("twice").to_string();
        assert!(told.starts_with("--terminal dose: --action names this column already"), "{told}");
    }
}
