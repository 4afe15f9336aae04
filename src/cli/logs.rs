//! Arguments of the commands on a log.

use std::path::PathBuf;

use calib_pipeline::{DecisionColumns, ExistingFile, ProposeOptions};
use clap::Args;

use super::heading::OUTPUT;

#[derive(Debug, Args)]
pub(crate) struct InspectArgs {
    /// A study file, or a log: a file (Parquet, CSV), folder or glob
    pub(crate) data: PathBuf,
    /// Override a key of the study, such as `preprocess.max_missing=0.2`
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE")]
    pub(crate) set: Vec<String>,
    /// Use this profile from the study's [profiles]
    #[arg(long, value_name = "NAME")]
    pub(crate) profile: Option<String>,
    /// Show all channels, not only the first of a long list
    #[arg(long)]
    pub(crate) all: bool,
    /// Print the profile as JSON
    #[arg(long, help_heading = OUTPUT)]
    pub(crate) json: bool,
}

#[derive(Debug, Args)]
pub(crate) struct InitArgs {
    /// The log: a file (Parquet, CSV), folder or glob
    pub(crate) logs: PathBuf,
    /// The study file to write
    #[arg(default_value = "study.toml")]
    pub(crate) study: PathBuf,
    /// How long this command and `calib run` on the study may take together on this machine, such as 90s, 10m or 2h
    #[arg(long, value_name = "TIME", default_value = "10m", value_parser = seconds)]
    pub(crate) within: f64,
    /// A sensor to predict; may be given several times (default: three that vary and differ from each other)
    #[arg(long = "sensor", value_name = "NAME")]
    pub(crate) sensors: Vec<String>,
    /// How far ahead to predict, such as 100s or 10m (default: by the autocorrelation of the sensors)
    #[arg(long, value_name = "TIME", value_parser = seconds)]
    pub(crate) horizon: Option<f64>,
    /// A column of the actions that were taken: the study is of agents that act; may be given several times
    #[arg(long = "action", value_name = "NAME", conflicts_with_all = ["sensors", "horizon"])]
    pub(crate) actions: Vec<String>,
    /// The column with the reward of the step that led to a row; give a reward of terms with `--set 'control.reward=[...]'` instead
    #[arg(long, value_name = "NAME", requires = "actions")]
    pub(crate) reward: Option<String>,
    /// The column that is not 0 where an episode ended for good (default: none does)
    #[arg(long, value_name = "NAME", requires = "actions")]
    pub(crate) terminal: Option<String>,
    /// The column with the probability of the action that was taken (default: it was not logged)
    #[arg(long, value_name = "NAME", requires = "actions")]
    pub(crate) probability: Option<String>,
    /// Set a key of [data], or of [control] beside --action, such as `data.time_zone=Europe/Paris` or `control.every=6`; it holds for the study too; may be given several times
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE")]
    pub(crate) set: Vec<String>,
    /// Replace the study file if it is there
    #[arg(long)]
    pub(crate) force: bool,
    /// Print what was chosen as JSON
    #[arg(long, help_heading = OUTPUT)]
    pub(crate) json: bool,
}

/// Reads a time span such as `90s`, `10m`, `2h` or `1d`, and returns seconds. A number without a unit is ambiguous, and an error.
fn seconds(text: &str) -> Result<f64, String> {
    known_seconds(text)
        .ok_or_else(|| format!("expected a time with a unit, such as 90s, 10m or 2h, got '{text}'"))
}

/// Returns the seconds of a time span, if it has a known unit and is above 0.
fn known_seconds(text: &str) -> Option<f64> {
    let unit = text.trim_start_matches(|c: char| c.is_ascii_digit() || c == '.').trim();
    let number: f64 = text[..text.len() - unit.len()].trim().parse().ok()?;
    let factor = match unit {
        "s" | "sec" => 1.0,
        "m" | "min" => 60.0,
        "h" => 3_600.0,
        "d" => 86_400.0,
        _ => return None,
    };
    (number > 0.0).then_some(number * factor)
}

#[derive(Debug, Args)]
pub(crate) struct ImportArgs {
    /// The logs: a file, folder or glob
    pub(crate) logs: PathBuf,
    /// The Parquet file to write
    pub(crate) out: PathBuf,
    /// Set a key of [data], such as `data.timestamp_format=%d.%m.%Y` or `data.resample=last`; may be given several times
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE")]
    pub(crate) set: Vec<String>,
    /// Replace the file if it is there
    #[arg(long)]
    pub(crate) force: bool,
    /// Print what was written as JSON
    #[arg(long, help_heading = OUTPUT)]
    pub(crate) json: bool,
}

impl InitArgs {
    /// Returns the columns of acting agents; `None` if agents only predict.
    pub(crate) fn decision_columns(&self) -> Option<DecisionColumns> {
        // Other columns require an action.
        if self.actions.is_empty() {
            return None;
        }
        Some(DecisionColumns {
            actions: self.actions.clone(),
            reward: self.reward.clone(),
            terminal: self.terminal.clone(),
            probability: self.probability.clone(),
        })
    }
}

impl From<InitArgs> for ProposeOptions {
    fn from(args: InitArgs) -> Self {
        let InitArgs { logs, study, within, sensors, horizon, set, force, .. } = args;
        let existing = if force { ExistingFile::Replaced } else { ExistingFile::Kept };
        Self { logs, study, within, sensors, horizon, set, existing }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spans_of_time_are_read_as_people_write_them() {
        let read = ["90s", "10m", "1.5 h", "2d"].map(|text| seconds(text).expect("a time"));
        assert_eq!(read, [90.0, 600.0, 5_400.0, 172_800.0]);
        for bad in ["", "90", "soon", "-3m", "0", "10 apples", "."] {
            assert!(seconds(bad).is_err(), "{bad}");
        }
    }
}
