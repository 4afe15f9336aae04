use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use calib_stats::RankRule;

use crate::{
    ActionModelConfig, ActionModelKind, AgentConfig, ControlError, Grid, LEAST_LEVELS, Reward,
    RunLength, Support, error::check_fields,
};

/// `[control]`: an agent that acts, tuned on a log with actions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ControlConfig {
    /// Columns of the action that was taken in a row, until the next row. Every combination of values that occurs is an action. A row with
    /// a missing value in one of them ends an episode.
    pub actions: Vec<String>,
    /// The reward of the step that led to a row: a column, or a list of weighted terms.
    pub reward: Reward,
    /// The row that holds the reward and the terminal of a step: the next row, which the step led to, or the row of its action.
    pub reward_row: RewardRow,
    /// The column that is not 0 where an episode ended and nothing follows. Default: no episode ends in a terminal.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub terminal: Option<String>,
    /// The column with the probability of the action that was taken, above 0 and up to 1. With it, settings are also evaluated by
    /// importance sampling and the doubly robust estimator. Default: the probability was not logged.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub probability: Option<String>,
    /// Rows from one decision of an agent to the next. Rewards of the rows between are summed, and the action of the first row counts.
    #[schemars(range(min = 1, max = 1_000_000))]
    pub every: usize,
    /// Rows from the one in which an action was decided to the one in which the log shows it.
    #[schemars(range(min = 0, max = 1_000_000))]
    pub lag: usize,
    /// Steps after which an episode is cut; a step is a decision.
    #[schemars(range(min = 1))]
    pub timeout: usize,
    /// Steps of each training run, for each setting in each ensemble member.
    #[schemars(range(min = 1))]
    pub steps: usize,
    /// Runs of each setting in each ensemble member.
    #[schemars(range(min = 1, max = 100_000))]
    pub runs: usize,
    /// For continuous actions: how many levels of each action column an agent chooses among. The levels are an even grid over the recorded
    /// range of the column, or its own values if it has no more than that, or one value of each narrow cluster of values. The model then
    /// treats the recorded action as a number: neighbours are near in the state and in the action. Default: every combination of values
    /// that occurs is an action of its own.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 2, max = 1024))]
    pub levels: Option<usize>,
    /// Maximum number of actions. calib refuses a log with more, because each action needs neighbours of its own.
    #[schemars(range(min = 1, max = 1024))]
    pub most_actions: usize,
    /// The return that an episode ends with where the log does not cover a step. Default: the return of the worst recorded episode.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub worst_return: Option<f64>,
    /// Where episodes start in the model.
    pub start: StartRows,
    /// The largest share of the chosen setting's steps, or of the decisions of a held-out period, that the log may leave uncovered; above it,
    /// calib refuses the choice.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub most_uncovered: f64,
    /// Minimum number of terminals in a log whose study names a terminal; below it, calib refuses a choice.
    pub fewest_terminals: usize,
    /// Kinds of models that agents act in. Each kind has `model.members` ensemble members, each without one block of the log.
    pub models: Vec<ActionModelKind>,
    /// How a setting is chosen from its ranks in all ensemble members.
    pub rule: RankRule,
    /// The neighbours, which increments also use, and the number of ensemble members of every kind.
    pub model: ActionModelConfig,
    /// The agent. It is also the default that a choice is compared with.
    pub agent: AgentConfig,
    /// The values to sweep.
    pub grid: Grid,
}

/// The largest number of rows of a decision, and the largest lag in rows.
const MOST_ROWS: usize = 1_000_000;
/// The most runs of a setting in an ensemble member, as in sweeps of agents that predict.
const MOST_RUNS: usize = 100_000;

/// The row of a log that holds the reward and the terminal of a step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum RewardRow {
    /// The row that the step led to, as in logs of sensors at every time.
    #[default]
    Next,
    /// The row of the action, as in logs of steps: state, action, reward, end.
    Same,
}

/// Where episodes start in the model of a log.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum StartRows {
    /// In the first row of a recorded episode.
    #[default]
    Episodes,
    /// In any row from which an action was taken: for a log that is one long episode.
    Anywhere,
}

impl Default for ControlConfig {
    fn default() -> Self {
        Self {
            actions: Vec::new(),
            reward: Reward::default(),
            reward_row: RewardRow::Next,
            terminal: None,
            probability: None,
            every: 1,
            lag: 0,
            timeout: 500,
            steps: 15_000,
            runs: 1,
            levels: None,
            most_actions: 64,
            worst_return: None,
            start: StartRows::Episodes,
            most_uncovered: Support::default().most_uncovered,
            fewest_terminals: Support::default().fewest_terminals,
            models: ActionModelKind::ALL.to_vec(),
            rule: RankRule::default(),
            model: ActionModelConfig::default(),
            agent: AgentConfig::default(),
            grid: Grid::default(),
        }
    }
}

