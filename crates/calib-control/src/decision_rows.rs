//! Turns the columns of a log into the rows in which agents decide.

use std::ops::Range;

use calib_core::{Segments, States};

use crate::{
    Columns, ControlConfig, ControlError, Decisions, Ending, RewardColumns, RewardRow,
    log::{episodes, rows_without_reward},
    step_rows::StepRows,
};

/// The rows of a log in which an agent decides or an episode ends, with their actions and rewards.
///
/// With `control.every` = n an agent decides in every n-th row of an episode. The decision is the action of that row, whatever the n − 1
/// rows after it hold, because an agent at the plant knows no more when it decides. Its reward is the sum of the rewards of the n rows
/// after it. A terminal among them ends the decision and the episode. A decision that is cut short for another reason is left out, because
/// its reward would cover fewer rows.
///
/// With `control.reward_row` = "same" the row of an action holds the reward of its step, and whether the step ended its episode.
///
/// With `control.lag` = l the log shows an action l rows after its decision. The action counts in the earlier row.
#[derive(Clone, Debug)]
pub struct DecisionRows {
    /// The rows, numbered as in the log, ascending. In a log of steps the last row of an episode that ends in a terminal appears twice,
    /// because the log lacks the state that its step led to.
    pub rows: Vec<usize>,
    /// Unbroken segments of these rows.
    pub segments: Segments,
    /// The values of the actions, `[columns of actions][rows]`; NaN where nothing is decided.
    pub acted: Vec<Vec<f64>>,
    /// The reward since the previous decision, `[rows]`; NaN where there is none.
    pub rewards: Vec<f32>,
    /// Whether an episode ended, `[rows]`.
    pub endings: Vec<Ending>,
    /// The probability of each decision, `[rows]`; `None` if it was not logged.
    pub probabilities: Option<Vec<f64>>,
    /// Rows of the log that have no reward of an action: those to which it leads, or with `control.reward_row` = "same" its own.
    pub without_reward: RowsWithoutReward,
    /// Decisions of several rows, during which the log has another action.
    pub changed: ChangedDecisions,
}

/// Rows of a log, ascending, that have no reward from which an agent could learn.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RowsWithoutReward {
    /// Rows in which a value is missing.
    pub missing: Vec<usize>,
    /// Rows whose reward is infinite in single precision.
    pub infinite: Vec<usize>,
    /// Number of `missing` rows that are terminals. These terminals are lost.
    pub missing_terminals: usize,
    /// Terminals of the log to which an action leads, including lost ones.
    pub terminals: usize,
}

/// Decisions during which another action was set before the next decision.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ChangedDecisions {
    /// Number of such decisions.
    pub count: usize,
    /// Number of all decisions.
    pub decisions: usize,
    /// The row of the log with the other action, in the first such decision.
    pub first: Option<usize>,
}

/// The columns of a log with one value per row.
struct LogRows {
    acted: Vec<Vec<f64>>,
    rewards: Vec<f32>,
    endings: Vec<Ending>,
    probabilities: Option<Vec<f64>>,
}

impl LogRows {
    /// Returns whether a row has an action and does not end its episode.
    fn leads_on(&self, row: usize) -> bool {
        leads_on(&self.acted, &self.endings, row)
    }

    fn has_reward(&self, row: usize) -> bool {
        self.rewards[row].is_finite()
    }

    /// Returns the number of terminals to which an action leads.
    fn terminals(&self, segments: &Segments) -> usize {
        let later = segments.iter().flat_map(|segment| segment.rows().skip(1));
        later.filter(|&row| self.endings[row] == Ending::Terminal && self.leads_on(row - 1)).count()
    }
}

fn leads_on(acted: &[Vec<f64>], endings: &[Ending], row: usize) -> bool {
    endings[row] != Ending::Terminal && acted.iter().all(|column| !column[row].is_nan())
}

impl DecisionRows {
    /// Returns the decisions of a log whose columns [`ControlConfig::columns`] were recorded as `recorded`, `[columns][rows]`, with NaN for
    /// missing values. The rows form `segments`.
    ///
    /// # Errors
    /// If no episode is as long as one decision.
    ///
    /// # Panics
    /// If there is not one list per column, or not one value per row.
    pub fn new(
        config: &ControlConfig,
        recorded: Vec<Vec<f64>>,
        segments: &Segments,
    ) -> Result<Self, ControlError> {
        match config.reward_row {
            RewardRow::Next => Self::of_states(config, recorded, segments),
            RewardRow::Same => {
                let StepRows { recorded, segments, rows, rewarded } =
                    StepRows::new(config, &recorded, segments)?;
                Ok(Self::of_states(config, recorded, &segments)?.renumbered(&rows, &rewarded))
            }
        }
    }

