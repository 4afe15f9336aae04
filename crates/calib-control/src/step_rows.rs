//! Converts logs of steps, in which the row of an action holds the reward and the end of its step.

use calib_core::Segments;

use crate::{ControlConfig, ControlError, Ending};

/// The columns of a log of steps, converted to rows that hold the reward and the end of the step that led to them.
///
/// A row that ends its episode comes twice, because the log does not have the state that its step led to: first as the row of the action, and
/// then as the terminal. Neighbours and agents take nothing from the state of a terminal, because nothing follows. Increments and networks
/// learn from the change that led to it, which is 0 here.
pub(crate) struct StepRows {
    /// The columns [`ControlConfig::columns`], `[columns][rows]`.
    pub(crate) recorded: Vec<Vec<f64>>,
    /// Unbroken segments of these rows.
    pub(crate) segments: Segments,
    /// The row of the log that each row comes from.
    pub(crate) rows: Vec<usize>,
    /// The row of the log with the reward of the step that led to each one; the row itself if no step did.
    pub(crate) rewarded: Vec<usize>,
}

/// A converted row.
struct Row {
    /// Its number in the log.
    number: usize,
    /// The row of the step that led to it; `None` if there is no such step.
    step: Option<usize>,
    /// Whether it is the end of an episode instead of the row of an action.
    is_end: bool,
}

impl StepRows {
    /// Converts a log whose columns [`ControlConfig::columns`] were recorded as `recorded`, `[columns][rows]`. The rows form `segments`.
    ///
    /// # Errors
    /// Never: rows of valid segments form valid segments.
    pub(crate) fn new(
        config: &ControlConfig,
        recorded: &[Vec<f64>],
        segments: &Segments,
    ) -> Result<Self, ControlError> {
        let endings = Ending::of_rows(config.terminal_of(recorded), segments.rows());
        let mut rows = Vec::with_capacity(segments.rows());
        let mut lengths = Vec::with_capacity(segments.len());
        for segment in segments.iter() {
            let before = rows.len();
            let mut step = None;
            for number in segment.rows() {
                rows.push(Row { number, step, is_end: false });
                step = Some(number);
                if endings[number] == Ending::Terminal {
                    rows.push(Row { number, step, is_end: true });
                    step = None;
                }
            }
            lengths.push(rows.len() - before);
        }
        let names = config.columns();
        let columns = names.iter().zip(recorded);
        Ok(Self {
            recorded: columns.map(|(name, column)| shown(config, name, column, &rows)).collect(),
            segments: Segments::from_lengths(lengths)?,
            rows: rows.iter().map(|row| row.number).collect(),
            rewarded: rows.iter().map(|row| row.step.unwrap_or(row.number)).collect(),
        })
    }
}

