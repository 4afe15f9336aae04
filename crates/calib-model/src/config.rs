use calib_core::RowIndex;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The `[rollout]` section of a study.
///
/// | key | default | meaning |
/// |---|---|---|
/// | `steps` | 30000 | steps of each rollout (as in the paper, on one week of data) |
/// | `rollouts` | 3 | rollouts of each ensemble member |
/// | `start` | `"random"` | start states: `"random"`, `"rows"`, `"recent"`, `"calendar_month"`, `"nearest"` |
/// | `rows` | `[]` | for `"rows"`: rows of the data; rollout `r` takes entry `r` modulo their number |
/// | `timestamps` | `[]` | for `"rows"`: start rows by time, written as in the log |
/// | `absent` | `"external"` | for `"rows"`: what happens to a row that an ensemble member lacks: `"external"`, `"replace"` |
/// | `recent_window` | none | for `"recent"`: start states are spread over this many of the latest states (default: the last tenth of the states before the deployment) |
/// | `month` | none | for `"calendar_month"`: 1 to 12 (default: the month in which the held-out period begins) |
/// | `dtw_steps` | 3000 | steps of each rollout that are compared with the recorded trajectory (as in the paper, on twelve months of data); 0 for no comparison |
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RolloutConfig {
    /// Steps of each rollout.
    pub steps: usize,
    /// Rollouts of each ensemble member.
    pub rollouts: usize,
    /// Where rollouts start.
    pub start: StartKind,
    /// Start rows.
    #[schemars(with = "Vec<u32>")]
    pub rows: Vec<RowIndex>,
    /// Start rows by time, written as in the log.
    pub timestamps: Vec<String>,
    /// How a start row is treated that an ensemble member lacks.
    pub absent: Absent,
    /// Number of latest states over which recent start states are spread (default: the last tenth).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub recent_window: Option<usize>,
    /// Month of the start states, 1 to 12.
    pub month: Option<u8>,
    /// Steps of each rollout that are compared with the recorded trajectory; 0 for no comparison.
    pub dtw_steps: usize,
}

impl Default for RolloutConfig {
    fn default() -> Self {
        Self {
            steps: 30_000,
            rollouts: 3,
            start: StartKind::Random,
            rows: Vec::new(),
            timestamps: Vec::new(),
            absent: Absent::External,
            recent_window: None,
            month: None,
            dtw_steps: 3000,
        }
    }
}

impl RolloutConfig {
    /// Returns the settings that decide where rollouts start, with everything else at its default. Sweeps, which have
    /// their own lengths and numbers of rollouts, depend on nothing else in this section.
    #[must_use]
    pub fn starts(&self) -> Self {
        let Self { steps, rollouts, dtw_steps, .. } = Self::default();
        Self { steps, rollouts, dtw_steps, ..self.clone() }
    }
}

/// Where rollouts start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum StartKind {
    /// Uniform over the transitions of the ensemble member.
    #[default]
    Random,
    /// The rows in `rows` or `timestamps`.
    Rows,
    /// The latest rows before the deployment.
    Recent,
    /// The same calendar month as the deployment, in earlier years.
    CalendarMonth,
    /// The recorded states nearest to states of the deployment period.
    Nearest,
}

/// How a start row is treated that no transition of the ensemble member ends in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Absent {
    /// The rollout still starts there: its first step is drawn from the nearest sources in the ensemble member.
    #[default]
    External,
    /// The row is replaced by its nearest recorded state in the ensemble member.
    Replace,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_empty_section_is_the_documented_default() {
        let config: RolloutConfig = toml::from_str("").expect("all keys have defaults");
        assert_eq!(config, RolloutConfig::default());
        assert_eq!((config.steps, config.rollouts), (30_000, 3));
    }

    #[test]
    fn a_section_is_read() {
        let text = "steps = 3000\nrollouts = 30\nstart = \"calendar_month\"\nmonth = 7\nabsent = \"replace\"";
        let config: RolloutConfig = toml::from_str(text).expect("valid");
        assert_eq!(config.start, StartKind::CalendarMonth);
        assert_eq!((config.month, config.absent), (Some(7), Absent::Replace));
        let rows: RolloutConfig = toml::from_str("start = \"rows\"\nrows = [3, 9]").expect("valid");
        assert_eq!(rows.rows, [RowIndex(3), RowIndex(9)]);
        let compared: RolloutConfig =
            toml::from_str("start = \"rows\"\nrows = [3, 9]\ndtw_steps = 0").expect("valid");
        assert!(compared != rows && compared.starts() == rows.starts());
        assert!(toml::from_str::<RolloutConfig>("step = 3").is_err());
        assert!(toml::from_str::<RolloutConfig>("start = \"latest\"").is_err());
    }
}