    /// Returns the decisions of a log whose rows hold the reward and the terminal of the step that led to them.
    fn of_states(
        config: &ControlConfig,
        mut recorded: Vec<Vec<f64>>,
        segments: &Segments,
    ) -> Result<Self, ControlError> {
        let names = config.columns();
        let endings = Ending::of_rows(config.terminal_of(&recorded), segments.rows());
        let actions = config.actions.len();
        let probability = names.iter().position(|name| Some(name) == config.probability.as_ref());
        for column in (0..actions).chain(probability) {
            recorded[column] = decided(&recorded[column], segments, &endings, config.lag);
        }
        let acted = recorded[..actions].to_vec();
        let of_reward = RewardColumns { names: &names, values: &recorded, actions };
        let rewards =
            config.reward.of_rows(&of_reward, segments, |row| leads_on(&acted, &endings, row));
        let probabilities = probability.map(|place| recorded.swap_remove(place));
        let log = LogRows { acted, rewards, endings, probabilities };
        let without_reward =
            rows_without_reward(segments, |row| log.leads_on(row), |row| log.has_reward(row));
        let (infinite, missing): (Vec<usize>, Vec<usize>) =
            without_reward.into_iter().partition(|&row| log.rewards[row].is_infinite());
        let lost = missing.iter().filter(|&&row| log.endings[row] == Ending::Terminal).count();
        let without_reward = RowsWithoutReward {
            missing,
            infinite,
            missing_terminals: lost,
            terminals: log.terminals(segments),
        };
        if config.every > 1 {
            return Self::thinned(&log, config, segments, without_reward);
        }
        let LogRows { acted, rewards, endings, probabilities } = log;
        Ok(Self {
            rows: (0..segments.rows()).collect(),
            segments: segments.clone(),
            acted,
            rewards,
            endings,
            probabilities,
            without_reward,
            changed: ChangedDecisions::default(),
        })
    }

    /// The same with the number that each row has in `rows`, and its reward in `rewarded`.
    fn renumbered(mut self, rows: &[usize], rewarded: &[usize]) -> Self {
        let RowsWithoutReward { missing, infinite, .. } = &mut self.without_reward;
        missing.iter_mut().chain(infinite).for_each(|row| *row = rewarded[*row]);
        let decided = self.rows.iter_mut().chain(&mut self.changed.first);
        decided.for_each(|row| *row = rows[*row]);
        self
    }

    /// Returns a decision for every `config.every`-th row of each episode.
    fn thinned(
        log: &LogRows,
        config: &ControlConfig,
        segments: &Segments,
        without_reward: RowsWithoutReward,
    ) -> Result<Self, ControlError> {
        let every = config.every;
        let tolerances = tolerances(&log.acted, config.levels);
        let mut changed = ChangedDecisions::default();
        let mut rows = Vec::new();
        let mut rewards = Vec::new();
        let mut lengths = Vec::new();
        // Positions in `rows` of the ends of episodes, where nothing is decided.
        let mut lasts = Vec::new();
        for episode in episodes(segments, |row| log.leads_on(row), |row| log.has_reward(row)) {
            let decisions = decisions(&episode, every, &log.endings);
            let Some(first) = decisions.first() else { continue };
            rows.push(first.start);
            rewards.push(f32::NAN);
            for decision in &decisions {
                let next = decision.end;
                rows.push(next);
                let got = log.rewards[decision.start + 1..=next].iter();
                rewards.push(got.copied().map(f64::from).sum::<f64>() as f32);
                changed.count(&log.acted, decision, &tolerances);
            }
            lasts.push(rows.len() - 1);
            lengths.push(decisions.len() + 1);
        }
        if lengths.is_empty() {
            return Err(ControlError::NoDecisions { every }.or_only_terminals(&log.endings));
        }
        let mut acted: Vec<Vec<f64>> = log.acted.iter().map(|column| at(column, &rows)).collect();
        for column in &mut acted {
            for &last in &lasts {
                column[last] = f64::NAN;
            }
        }
        Ok(Self {
            segments: Segments::from_lengths(lengths)?,
            acted,
            rewards,
            endings: at(&log.endings, &rows),
            probabilities: log.probabilities.as_ref().map(|column| at(column, &rows)),
            without_reward,
            changed,
            rows,
        })
    }

