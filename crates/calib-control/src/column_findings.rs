//! Finds cells in the columns of a log that cost transitions, or that calib may misread.

use calib_core::Segments;

use crate::{ControlConfig, Ending, RewardRow, decision_rows::each_shown};

/// Findings in the columns of actions and terminals of a log.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ColumnFindings {
    /// Rows without an action, ascending, in which an episode ends although the log continues without a terminal.
    pub without_action: Vec<usize>,
    /// Counts of the cells in the column of terminals; zeros if the log has no such column.
    pub terminal: TerminalCells,
    /// Decisions whose own action does not appear in a log with `control.lag`.
    pub lagged: LaggedDecisions,
    /// Gaps in which an episode ends without a terminal.
    pub gaps: UnendedGaps,
}

/// Gaps of a log, in time or because rows are left out, before which no terminal ends the episode. No transition leads over them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct UnendedGaps {
    /// Number of gaps.
    pub count: usize,
    /// Number of steps from one row to the next in the whole log.
    pub steps: usize,
    /// The row before the first gap.
    pub first: Option<usize>,
}

/// Counts of the cells in the column of terminals.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TerminalCells {
    /// Rows of the log.
    pub rows: usize,
    /// Rows with a number other than 0: an episode ends there.
    pub terminals: usize,
    /// Rows with 0: an episode continues.
    pub zeros: usize,
    /// Rows without a number, which count as 0.
    pub empty: usize,
    /// The first row without a number.
    pub first_empty: Option<usize>,
}

/// Decisions that get the action in the row of the next terminal. Their own action appears `control.lag` rows later, and that row belongs
/// to another episode.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LaggedDecisions {
    /// Number of such decisions.
    pub count: usize,
    /// Number of all decisions.
    pub decisions: usize,
}

impl ColumnFindings {
    /// Returns the findings in the columns [`ControlConfig::columns`], recorded as `recorded`, `[columns][rows]`, with NaN for missing
    /// values. The rows form `segments`.
    ///
    /// # Panics
    /// If there is not one list per column, or not one value per row.
    pub fn new(config: &ControlConfig, recorded: &[Vec<f64>], segments: &Segments) -> Self {
        let terminal = config.terminal_of(recorded);
        let endings = Ending::of_rows(terminal, segments.rows());
        let mut found = Self {
            terminal: terminal.map(TerminalCells::of_column).unwrap_or_default(),
            gaps: UnendedGaps::new(segments, &endings),
            ..Self::default()
        };
        let acted = &recorded[..config.actions.len()];
        for segment in segments.iter() {
            let rows = segment.rows();
            each_shown(rows.clone(), &endings, config.lag, |row, shown| {
                let is_terminal = endings[row] == Ending::Terminal;
                let leads_nowhere = match config.reward_row {
                    RewardRow::Next => is_terminal || row + 1 == rows.end,
                    // The action of the last step leads to the terminal in its own row.
                    RewardRow::Same => !is_terminal && row + 1 == rows.end,
                };
                if leads_nowhere {
                    // Nothing is decided there, or what it led to is not known.
                } else if acted.iter().any(|column| column[shown].is_nan()) {
                    found.without_action.push(row);
                } else {
                    found.lagged.decisions += 1;
                    found.lagged.count += usize::from(shown < row + config.lag);
                }
            });
        }
        found.without_action.sort_unstable();
        found
    }
}

impl UnendedGaps {
    fn new(segments: &Segments, endings: &[Ending]) -> Self {
        let steps = segments.rows().saturating_sub(1);
        let lasts = segments.iter().map(|segment| segment.rows().end - 1);
        let mut before =
            lasts.filter(|&row| row < steps && endings[row] != Ending::Terminal).peekable();
        Self { steps, first: before.peek().copied(), count: before.count() }
    }

    /// Returns whether the gaps cost a tenth of the steps or more. Such a log probably has an uneven clock.
    pub fn are_many(&self) -> bool {
        self.count > 0 && 10 * self.count >= self.steps
    }
}

impl TerminalCells {
    fn of_column(column: &[f64]) -> Self {
        let mut cells = Self { rows: column.len(), ..Self::default() };
        for (row, value) in column.iter().enumerate() {
            if value.is_nan() {
                cells.empty += 1;
                cells.first_empty = cells.first_empty.or(Some(row));
            } else if *value == 0.0 {
                cells.zeros += 1;
            } else {
                cells.terminals += 1;
            }
        }
        cells
    }

    /// Returns whether empty cells may hide terminals. In a column that writes 0 where an episode continues, an empty cell does
    /// not show that it continues.
    pub fn are_unclear(&self) -> bool {
        self.zeros > 0 && self.empty > 0
    }

