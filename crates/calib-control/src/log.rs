//! Logs of decisions: observations, actions and their outcomes.

use std::ops::Range;

use calib_core::{RowIndex, Segments, States, TransitionIndex, Transitions};

use crate::{ControlError, Ending, Settings};

/// A log with actions, rewards and terminals.
///
/// A row holds the observation at a time, the reward of the step that led to it, whether it is terminal, and the action that was then
/// taken. Transition i leads from its row by the action there to the next row, with the reward and the terminal of the next row. An episode
/// ends after a terminal row, and after a row without an action. Where the log merely ends, has a gap, or lacks the reward of the next row,
/// the last row is not a terminal.
#[derive(Clone, Debug)]
pub struct Decisions {
    states: States,
    transitions: Transitions,
    /// The action of each transition.
    actions: Vec<u16>,
    rewards: Vec<f32>,
    endings: Vec<Ending>,
    /// Probability with which the behaviour takes the action of each transition, if it was logged.
    probabilities: Option<Vec<f64>>,
    /// Values of the actions, if these are continuous.
    settings: Option<Settings>,
    levels: usize,
}

/// The columns of a log beside its states, one value per row.
#[derive(Clone, Copy, Debug)]
pub struct Columns<'a> {
    /// The action of each row, below `levels`.
    pub actions: &'a [Option<u16>],
    /// The reward of the step that led to the row; NaN where there is no reward. No step leads to such a row.
    pub rewards: &'a [f32],
    /// Whether an episode ends in the row.
    pub endings: &'a [Ending],
}

impl Decisions {
    /// Returns the log of these rows.
    ///
    /// # Errors
    /// If columns have different lengths, no transition is left, or an action is not below `levels`.
    pub fn new(
        states: States,
        segments: &Segments,
        columns: Columns<'_>,
        levels: usize,
    ) -> Result<Self, ControlError> {
        let rows = states.rows();
        let lengths = [
            ("segments", segments.rows()),
            ("actions", columns.actions.len()),
            ("rewards", columns.rewards.len()),
            ("terminals", columns.endings.len()),
        ];
        if let Some(&(what, got)) = lengths.iter().find(|length| length.1 != rows) {
            return Err(ControlError::Rows { what, expected: rows, got });
        }
        let episodes =
            episodes(segments, |row| columns.leads_on(row), |row| columns.rewards[row].is_finite());
        let lengths = episodes.iter().map(ExactSizeIterator::len);
        let transitions = Transitions::new(Segments::from_lengths(lengths)?);
        let mut actions = Vec::new();
        let mut rewards = Vec::new();
        let mut endings = Vec::new();
        for number in 0..transitions.len() {
            let transition = TransitionIndex::new(number);
            let from = transitions.source(transition).get();
            let next = transitions.next(transition).get();
            let Some(action) = columns.actions[from] else {
                unreachable!("a row without an action is the last of its segment");
            };
            if usize::from(action) >= levels {
                let expected = "one of the levels";
                return Err(ControlError::Field { field: "action", got: action.into(), expected });
            }
            actions.push(action);
            rewards.push(columns.rewards[next]);
            endings.push(columns.endings[next]);
        }
        if actions.is_empty() {
            return Err(ControlError::NoTransitions.or_only_terminals(columns.endings));
        }
        let probabilities = None;
        let settings = None;
        Ok(Self { states, transitions, actions, rewards, endings, probabilities, settings, levels })
    }

    /// Returns a log that was stored. Its arrays have been checked.
    pub(crate) fn from_parts(
        states: States,
        transitions: Transitions,
        actions: Vec<u16>,
        rewards: Vec<f32>,
        endings: Vec<Ending>,
        settings: Option<Settings>,
        levels: usize,
    ) -> Self {
        let probabilities = None;
        Self { states, transitions, actions, rewards, endings, probabilities, settings, levels }
    }

    /// Returns the same log with the probability of the action in every row. The values of rows without an action do not count.
    ///
    /// # Errors
    /// If there is not one value per row, or a value that counts is not above 0 and at most 1.
    pub fn with_probabilities(self, of_rows: &[f64]) -> Result<Self, ControlError> {
        let expected = self.states.rows();
        let got = of_rows.len();
        if got != expected {
            return Err(ControlError::Rows { what: "probabilities", expected, got });
        }
        let sources = self.transitions.sources().iter().map(|&row| row as usize);
        let probabilities = sources.map(|row| match of_rows[row] {
            // Single precision holds 1 exactly, but a sum of shares may be slightly larger.
            got if got > 0.0 && got <= 1.0 + 1e-6 => Ok(got.min(1.0)),
            got => Err(ControlError::NoProbability { row, got }),
        });
        let probabilities = Some(probabilities.collect::<Result<_, _>>()?);
        Ok(Self { probabilities, ..self })
    }