/// Returns the values of the column `name` in `rows`.
fn shown(config: &ControlConfig, name: &str, column: &[f64], rows: &[Row]) -> Vec<f64> {
    let is_action = config.actions.iter().any(|action| action == name);
    let is_decided = is_action || config.probability.as_deref() == Some(name);
    let is_terminal = config.terminal.as_deref() == Some(name);
    let values = rows.iter().map(|row| match row.step {
        _ if is_decided && row.is_end => f64::NAN,
        _ if is_decided => column[row.number],
        _ if is_terminal && row.is_end => column[row.number],
        _ if is_terminal => 0.0,
        Some(step) => column[step],
        None => f64::NAN,
    });
    values.collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{ColumnFindings, DecisionRows};

    const NONE: f64 = f64::NAN;

    fn config(keys: &str) -> ControlConfig {
        let text = format!("actions = ['valve']\nterminal = 'done'\nreward_row = 'same'\n{keys}");
        let config: ControlConfig = toml::from_str(&text).expect("valid");
        config.check().expect("valid");
        assert_eq!(config.columns(), ["valve", "reward", "done"]);
        config
    }

    /// Decisions of a log of six steps in two pieces, of which the third one ends an episode. The reward of a step is ten times its action, but
    /// for steps `without_reward`.
    fn decisions_lacking(keys: &str, without_reward: &[usize]) -> DecisionRows {
        let config = config(keys);
        let valve = vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
        let mut reward: Vec<f64> = valve.iter().map(|action| 10.0 * action).collect();
        for &row in without_reward {
            reward[row] = NONE;
        }
        let done = vec![0.0, 0.0, 1.0, NONE, 0.0, 0.0];
        let segments = Segments::from_lengths([5, 1]).expect("rows");
        DecisionRows::new(&config, vec![valve, reward, done], &segments).expect("decisions")
    }

    fn decisions(keys: &str) -> DecisionRows {
        decisions_lacking(keys, &[])
    }

    #[test]
    fn a_missing_reward_is_in_the_row_of_its_action() {
        let within = decisions_lacking("", &[1]).without_reward;
        assert_eq!((&within.missing[..], within.missing_terminals), (&[1][..], 0));
        let last = decisions_lacking("", &[2]).without_reward;
        assert_eq!((&last.missing[..], last.missing_terminals), (&[2][..], 1), "of the terminal");
        assert!(
            decisions_lacking("", &[5]).without_reward.missing.is_empty(),
            "its step leads nowhere in the log"
        );
    }

    /// Returns the rows without an action of a log of four rows that has none in `row`, and a terminal in row 1.
    fn without_action(row: usize) -> Vec<usize> {
        let mut valve = vec![1.0; 4];
        valve[row] = NONE;
        let recorded = [valve, vec![1.0; 4], vec![0.0, 1.0, 0.0, 0.0]];
        let segments = Segments::from_lengths([4]).expect("rows");
        ColumnFindings::new(&config(""), &recorded, &segments).without_action
    }

    #[test]
    fn an_action_is_taken_in_the_row_of_a_terminal() {
        assert_eq!(without_action(1), [1], "the row of a terminal");
        assert_eq!(without_action(2), [2]);
        assert!(without_action(3).is_empty(), "the log ends there");
    }

    #[test]
    fn the_reward_of_a_step_is_in_the_row_of_its_action() {
        let log = decisions("");
        assert_eq!(log.rows, [0, 1, 2, 2, 3, 4, 5]);
        // No step led to the first rows of episodes and segments.
        let got: Vec<f32> = log.rewards.iter().copied().filter(|got| got.is_finite()).collect();
        assert_eq!(got, [10.0, 20.0, 30.0, 40.0]);
        assert!([0, 4, 6].iter().all(|&row| log.rewards[row].is_nan()), "{:?}", log.rewards);
        assert_eq!(log.endings[3], Ending::Terminal);
        assert_eq!(log.endings.iter().filter(|&&ending| ending == Ending::Terminal).count(), 1);
        assert_eq!(log.acted[0][..3], [1.0, 2.0, 3.0]);
        assert!(log.acted[0][3].is_nan(), "nothing is done in the end");
        assert!(log.without_reward.missing.is_empty(), "{:?}", log.without_reward);
        assert_eq!(log.without_reward.terminals, 1);
    }

    #[test]
    fn decisions_of_several_steps_have_all_of_their_rewards() {
        let log = decisions("every = 2");
        assert_eq!(log.rows, [0, 2, 2], "the end of the log cuts the last decision");
        assert_eq!(log.rewards[1..], [30.0, 30.0]);
    }

    #[test]
    fn states_of_ends_are_those_of_the_last_action() {
        let states = calib_core::States::new(vec![0.0, 1.0, 2.0, 3.0, 4.0, 5.0], 6, 1);
        let states = decisions("").states(&states.expect("finite")).expect("finite");
        assert_eq!(states.as_slice(), [0.0, 1.0, 2.0, 2.0, 3.0, 4.0, 5.0]);
    }

    #[test]
    fn a_lag_of_actions_is_of_logs_of_states() {
        let text = "actions = ['valve']\nreward_row = 'same'\nlag = 1";
        let config: ControlConfig = toml::from_str(text).expect("valid");
        let told = config.check().expect_err("both").to_string();
        assert!(told.contains("lag") && told.contains("reward_row"), "{told}");
    }
}
