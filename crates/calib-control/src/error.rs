use calib_core::{Cancelled, SegmentError, StatesError};
use calib_knn::KnnError;
use calib_stats::StatsError;

use crate::Ending;

/// An error of agents that act, their logs or their models.
#[derive(Debug, thiserror::Error)]
pub enum ControlError {
    /// A field of an agent or a model has a value that is not valid.
    #[error("`{field}` is {got}, expected {expected}")]
    Field {
        /// The field.
        field: &'static str,
        /// Its value.
        got: f64,
        /// The valid values.
        expected: &'static str,
    },
    /// A field of a section below `[control]` has a value that is not valid.
    #[error("`control.{section}.{field}` is {got}, expected {expected}")]
    SectionField {
        /// The section.
        section: &'static str,
        /// The field.
        field: &'static str,
        /// Its value.
        got: f64,
        /// The valid values.
        expected: &'static str,
    },
    /// A list of the grid is empty.
    #[error("control.grid.{field} has no value; leave the key out, or list at least one")]
    EmptyAxis {
        /// The field.
        field: &'static str,
    },
    /// A field of the grid that no swept algorithm uses.
    #[error(
        "control.grid.{field} decides nothing: {algorithm} does not use it; leave the key out, or list an algorithm that does"
    )]
    UnusedAxis {
        /// The field.
        field: &'static str,
        /// The algorithm of the agents.
        algorithm: &'static str,
    },
    /// The same value occurs twice in one field of the grid.
    #[error("control.grid.{field} has the value {value} twice; remove one")]
    RepeatedValue {
        /// The field.
        field: &'static str,
        /// The value.
        value: String,
    },
    /// A study does not name the columns of actions.
    #[error("`actions` is empty; name the columns of the action that was taken in a row")]
    NoActions,
    /// A column has two roles.
    #[error(
        "control.{key} names {column}, which control.{before} names already; name another column{}",
        if [*key, *before].contains(&"reward") {
            format!(", or make it a term of the reward: reward = [{{ column = \"{column}\", weight = 1 }}]")
        } else {
            String::new()
        }
    )]
    RepeatedColumn {
        /// The key that names the column again.
        key: &'static str,
        /// The column.
        column: String,
        /// The key that names it first.
        before: &'static str,
    },
    /// The list of models is empty.
    #[error(
        "control.models is empty; list \"neighbors\", \"increments\" or \"network\", or leave the key out for all of them"
    )]
    NoModels,
    /// A kind of model occurs twice.
    #[error("control.models has \"{kind}\" twice; remove one")]
    RepeatedModel {
        /// The kind.
        kind: &'static str,
    },
    /// A reward has no terms.
    #[error(
        "`reward` has no term; name a column, or list terms such as {{ column = \"flow\", weight = 1 }}"
    )]
    EmptyReward,
    /// A number in a term of the reward is not valid.
    #[error("`reward[{term}].{key}` is {got}, expected {expected}")]
    Term {
        /// The number of the term, from 0.
        term: usize,
        /// The key of the term.
        key: &'static str,
        /// Its value.
        got: f64,
        /// The valid values.
        expected: &'static str,
    },
    /// A term of the reward has two meanings.
    #[error("reward[{term}] has both {first} and {second}: write two terms, each with one of them")]
    TwoMeanings {
        /// Its number, from 0.
        term: usize,
        /// A key of the term.
        first: &'static str,
        /// A key that cannot stand beside it.
        second: &'static str,
    },
    /// A term of the reward is always zero.
    #[error(
        "the set-point of reward[{term}] is its own column, {column}, from which it never differs; name the column that holds the set-point, or \
         leave set_point out"
    )]
    OwnSetPoint {
        /// Its number, from 0.
        term: usize,
        /// The column.
        column: String,
    },
    /// The log has more different actions than are allowed.
    #[error(
        "the log has more than {most} different actions; if a column of them is continuous, set control.levels (7, say), else round it, or raise \
         control.most_actions"
    )]
    ManyActions {
        /// The number of allowed actions.
        most: usize,
    },
    /// Levels of several columns have more combinations than are allowed.
    #[error(
        "the levels of the columns of actions have more than {most} combinations; {remedy}, or raise control.most_actions"
    )]
    ManyLevels {
        /// The number of allowed combinations.
        most: usize,
        /// A way to have fewer combinations.
        remedy: &'static str,
    },
    /// Tile coding has more features than can be numbered.
    #[error(
        "states of {columns} columns have {weights} weights of tiles, at most 4294967295 can be numbered; set control.agent.pairs = false, or keep fewer columns"
    )]
    ManyFeatures {
        /// Columns of the states.
        columns: usize,
        /// Features, times actions.
        weights: u128,
    },
    /// An ensemble member would have no transitions for training, or none for validation.
    #[error("the log has too few transitions for networks of {members} ensemble members")]
    FewTransitions {
        /// Number of ensemble members.
        members: usize,
    },
    /// A network diverged in training.
    #[error(
        "the network of ensemble member {member} diverged; leave \"network\" out of control.models"
    )]
    NetworkDiverged {
        /// The ensemble member.
        member: usize,
    },
    /// The columns of a log have different lengths.
    #[error("{what}: {got} rows, expected {expected} as the states have")]
    Rows {
        /// The name of the column.
        what: &'static str,
        /// Rows of the states.
        expected: usize,
        /// Rows of the column.
        got: usize,
    },
    /// No action in the log leads from one row to another.
    #[error(
        "the log has no transition: no row with an action is followed by a row of the same episode that has a reward"
    )]
    NoTransitions,
    /// Every row is a terminal.
    #[error(
        "the log has no transition: the terminal is another number than 0 in every row, so that every row ends an episode and no action leads \
         anywhere; name a column that is 0 where an episode goes on"
    )]
    OnlyTerminals,
    /// There are fewer transitions than ensemble members.
    #[error(
        "{transitions} transitions cannot be split into {members} blocks; record more, or lower control.model.members"
    )]
    FewForMembers {
        /// Transitions in the log.
        transitions: usize,
        /// Number of ensemble members in the study.
        members: usize,
    },
    /// No episode is long enough for a decision of several rows.
    #[error(
        "no recorded episode has more rows than control.every = {every}, nor ends in a terminal; lower control.every, or see where rows lack an action or a reward"
    )]
    NoDecisions {
        /// Rows per decision.
        every: usize,
    },
    /// Probabilities are given for continuous actions.
    #[error(
        "control.levels makes actions continuous, and what was set then has no probability but a density; leave control.probability out"
    )]
    ProbabilityOfLevels,
    /// A probability is not above 0 and at most 1.
    #[error(
        "row {row}: the probability of the action that was taken is {got}, expected above 0, up to 1"
    )]
    NoProbability {
        /// The row.
        row: usize,
        /// Its value.
        got: f64,
    },
    /// The program of an agent failed.
    #[error(transparent)]
    Program(Box<dyn std::error::Error + Send + Sync>),
    /// There is no state in which an episode could begin.
    #[error("there is no state to begin episodes in")]
    NoStarts,
    /// A file of a stored model does not belong to it.
    #[error("{} does not belong to this model: it was damaged or replaced; make the model again", path.display())]
    Damaged {
        /// The file.
        path: std::path::PathBuf,
    },
    /// The stored file does not hold the expected agent.
    #[error("this is not the stored agent that was expected: {reason}")]
    NoAgent {
        /// The reason.
        reason: String,
    },
    /// A file cannot be read.
    #[error(transparent)]
    Files(#[from] calib_files::FileError),
    /// The search for neighbours failed.
    #[error(transparent)]
    Knn(KnnError),
    /// The states are not valid.
    #[error(transparent)]
    States(#[from] StatesError),
    /// Segments could not be made.
    #[error(transparent)]
    Segments(#[from] SegmentError),
    /// A statistic could not be computed.
    #[error(transparent)]
    Stats(#[from] StatsError),
    /// The observer asked to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

impl ControlError {
    /// Names a field by its key in this section below `[control]`.
    pub(crate) fn in_section(self, section: &'static str) -> Self {
        match self {
            Self::Field { field, got, expected } => {
                Self::SectionField { section, field, got, expected }
            }
            other => other,
        }
    }

    /// Returns the error that every row is a terminal if all of these endings are terminals. Otherwise returns this error, for a log
    /// without transitions.
    pub(crate) fn or_only_terminals(self, endings: &[Ending]) -> Self {
        if endings.iter().all(|&ending| ending == Ending::Terminal) {
            Self::OnlyTerminals
        } else {
            self
        }
    }
}

/// Checks fields in turn. Each has its name, its value, whether that is valid, and the valid values.
///
/// # Errors
/// If a field is not valid. The error names the first one.
pub(crate) fn check_fields(
    checks: &[(&'static str, f64, bool, &'static str)],
) -> Result<(), ControlError> {
    match checks.iter().find(|check| !check.2) {
        Some(&(field, got, _, expected)) => Err(ControlError::Field { field, got, expected }),
        None => Ok(()),
    }
}

impl From<KnnError> for ControlError {
    fn from(error: KnnError) -> Self {
        match error {
            KnnError::Cancelled(cancelled) => Self::Cancelled(cancelled),
            KnnError::TooFewTransitions { transitions, members } => {
                Self::FewForMembers { transitions, members }
            }
            other => Self::Knn(other),
        }
    }
}