    /// Returns the probability with which the behaviour takes the action of each transition, if it was logged.
    pub fn probabilities(&self) -> Option<&[f64]> {
        self.probabilities.as_deref()
    }

    /// Returns the same log with the values that were set in every row. Its actions are the nearest levels.
    ///
    /// # Errors
    /// If `settings` does not have one row per row of the log, or not as many levels as actions.
    pub fn with_settings(self, settings: Settings) -> Result<Self, ControlError> {
        for (what, expected, got) in [
            ("settings", self.states.rows(), settings.rows()),
            ("levels", self.levels, settings.levels()),
        ] {
            if got != expected {
                return Err(ControlError::Rows { what, expected, got });
            }
        }
        Ok(Self { settings: Some(settings), ..self })
    }

    /// Returns the values of the actions, if these are continuous.
    pub fn settings(&self) -> Option<&Settings> {
        self.settings.as_ref()
    }

    /// Returns the range of transitions of each episode.
    pub fn episodes(&self) -> impl Iterator<Item = Range<usize>> {
        let mut end = 0;
        self.transitions.segments().iter().filter(|segment| segment.len() > 1).map(move |segment| {
            let start = end;
            end += segment.len() - 1;
            start..end
        })
    }

    /// Returns the observations in which an action was taken, `[transitions, columns]`.
    ///
    /// # Errors
    /// Never: values of valid states form valid states.
    pub fn source_states(&self) -> Result<States, ControlError> {
        let sources = self.transitions.sources().iter();
        let values = sources.flat_map(|&row| self.states.row(row as usize)).copied().collect();
        Ok(States::new(values, self.len(), self.states.columns())?)
    }

    /// Returns the next state of every transition in `metric`, which has one row per row of the log.
    pub(crate) fn next_states(&self, metric: &States) -> Result<States, ControlError> {
        let mut values = Vec::with_capacity(self.len() * metric.columns());
        for number in 0..self.len() {
            let next = self.transitions.next(TransitionIndex::new(number));
            values.extend_from_slice(metric.row(next.get()));
        }
        Ok(States::new(values, self.len(), metric.columns())?)
    }

    /// Returns the observations, `[rows, columns]`.
    pub fn states(&self) -> &States {
        &self.states
    }

    /// Returns which row each transition leads from and to.
    pub fn transitions(&self) -> &Transitions {
        &self.transitions
    }

    /// Returns the number of transitions.
    pub fn len(&self) -> usize {
        self.actions.len()
    }

    /// Returns whether there is no transition. This never happens, because a log has at least one.
    pub fn is_empty(&self) -> bool {
        self.actions.is_empty()
    }

    /// Returns the number of possible actions, including those that do not occur.
    pub fn levels(&self) -> usize {
        self.levels
    }

    /// Returns the action of each transition.
    pub fn actions(&self) -> &[u16] {
        &self.actions
    }

    /// Returns the reward of each transition.
    pub fn rewards(&self) -> &[f32] {
        &self.rewards
    }

    /// Returns the smallest and the largest reward.
    pub(crate) fn reward_range(&self) -> [f64; 2] {
        let rewards = self.rewards.iter().copied().map(f64::from);
        let least = rewards.clone().fold(f64::INFINITY, f64::min);
        [least, rewards.fold(f64::NEG_INFINITY, f64::max)]
    }

    /// Returns for each transition whether it leads to a terminal.
    pub fn endings(&self) -> &[Ending] {
        &self.endings
    }

    /// Returns the states that a transition leads from and to.
    pub(crate) fn ends(&self, transition: TransitionIndex) -> [&[f32]; 2] {
        let transitions = &self.transitions;
        [transitions.source(transition), transitions.next(transition)]
            .map(|row| self.states.row(row.get()))
    }

    /// Returns the transitions with `action`, ascending.
    pub(crate) fn with_action(&self, action: usize) -> Vec<u32> {
        self.actions
            .iter()
            .enumerate()
            .filter(|&(_, &taken)| usize::from(taken) == action)
            .map(|(number, _)| number as u32)
            .collect()
    }

    /// Returns the number of transitions with each action.
    pub fn counts(&self) -> Vec<usize> {
        let mut counts = vec![0; self.levels];
        for &action in &self.actions {
            counts[usize::from(action)] += 1;
        }
        counts
    }