impl ControlConfig {
    /// Checks the value of each key on its own.
    ///
    /// # Errors
    /// If a value is not valid. The error names the first such key.
    pub fn check(&self) -> Result<(), ControlError> {
        if self.actions.is_empty() {
            return Err(ControlError::NoActions);
        }
        self.refuse_repeated_columns()?;
        if self.levels.is_some() && self.probability.is_some() {
            return Err(ControlError::ProbabilityOfLevels);
        }
        let levels = self.levels.unwrap_or(LEAST_LEVELS);
        let checks = [
            ("levels", levels as f64, (LEAST_LEVELS..=1024).contains(&levels), "from 2 to 1024"),
            (
                "every",
                self.every as f64,
                (1..=MOST_ROWS).contains(&self.every),
                "from 1 to 1,000,000",
            ),
            ("lag", self.lag as f64, self.lag <= MOST_ROWS, "from 0 to 1,000,000"),
            (
                "lag",
                self.lag as f64,
                self.lag == 0 || self.reward_row == RewardRow::Next,
                "0 beside `reward_row = \"same\"`",
            ),
            ("timeout", self.timeout as f64, self.timeout > 0, "at least 1"),
            ("steps", self.steps as f64, self.steps > 0, "at least 1"),
            ("runs", self.runs as f64, (1..=MOST_RUNS).contains(&self.runs), "from 1 to 100,000"),
            (
                "most_actions",
                self.most_actions as f64,
                (1..=1024).contains(&self.most_actions),
                "from 1 to 1024",
            ),
            (
                "worst_return",
                self.worst_return.unwrap_or(0.0),
                self.worst_return.unwrap_or(0.0).is_finite(),
                "a finite number",
            ),
            (
                "most_uncovered",
                self.most_uncovered,
                (0.0..=1.0).contains(&self.most_uncovered),
                "from 0 to 1",
            ),
        ];
        check_fields(&checks)?;
        if self.models.is_empty() {
            return Err(ControlError::NoModels);
        }
        let mut models = self.models.iter().enumerate();
        if let Some((_, kind)) = models.find(|&(place, kind)| self.models[..place].contains(kind)) {
            return Err(ControlError::RepeatedModel { kind: kind.name() });
        }
        self.reward.check()?;
        self.model.check().map_err(|error| error.in_section("model"))?;
        self.agent.check().map_err(|error| error.in_section("agent"))?;
        self.grid.candidates(self.agent).map(|_| ())
    }

