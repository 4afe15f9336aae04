use calib_core::{Cancelled, SegmentError, StatesError};
use calib_knn::KnnError;
use calib_stats::StatsError;

use crate::Ending;

/// Why something of agents that act cannot be done.
#[derive(Debug, thiserror::Error)]
pub enum ControlError {
    /// A field of an agent or a model cannot be what it is.
    #[error("`{field}` is {got}, expected {expected}")]
    Field {
        /// The field.
        field: &'static str,
        /// What it is.
        got: f64,
        /// What it may be.
        expected: &'static str,
    },
    /// The same of a section below `[control]`, by the key of a study.
    #[error("`control.{section}.{field}` is {got}, expected {expected}")]
    SectionField {
        /// The section.
        section: &'static str,
        /// The field.
        field: &'static str,
        /// What it is.
        got: f64,
        /// What it may be.
        expected: &'static str,
    },
    /// A list of the grid is empty.
    #[error("control.grid.{field} has no value; leave the key out, or list at least one")]
    EmptyAxis {
        /// The field.
        field: &'static str,
    },
    /// A field of the grid that no agent uses.
    #[error(
        "control.grid.{field} decides nothing: {algorithm} does not use it; leave the key out, or list an algorithm that does"
    )]
    UnusedAxis {
        /// The field.
        field: &'static str,
        /// What the agents learn by.
        algorithm: &'static str,
    },
    /// The same value twice in one field of the grid.
    #[error("control.grid.{field} has the value {value} twice; remove one")]
    RepeatedValue {
        /// The field.
        field: &'static str,
        /// The value.
        value: String,
    },
    /// A study does not say which columns are actions.
    #[error("`actions` is empty; name the columns of the action that was taken in a row")]
    NoActions,
    /// A column that is two things.
    #[error(
        "control.{key} names {column}, which control.{before} names already; name another column{}",
        if [*key, *before].contains(&"reward") {
            format!(", or make it a term of the reward: reward = [{{ column = \"{column}\", weight = 1 }}]")
        } else {
            String::new()
        }
    )]
    RepeatedColumn {
        /// The key that names it again.
        key: &'static str,
        /// The column.
        column: String,
        /// The key that names it first.
        before: &'static str,
    },
    /// No kind of model to let agents act in.
    #[error(
        "control.models is empty; list \"neighbors\", \"increments\" or \"network\", or leave the key out for all of them"
    )]
    NoModels,
    /// A kind of model twice.
    #[error("control.models has \"{kind}\" twice; remove one")]
    RepeatedModel {
        /// The kind.
        kind: &'static str,
    },
    /// A reward without terms.
    #[error(
        "`reward` has no term; name a column, or list terms such as {{ column = \"flow\", weight = 1 }}"
    )]
    EmptyReward,
    /// A number in a term of the reward cannot be what it is.
    #[error("`reward[{term}].{key}` is {got}, expected {expected}")]
    Term {
        /// The number of the term, from 0.
        term: usize,
        /// The key of the term.
        key: &'static str,
        /// What it is.
        got: f64,
        /// What it may be.
        expected: &'static str,
    },
    /// A term of the reward that means two things.
    #[error("reward[{term}] has both {first} and {second}: write two terms, each with one of them")]
    TwoMeanings {
        /// Its number, from 0.
        term: usize,
        /// A key of the term.
        first: &'static str,
        /// A key that cannot stand beside it.
        second: &'static str,
    },
    /// A term of the reward that is always nought.
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
    /// More different actions than are allowed.
    #[error(
        "the log has more than {most} different actions; if a column of them is continuous, set control.levels (7, say), else round it, or raise \
         control.most_actions"
    )]
    ManyActions {
        /// How many are allowed.
        most: usize,
    },
    /// Levels of several columns have more combinations than are allowed.
    #[error(
        "the levels of the columns of actions have more than {most} combinations; {remedy}, or raise control.most_actions"
    )]
    ManyLevels {
        /// How many are allowed.
        most: usize,
        /// How to have fewer.
        remedy: &'static str,
    },
    /// Tile coding of more features than can be numbered.
    #[error(
        "states of {columns} columns have {weights} weights of tiles, at most 4294967295 can be numbered; set control.agent.pairs = false, or keep fewer columns"
    )]
    ManyFeatures {
        /// Columns of the states.
        columns: usize,
        /// Features, times actions.
        weights: u128,
    },
    /// A log of which a member would have nothing to learn from, or nothing to check that by.
    #[error("the log has too few transitions for networks of {members} ensemble members")]
    FewTransitions {
        /// How many members.
        members: usize,
    },
    /// A network diverged in training.
    #[error(
        "the network of ensemble member {member} diverged; leave \"network\" out of control.models"
    )]
    NetworkDiverged {
        /// Which member.
        member: usize,
    },
    /// The columns of a log have different lengths.
    #[error("{what}: {got} rows, expected {expected} as the states have")]
    Rows {
        /// Which column.
        what: &'static str,
        /// Rows of the states.
        expected: usize,
        /// Rows of it.
        got: usize,
    },
    /// No row of the log leads to another one by an action.
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
    /// Fewer transitions than ensemble members.
    #[error(
        "{transitions} transitions cannot be split into {members} blocks; record more, or lower control.model.members"
    )]
    FewForMembers {
        /// Transitions in the log.
        transitions: usize,
        /// Members asked for.
        members: usize,
    },
    /// No decision of several rows.
    #[error(
        "no recorded episode has more rows than control.every = {every}, nor ends in a terminal; lower control.every, or see where rows lack an action or a reward"
    )]
    NoDecisions {
        /// Rows of a decision.
        every: usize,
    },
    /// Probabilities of continuous actions.
    #[error(
        "control.levels makes actions continuous, and what was set then has no probability but a density; leave control.probability out"
    )]
    ProbabilityOfLevels,
    /// A probability is none.
    #[error(
        "row {row}: the probability of the action that was taken is {got}, expected above 0, up to 1"
    )]
    NoProbability {
        /// The row.
        row: usize,
        /// What it is.
        got: f64,
    },
    /// A program whose agents act failed.
    #[error(transparent)]
    Program(Box<dyn std::error::Error + Send + Sync>),
    /// No state to begin episodes in.
    #[error("there is no state to begin episodes in")]
    NoStarts,
    /// A file of a stored model is not one of it.
    #[error("{} does not belong to this model: it was damaged or replaced; make the model again", path.display())]
    Damaged {
        /// The file.
        path: std::path::PathBuf,
    },
    /// What was stored is no agent, or another one.
    #[error("this is not the stored agent that was expected: {reason}")]
    NoAgent {
        /// What is wrong.
        reason: String,
    },
    /// A file cannot be read.
    #[error(transparent)]
    Files(#[from] calib_files::FileError),
    /// The search failed.
    #[error(transparent)]
    Knn(KnnError),
    /// The states are not states.
    #[error(transparent)]
    States(#[from] StatesError),
    /// Segments could not be made.
    #[error(transparent)]
    Segments(#[from] SegmentError),
    /// A statistic could not be taken.
    #[error(transparent)]
    Stats(#[from] StatsError),
    /// The observer asked to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

impl ControlError {
    /// With a field named by its key in this section below `[control]`.
    pub(crate) fn in_section(self, section: &'static str) -> Self {
        match self {
            Self::Field { field, got, expected } => {
                Self::SectionField { section, field, got, expected }
            }
            other => other,
        }
    }

    /// That every row is a terminal, where steps with these endings are none but terminals; else this error, for a log of which no transition
    /// is left.
    pub(crate) fn or_only_terminals(self, endings: &[Ending]) -> Self {
        if endings.iter().all(|&ending| ending == Ending::Terminal) {
            Self::OnlyTerminals
        } else {
            self
        }
    }
}

/// Check fields in turn: each with its name, its value, whether that is valid, and what is expected.
///
/// # Errors
/// The first field that is not valid.
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