    /// Returns the number of transitions that lead to a terminal.
    pub fn terminals(&self) -> usize {
        self.endings.iter().filter(|&&ending| ending == Ending::Terminal).count()
    }

    /// Returns the first rows of the episodes.
    pub fn starts(&self) -> Vec<RowIndex> {
        let segments = self.transitions.segments().iter();
        segments
            .filter(|segment| segment.len() > 1)
            .map(|segment| RowIndex(segment.start))
            .collect()
    }
}

/// Number of stretches in a sample.
const STRETCHES: usize = 8;

impl Decisions {
    /// Returns about `transitions` transitions of the log, or all if it has no more. They are stretches from all
    /// over the log, and form a log of their own.
    ///
    /// # Errors
    /// If `transitions` is 0.
    pub fn sample(&self, transitions: usize) -> Result<Self, ControlError> {
        let all = self.len();
        if transitions >= all {
            return Ok(self.clone());
        }
        let bounds: Vec<usize> = (0..=STRETCHES).map(|stretch| stretch * all / STRETCHES).collect();
        let each = transitions.div_ceil(STRETCHES);
        let numbers: Vec<usize> = bounds
            .windows(2)
            .flat_map(|bounds| bounds[0]..(bounds[0] + each).min(bounds[1]))
            .collect();
        if numbers.is_empty() {
            return Err(ControlError::NoTransitions);
        }
        let mut rows: Vec<usize> = Vec::new();
        let mut lengths: Vec<usize> = Vec::new();
        for &number in &numbers {
            let transition = TransitionIndex::new(number);
            let source = self.transitions.source(transition).get();
            if rows.last() != Some(&source) {
                rows.push(source);
                lengths.push(1);
            }
            rows.push(self.transitions.next(transition).get());
            if let Some(length) = lengths.last_mut() {
                *length += 1;
            }
        }
        let values: Vec<f32> = rows.iter().flat_map(|&row| self.states.row(row)).copied().collect();
        let settings = self.settings.as_ref().map(|settings| {
            let of_rows = rows.iter().flat_map(|&row| settings.of_row(row)).copied().collect();
            Settings::from_parts(of_rows, settings.of_levels().to_vec(), self.levels)
        });
        let probabilities = self.probabilities.as_ref();
        Ok(Self {
            states: States::new(values, rows.len(), self.states.columns())?,
            transitions: Transitions::new(Segments::from_lengths(lengths)?),
            actions: numbers.iter().map(|&number| self.actions[number]).collect(),
            rewards: numbers.iter().map(|&number| self.rewards[number]).collect(),
            endings: numbers.iter().map(|&number| self.endings[number]).collect(),
            probabilities: probabilities
                .map(|all| numbers.iter().map(|&number| all[number]).collect()),
            settings,
            levels: self.levels,
        })
    }
}

/// Returns the rows to which an action leads, and which have no reward. Episodes end before them.
pub(crate) fn rows_without_reward(
    segments: &Segments,
    leads_on: impl Fn(usize) -> bool,
    has_reward: impl Fn(usize) -> bool,
) -> Vec<usize> {
    let later = segments.iter().flat_map(|segment| segment.rows().skip(1));
    later.filter(|&row| leads_on(row - 1) && !has_reward(row)).collect()
}

impl Columns<'_> {
    /// Returns whether a row has an action and does not end its episode.
    fn leads_on(&self, row: usize) -> bool {
        self.endings[row] != Ending::Terminal && self.actions[row].is_some()
    }
}

/// Returns the rows of each episode. Segments are cut after rows from which no action leads on, and before rows without a reward.
pub(crate) fn episodes(
    segments: &Segments,
    leads_on: impl Fn(usize) -> bool,
    has_reward: impl Fn(usize) -> bool,
) -> Vec<Range<usize>> {
    let mut episodes = Vec::new();
    for segment in segments.iter() {
        let rows = segment.rows();
        let mut start = rows.start;
        for row in rows.clone() {
            let next = row + 1;
            if next == rows.end || !leads_on(row) || !has_reward(next) {
                episodes.push(start..next);
                start = next;
            }
        }
    }
    episodes
}

#[cfg(test)]
mod tests {
    use super::*;

    const ON: Ending = Ending::Continues;
    const END: Ending = Ending::Terminal;

    fn log(
        actions: &[Option<u16>],
        rewards: &[f32],
        endings: &[Ending],
    ) -> Result<Decisions, ControlError> {
        let rows = rewards.len();
        let states = States::new((0..rows).map(|row| row as f32).collect(), rows, 1)?;
        let segments = Segments::from_lengths([4, rows - 4])?;
        Decisions::new(states, &segments, Columns { actions, rewards, endings }, 2)
    }