    /// Refuses a column that has two roles. Terms of a reward may use the column of an action or a terminal.
    fn refuse_repeated_columns(&self) -> Result<(), ControlError> {
        let others = [
            ("reward", self.reward.recorded_column()),
            ("terminal", self.terminal.as_ref()),
            ("probability", self.probability.as_ref()),
        ];
        let others = others.into_iter().filter_map(|(key, column)| Some((key, column?)));
        let actions = self.actions.iter().map(|column| ("actions", column));
        let named: Vec<(&'static str, &String)> = actions.chain(others).collect();
        for (place, &(key, column)) in named.iter().enumerate() {
            let before = named[..place].iter().find(|(_, other)| *other == column);
            if let Some(&(before, _)) = before {
                return Err(ControlError::RepeatedColumn { key, column: column.clone(), before });
            }
        }
        Ok(())
    }

    /// Returns the number of ensemble members of all kinds of models.
    pub fn all_members(&self) -> usize {
        self.models.len() * self.model.members
    }

    /// Returns the number of runs of each setting, over all ensemble members.
    pub fn runs_of_a_setting(&self) -> usize {
        self.all_members() * self.runs
    }

    /// Returns the length of each training run.
    pub fn run_length(&self) -> RunLength {
        RunLength { steps: self.steps, timeout: self.timeout }
    }

    /// Returns the most steps of an episode. An agent with fewer steps than the timeout has no longer episodes.
    pub fn longest_episode(&self) -> usize {
        self.timeout.min(self.steps)
    }

    /// Returns the columns that are not part of the state: actions, the reward if a column holds it, the terminal and the probability.
    pub fn beside_the_state(&self) -> Vec<String> {
        let reward = self.reward.recorded_column();
        let columns = self.actions.iter().chain(reward).chain(&self.terminal);
        columns.chain(&self.probability).cloned().collect()
    }

    /// Returns the columns that are read as they were recorded, each once: actions, those of the reward, the terminal and the probability.
    pub fn columns(&self) -> Vec<String> {
        let mut columns = self.actions.clone();
        for column in self.reward.columns().chain(&self.terminal).chain(&self.probability) {
            if !columns.contains(column) {
                columns.push(column.clone());
            }
        }
        columns
    }

    /// Returns the column of terminals, if the study names one, of the columns [`columns`](Self::columns) as `recorded`.
    ///
    /// # Panics
    /// If there is not one list per column.
    pub fn terminal_of<'a>(&self, recorded: &'a [Vec<f64>]) -> Option<&'a [f64]> {
        let terminal = self.terminal.as_ref()?;
        let place = self.columns().iter().position(|column| column == terminal)?;
        Some(&recorded[place])
    }

    /// Returns the key of `[control]` that names one of these columns, such as `reward[2].set_point`.
    pub fn key_of(&self, column: &str) -> String {
        if self.actions.iter().any(|action| action == column) {
            return "actions".to_owned();
        }
        let is_terminal = self.terminal.as_deref() == Some(column);
        let other = if is_terminal { "terminal" } else { "probability" };
        self.reward.key_of(column).unwrap_or_else(|| other.to_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_section_is_read_and_checked() {
        let text = r#"
            actions = ["dose", "interval"]
            terminal = "stopped"
            probability = "odds"
            reward = [
                { column = "permeate" },
                { column = "pressure", weight = -2.0, high = 0.4 },
                { column = "permeate", set_point = 10.0, weight = -0.1 },
                { column = "level", set_point = "level_target", weight = -0.1 },
            ]
            [grid]
            step_size = [0.01, 0.1]
        "#;
        let config: ControlConfig = toml::from_str(text).expect("valid");
        config.check().expect("valid");
        assert_eq!(
            config.columns(),
            [
                "dose",
                "interval",
                "permeate",
                "pressure",
                "level",
                "level_target",
                "stopped",
                "odds"
            ]
        );
        for (column, key) in [
            ("interval", "actions"),
            ("pressure", "reward[1].column"),
            ("level_target", "reward[3].set_point"),
            ("stopped", "terminal"),
            ("odds", "probability"),
        ] {
            assert_eq!(config.key_of(column), key);
        }
        assert_eq!(config.beside_the_state(), ["dose", "interval", "stopped", "odds"]);
        assert!(toml::from_str::<ControlConfig>("action = 'dose'").is_err(), "no such key");
        let told = ControlConfig::default().check().expect_err("no action").to_string();
        assert!(told.contains("`actions`"), "{told}");
        let told = ControlConfig { levels: Some(7), ..config.clone() }.check();
        assert!(told.expect_err("densities").to_string().contains("control.probability"));
        let one = ControlConfig { levels: Some(1), probability: None, ..config.clone() };
        assert!(one.check().expect_err("one").to_string().contains("levels"));
        let none = ControlConfig { models: Vec::new(), ..config.clone() }.check();
        assert!(none.expect_err("none").to_string().contains("control.models"));
        let network = ActionModelKind::Network;
        let twice = ControlConfig { models: vec![network; 2], ..config.clone() }.check();
        assert!(twice.expect_err("twice").to_string().contains("\"network\" twice"));
        let never = ControlConfig { every: 0, ..config.clone() };
        assert!(never.check().expect_err("never").to_string().contains("`every` is 0"));
        let many = ControlConfig { runs: usize::MAX, ..config.clone() };
        assert!(many.check().expect_err("many").to_string().contains("from 1 to 100,000"));
        let none = ControlConfig { steps: 0, ..config };
        assert!(none.check().expect_err("none").to_string().contains("steps"));
    }

    fn checked(text: &str) -> Result<(), ControlError> {
        toml::from_str::<ControlConfig>(text).expect("valid").check()
    }

    #[test]
    fn a_column_is_one_thing() {
        for (text, keys) in [
            ("actions = ['dose', 'dose']", ["actions", "actions"]),
            ("actions = ['dose']\nreward = 'dose'", ["reward", "actions"]),
            ("actions = ['dose']\nterminal = 'dose'", ["terminal", "actions"]),
            ("actions = ['dose']\nterminal = 'reward'", ["terminal", "reward"]),
            (
                "actions = ['dose']\nterminal = 'end'\nprobability = 'end'",
                ["probability", "terminal"],
            ),
        ] {
            let told = checked(text).expect_err("two things").to_string();
            let [key, before] = keys;
            assert!(told.starts_with(&format!("control.{key} names ")), "{told}");
            assert!(told.contains(&format!(", which control.{before} names already")), "{told}");
        }
        let charged = "[{ column = 'dose', weight = -1 }, { column = 'end', weight = -9 }]";
        checked(&format!("actions = ['dose']\nterminal = 'end'\nreward = {charged}"))
            .expect("terms may charge for what was done, and for the end");
    }
}