    /// Returns the states of these rows, given the states of all rows.
    ///
    /// # Errors
    /// Never: values of valid states form valid states.
    pub fn states(&self, states: &States) -> Result<States, ControlError> {
        if self.rows.iter().copied().eq(0..states.rows()) {
            return Ok(states.clone());
        }
        let values = self.rows.iter().flat_map(|&row| states.row(row)).copied().collect();
        Ok(States::new(values, self.rows.len(), states.columns())?)
    }

    /// Returns these decisions as a log with a single action. Which action it was matters neither to states nor to returns, and a
    /// held-out period may have actions that the log of a model lacks. `states` are those of all rows of the log.
    ///
    /// # Errors
    /// If no action leads from one row to another.
    pub fn with_one_action(&self, states: &States) -> Result<Decisions, ControlError> {
        let rows = 0..self.segments.rows();
        let actions: Vec<Option<u16>> = rows
            .map(|row| self.acted.iter().all(|column| !column[row].is_nan()).then_some(0))
            .collect();
        let columns = Columns { actions: &actions, rewards: &self.rewards, endings: &self.endings };
        Decisions::new(self.states(states)?, &self.segments, columns, 1)
    }
}

/// Returns the decision of each row, if the log shows it `lag` rows later.
fn decided(recorded: &[f64], segments: &Segments, endings: &[Ending], lag: usize) -> Vec<f64> {
    let mut decided = vec![f64::NAN; recorded.len()];
    for segment in segments.iter() {
        each_shown(segment.rows(), endings, lag, |row, shown| decided[row] = recorded[shown]);
    }
    decided
}

/// Calls `take` for each of the `rows` of a segment, last row first, with the row that shows its decision `lag` rows later. A decision
/// before a gap is unknown if it would appear after the gap. A decision before a terminal gets the action that the row of the terminal
/// shows: the rows after it belong to another episode, and without an action there would be no step to the terminal.
pub(crate) fn each_shown(
    rows: Range<usize>,
    endings: &[Ending],
    lag: usize,
    mut take: impl FnMut(usize, usize),
) {
    let mut terminal = None;
    for row in rows.clone().rev() {
        if endings[row] == Ending::Terminal {
            terminal = Some(row);
        }
        let shown = terminal.map_or(row + lag, |terminal: usize| terminal.min(row + lag));
        if shown < rows.end {
            take(row, shown);
        }
    }
}

fn at<T: Copy>(column: &[T], rows: &[usize]) -> Vec<T> {
    rows.iter().map(|&row| column[row]).collect()
}

/// Returns the decisions of an episode: each from its row to that of the next one, or to the terminal.
fn decisions(episode: &Range<usize>, every: usize, endings: &[Ending]) -> Vec<Range<usize>> {
    let last = episode.end - 1;
    let starts = (episode.start..last).step_by(every);
    let all = starts.map(|start| start..start.saturating_add(every).min(last));
    all.filter(|decision| decision.len() == every || endings[decision.end] == Ending::Terminal)
        .collect()
}

/// Returns for each column of actions the largest difference between values that count as the same action: half a step from one
/// level to the next, or 0 without levels.
fn tolerances(acted: &[Vec<f64>], levels: Option<usize>) -> Vec<f64> {
    let Some(levels) = levels else { return vec![0.0; acted.len()] };
    let steps = 2.0 * (levels - 1) as f64;
    acted
        .iter()
        .map(|column| {
            let low = column.iter().copied().fold(f64::INFINITY, f64::min);
            let high = column.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            (high - low).max(0.0) / steps
        })
        .collect()
}