    #[test]
    fn episodes_end_at_terminals_gaps_and_rows_without_an_action() {
        let actions = [Some(0), Some(1), Some(0), Some(1), Some(1), None, Some(0), Some(1)];
        let rewards = [f32::NAN, 1.0, 2.0, 3.0, f32::NAN, 5.0, f32::NAN, 7.0];
        let log = log(&actions, &rewards, &[ON, ON, END, ON, ON, ON, ON, ON]).expect("valid");
        // Episodes: rows 0-1-2 (terminal), 3 (alone, then a gap), 4-5 (no action), 6-7 (the log ends).
        assert_eq!(log.transitions().sources(), [0, 1, 4, 6]);
        assert_eq!(log.actions(), [0, 1, 1, 0]);
        assert_eq!(log.rewards(), [1.0, 2.0, 5.0, 7.0]);
        assert_eq!(log.endings(), [ON, END, ON, ON]);
        assert_eq!((log.terminals(), log.counts()), (1, vec![2, 2]));
        assert_eq!(log.starts(), [0, 4, 6].map(RowIndex));
        assert_eq!(log.with_action(1), [1, 2]);
    }

    #[test]
    fn episodes_end_before_rows_without_a_reward() {
        let actions = [Some(0); 8];
        let endings = [ON; 8];
        let rewards = [f32::NAN, 1.0, f32::NAN, 3.0, f32::NAN, 5.0, 6.0, 7.0];
        let known = log(&actions, &rewards, &endings).expect("valid");
        // Episodes: rows 0-1, 2-3 (then a gap), 4-5-6-7. The first rows of episodes need no reward.
        assert_eq!(known.transitions().sources(), [0, 2, 4, 5, 6]);
        assert_eq!(known.rewards(), [1.0, 3.0, 5.0, 6.0, 7.0]);
        let segments = Segments::from_lengths([4, 4]).expect("rows");
        let missing = rows_without_reward(&segments, |_| true, |row| rewards[row].is_finite());
        assert_eq!(missing, [2]);
    }

    #[test]
    fn a_sample_has_transitions_from_all_over_the_log() {
        let rows = 400;
        let actions: Vec<Option<u16>> =
            (0..rows).map(|row| (row % 7 != 6).then_some((row % 2) as u16)).collect();
        let rewards: Vec<f32> = (0..rows).map(|row| row as f32).collect();
        let probabilities = vec![0.5; rows];
        let whole = log(&actions, &rewards, &vec![ON; rows]).expect("valid");
        let whole = whole.with_probabilities(&probabilities).expect("valid");
        let sample = whole.sample(80).expect("some");
        assert_eq!((sample.len(), sample.levels()), (80, 2));
        assert_eq!(sample.probabilities().map(<[f64]>::len), Some(80));
        for number in 0..sample.len() {
            let [from, to] = sample.ends(TransitionIndex::new(number)).map(|state| state[0]);
            // States and rewards are the row numbers.
            assert_eq!((to, sample.rewards()[number]), (from + 1.0, to));
            assert_eq!(usize::from(sample.actions()[number]), from as usize % 2);
        }
        let [first, _] = sample.ends(TransitionIndex::new(0));
        let [last, _] = sample.ends(TransitionIndex::new(79));
        assert!(first[0] == 0.0 && last[0] > 340.0, "{first:?} to {last:?}");
        assert_eq!(whole.sample(1000).expect("all").len(), whole.len());
        assert!(whole.sample(0).is_err());
    }

    #[test]
    fn what_is_no_log_is_refused() {
        let five = [Some(0); 5];
        let told = log(&five, &[f32::NAN; 5], &[ON; 5]).expect_err("no reward");
        assert!(matches!(told, ControlError::NoTransitions), "{told}");
        let told = log(&[None; 5], &[0.0; 5], &[ON; 5]).expect_err("no action");
        assert!(matches!(told, ControlError::NoTransitions), "{told}");
        let told = log(&five, &[0.0; 5], &[END; 5]).expect_err("no row leads on");
        assert!(matches!(told, ControlError::OnlyTerminals), "{told}");
        let told = log(&five[..4], &[0.0; 5], &[ON; 5]).expect_err("a short column");
        assert!(told.to_string().contains("actions: 4 rows, expected 5"), "{told}");
        assert!(log(&[Some(2); 5], &[0.0; 5], &[ON; 5]).is_err(), "two levels");
    }
}