    /// Returns whether more than half of the rows are terminals, as in a column that shows that the plant runs.
    pub fn are_mostly_terminals(&self) -> bool {
        self.terminals > self.rows / 2
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NONE: f64 = f64::NAN;

    /// Returns the findings in a log of a valve and terminals, in one segment.
    fn found(keys: &str, valve: &[f64], terminal: &[f64]) -> ColumnFindings {
        let text = format!("actions = ['valve']\nreward = 'reward'\nterminal = 'end'\n{keys}");
        let config: ControlConfig = toml::from_str(&text).expect("valid");
        assert_eq!(config.columns(), ["valve", "reward", "end"]);
        let recorded = [valve.to_vec(), vec![0.0; valve.len()], terminal.to_vec()];
        let segments = Segments::from_lengths([valve.len()]).expect("rows");
        ColumnFindings::new(&config, &recorded, &segments)
    }

    #[test]
    fn rows_without_an_action_are_those_that_end_an_episode() {
        let valve = [1.0, NONE, NONE, 2.0, NONE, 1.0, NONE];
        let ends = [0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0];
        // A terminal ends its episode anyway, and the log ends in its last row.
        assert_eq!(found("", &valve, &ends).without_action, [1, 2]);
        // The last rows have no action because the log would show it later.
        let lagged = found("lag = 2", &[1.0, 1.0, NONE, 1.0, 1.0, 1.0, 1.0], &[0.0; 7]);
        assert_eq!(lagged.without_action, [0]);
    }

    #[test]
    fn gaps_after_terminals_are_no_loss() {
        let text = "actions = ['valve']\nterminal = 'end'";
        let config: ControlConfig = toml::from_str(text).expect("valid");
        assert_eq!(config.columns(), ["valve", "reward", "end"]);
        let ends = vec![0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        let segments = Segments::from_lengths([2, 1, 3]).expect("rows");
        let found =
            ColumnFindings::new(&config, &[vec![1.0; 6], vec![0.0; 6], ends], &segments).gaps;
        assert_eq!(found, UnendedGaps { count: 1, steps: 5, first: Some(2) });
        assert!(found.are_many());
        assert!(!UnendedGaps { steps: 11, ..found }.are_many());
        assert!(!UnendedGaps::default().are_many());
    }

    /// Returns the counts of the cells in a column of terminals.
    fn cells(ends: &[f64]) -> TerminalCells {
        found("", &vec![1.0; ends.len()], ends).terminal
    }

    #[test]
    fn empty_terminals_are_unclear_beside_zeros() {
        let mixed = cells(&[0.0, NONE, 1.0, 0.0, NONE, 0.0]);
        let expected =
            TerminalCells { rows: 6, terminals: 1, zeros: 3, empty: 2, first_empty: Some(1) };
        assert_eq!(mixed, expected);
        assert!(mixed.are_unclear() && !mixed.are_mostly_terminals());
        assert!(!cells(&[NONE, NONE, 1.0, NONE, NONE, 1.0]).are_unclear(), "1 at the ends alone");
        assert!(!cells(&[0.0, 0.0, 1.0, 0.0, 0.0, 1.0]).are_unclear());
    }

    #[test]
    fn terminals_in_most_rows_are_noticed() {
        assert!(cells(&[1.0, 1.0, 0.0, 1.0]).are_mostly_terminals());
        assert!(cells(&[2.0; 4]).are_mostly_terminals());
        assert!(!cells(&[0.0, 1.0, 0.0, 1.0]).are_mostly_terminals());
        let config =
            ControlConfig { actions: vec!["valve".to_owned()], ..ControlConfig::default() };
        let segments = Segments::from_lengths([2]).expect("rows");
        let none = ColumnFindings::new(&config, &[vec![1.0; 2], vec![0.0; 2]], &segments);
        assert_eq!(none.terminal, TerminalCells::default());
    }

    #[test]
    fn decisions_that_a_lag_takes_beyond_the_terminal_are_counted() {
        let mut ends = [0.0; 10];
        ends[4] = 1.0;
        ends[9] = 1.0;
        assert_eq!(
            found("lag = 1", &[1.0; 10], &ends).lagged,
            LaggedDecisions { count: 0, decisions: 8 }
        );
        // Row 3 is one row before the terminal in row 4, and row 8 one row before that in row 9.
        assert_eq!(
            found("lag = 2", &[1.0; 10], &ends).lagged,
            LaggedDecisions { count: 2, decisions: 8 }
        );
        assert_eq!(
            found("lag = 500", &[1.0; 10], &ends).lagged,
            LaggedDecisions { count: 8, decisions: 8 }
        );
    }
}