impl ChangedDecisions {
    /// Counts a decision whose rows start at its own and end before the next one.
    fn count(&mut self, acted: &[Vec<f64>], decision: &Range<usize>, tolerances: &[f64]) {
        self.decisions += 1;
        let other = (decision.start + 1..decision.end).find(|&row| {
            let mut columns = acted.iter().zip(tolerances);
            columns.any(|(column, tolerance)| {
                (column[row] - column[decision.start]).abs() > *tolerance
            })
        });
        self.count += usize::from(other.is_some());
        self.first = self.first.or(other);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NONE: f64 = f64::NAN;

    /// Returns the decisions of a log of seven rows of a valve. Its reward is 1, 2, 3, … in rows 1, 2, 3, …
    fn rows(
        keys: &str,
        valve: [f64; 7],
        terminal: [f64; 7],
        lengths: &[usize],
    ) -> Result<DecisionRows, ControlError> {
        let text = format!("actions = ['valve']\nreward = 'reward'\nterminal = 'end'\n{keys}");
        let config: ControlConfig = toml::from_str(&text).expect("valid");
        config.check().expect("valid");
        assert_eq!(config.columns(), ["valve", "reward", "end"]);
        let reward: Vec<f64> = (0..7).map(f64::from).collect();
        let recorded = [valve.to_vec(), reward, terminal.to_vec()];
        let segments = Segments::from_lengths(lengths.iter().copied()).expect("rows");
        DecisionRows::new(&config, recorded.to_vec(), &segments)
    }

    const ON: [f64; 7] = [0.0; 7];

    #[test]
    fn every_row_is_a_decision_unless_the_study_says_otherwise() {
        let valve = [1.0, 2.0, NONE, 4.0, 5.0, 6.0, 7.0];
        let all = rows("", valve, ON, &[7]).expect("rows");
        assert_eq!(all.rows, [0, 1, 2, 3, 4, 5, 6]);
        assert_eq!(all.rewards, [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        assert_eq!(all.segments.len(), 1);
        assert_eq!(all.changed, ChangedDecisions::default());
    }

    #[test]
    fn the_rewards_of_a_decision_are_summed() {
        let valve = [1.0, 1.0, 1.0, 2.0, 1.0, 2.0, 3.0];
        let thinned = rows("every = 3", valve, ON, &[7]).expect("two decisions");
        assert_eq!(thinned.rows, [0, 3, 6]);
        assert_eq!(thinned.rewards[1..], [6.0, 15.0]);
        assert_eq!(thinned.acted[0][..2], [1.0, 2.0]);
        assert!(thinned.acted[0][2].is_nan(), "nothing is decided where an episode ends");
        // From row 3 on the valve was at 2, 1, 2.
        let changed = ChangedDecisions { count: 1, decisions: 2, first: Some(4) };
        assert_eq!(thinned.changed, changed);
        let states = States::new((0..14).map(|value| value as f32).collect(), 7, 2);
        let states = thinned.states(&states.expect("finite")).expect("finite");
        assert_eq!(states.as_slice(), [0.0, 1.0, 6.0, 7.0, 12.0, 13.0]);
    }

    #[test]
    fn a_decision_is_cut_by_a_terminal_and_left_out_where_something_else_cuts_it() {
        let terminal = [0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0];
        let thinned = rows("every = 3", [1.0; 7], terminal, &[7]).expect("two decisions");
        assert_eq!(thinned.rows, [0, 3, 4], "rows 5 and 6 are too few");
        assert_eq!(thinned.rewards[1..], [6.0, 4.0]);
        assert_eq!(thinned.endings[1..], [Ending::Continues, Ending::Terminal]);
        // A gap after row 4 leaves one row over.
        let thinned = rows("every = 3", [1.0; 7], ON, &[5, 2]).expect("a decision");
        assert_eq!((&thinned.rows[..], thinned.segments.len()), (&[0, 3][..], 1));
        // Without an action in row 1 an episode begins in row 2.
        let valve = [1.0, NONE, 1.0, 1.0, 1.0, 1.0, 1.0];
        let thinned = rows("every = 2", valve, ON, &[7]).expect("two decisions");
        assert_eq!(thinned.rows, [2, 4, 6]);
        let told = rows("every = 7", [1.0; 7], ON, &[7]).expect_err("too few rows").to_string();
        assert!(told.contains("control.every = 7"), "{told}");
        let told = rows("every = 2", [1.0; 7], [1.0; 7], &[7]).expect_err("no row leads on");
        assert!(matches!(told, ControlError::OnlyTerminals), "{told}");
    }

    #[test]
    fn a_number_changes_when_it_is_nearer_to_another_level() {
        let valve = [0.0, 0.4, 10.0, 8.0, 4.0, 0.0, 0.0];
        let keys = "every = 2\nlevels = 6";
        let thinned = rows(keys, valve, ON, &[7]).expect("three decisions");
        // Levels are 2 apart: 0 and 0.4 are at one level, 10 and 8 at two, 4 and 0 at two.
        let changed = ChangedDecisions { count: 2, decisions: 3, first: Some(3) };
        assert_eq!(thinned.changed, changed);
    }

    /// Returns the decisions that are known.
    fn known(log: &DecisionRows) -> Vec<f64> {
        log.acted[0].iter().copied().filter(|value| !value.is_nan()).collect()
    }

    #[test]
    fn an_action_counts_in_the_row_in_which_it_was_decided() {
        let valve = [8.0, 9.0, 1.0, 2.0, 3.0, 4.0, 5.0];
        let lagged = rows("lag = 2", valve, ON, &[7]).expect("rows");
        assert_eq!(lagged.acted[0][..5], [1.0, 2.0, 3.0, 4.0, 5.0]);
        assert!(lagged.acted[0][5..].iter().all(|value| value.is_nan()), "not shown any more");
        // There is a gap after row 3.
        let lagged = rows("lag = 2", valve, ON, &[4, 3]).expect("rows");
        assert_eq!(known(&lagged), [1.0, 2.0, 5.0]);
        assert!(!lagged.acted[0][4].is_nan());
        // Row 4 is a terminal. Later rows of the valve do not count for decisions before it.
        let terminal = [0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0];
        let lagged = rows("lag = 2", valve, terminal, &[7]).expect("rows");
        assert_eq!(known(&lagged), [1.0, 2.0, 3.0, 3.0, 3.0]);
        // Every row shows the action that led to it.
        let lagged = rows("lag = 1", valve, terminal, &[7]).expect("rows");
        assert_eq!(lagged.acted[0][..4], [9.0, 1.0, 2.0, 3.0]);
    }

    #[test]
    fn a_lagged_action_has_its_probability_and_its_cost() {
        let text =
            "actions = ['valve']\nprobability = 'odds'\nlag = 1\nreward = [{ column = 'valve' }]";
        let config: ControlConfig = toml::from_str(text).expect("valid");
        assert_eq!(config.columns(), ["valve", "odds"]);
        let recorded = vec![vec![9.0, 1.0, 2.0], vec![0.9, 0.1, 0.2]];
        let segments = Segments::from_lengths([3]).expect("rows");
        let lagged = DecisionRows::new(&config, recorded, &segments).expect("rows");
        assert_eq!(lagged.rewards[1..], [1.0, 2.0]);
        assert_eq!(lagged.probabilities.expect("logged")[..2], [0.1, 0.2]);
    }

    #[test]
    fn decisions_with_other_actions_have_their_states_and_returns() {
        let terminal = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0];
        let log = rows("", [5.0, NONE, 7.0, 8.0, 9.0, 5.5, 6.0], terminal, &[7]).expect("rows");
        let states = States::new((0..7).map(|row| row as f32).collect(), 7, 1).expect("finite");
        let decisions = log.with_one_action(&states).expect("decisions");
        assert_eq!(decisions.source_states().expect("finite").as_slice(), [0.0, 2.0, 4.0, 5.0]);
        assert_eq!(decisions.rewards(), [1.0, 3.0, 5.0, 6.0]);
        assert_eq!((decisions.levels(), decisions.terminals()), (1, 1));
        let nothing = rows("", [NONE; 7], terminal, &[7]).expect("rows");
        assert!(nothing.with_one_action(&states).is_err(), "nothing was decided");
    }

    #[test]
    fn rewards_that_are_infinite_are_not_missing() {
        let text = "actions = ['valve']\nreward = 'gain'";
        let config: ControlConfig = toml::from_str(text).expect("valid");
        let gain = vec![0.0, 1.0, 1e39, NONE, -f64::INFINITY, 3e38];
        let segments = Segments::from_lengths([6]).expect("rows");
        let log = DecisionRows::new(&config, vec![vec![1.0; 6], gain], &segments).expect("rows");
        let expected = RowsWithoutReward {
            missing: vec![3],
            infinite: vec![2, 4],
            ..RowsWithoutReward::default()
        };
        assert_eq!(log.without_reward, expected);
    }

    #[test]
    fn terminals_without_a_reward_are_counted() {
        let text = "actions = ['valve']\nreward = 'gain'\nterminal = 'end'";
        let config: ControlConfig = toml::from_str(text).expect("valid");
        let gain = vec![0.0, 1.0, NONE, NONE, 1.0, NONE, 2.0];
        // A plant that stays at its terminal has only one terminal, because no action leads to the next row.
        let end = vec![0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0];
        let segments = Segments::from_lengths([7]).expect("rows");
        let log = DecisionRows::new(&config, vec![vec![1.0; 7], gain, end], &segments);
        let expected = RowsWithoutReward {
            missing: vec![2, 5],
            infinite: Vec::new(),
            missing_terminals: 1,
            terminals: 2,
        };
        assert_eq!(log.expect("rows").without_reward, expected);
    }

    #[test]
    fn a_change_is_charged_in_the_decision_that_made_it() {
        let text = "actions = ['valve']\nevery = 2\nreward = [{ column = 'valve', change = true, weight = -1 }]";
        let config: ControlConfig = toml::from_str(text).expect("valid");
        let recorded = vec![vec![1.0, 1.0, 4.0, 4.0, 2.0]];
        let segments = Segments::from_lengths([5]).expect("rows");
        let thinned = DecisionRows::new(&config, recorded, &segments).expect("two decisions");
        assert_eq!(thinned.rewards[1..], [0.0, -3.0]);
    }
}
