use calib_core::Cancelled;
use calib_files::FileError;

/// Why a neighbour model cannot be built, opened or asked.
#[derive(Debug, thiserror::Error)]
pub enum KnnError {
    /// An ensemble needs something to leave out and something to keep.
    #[error(
        "{members} ensemble members: an ensemble that leaves one block out needs at least 2; set `members` to 2 or more"
    )]
    TooFewMembers {
        /// Members asked for.
        members: usize,
    },
    /// There are fewer transitions than blocks.
    #[error(
        "{transitions} transitions cannot be split into {members} blocks; \
         use more data, lower `members`, or sub-sample less"
    )]
    TooFewTransitions {
        /// Transitions in the data.
        transitions: usize,
        /// Blocks asked for.
        members: usize,
    },
    /// `k` is zero.
    #[error("`neighbors` is 0: a step needs at least 1 neighbour to draw from")]
    NoNeighbors,
    /// A member without transitions is searched.
    #[error(
        "ensemble member {member} has no transitions to search; use more data, or lower `members`"
    )]
    EmptyMember {
        /// The member.
        member: usize,
    },
    /// `prototypes` is zero.
    #[error(
        "`prototypes` is 0: it is the number of sources of which one can be a neighbour; 1 is all of them"
    )]
    NoPrototypes,
    /// As many components as columns, or more.
    #[error(
        "`components` is {components}, expected fewer than the {columns} columns of the states; set it to 0 to search in all of them"
    )]
    Components {
        /// Components asked for.
        components: usize,
        /// Columns of the states.
        columns: usize,
    },
    /// A budget of leaves for a structure without leaves.
    #[error(
        "`leaf_budget` is for the join, and `index` is \"{index}\"; set `index` to \"join\" or \"auto\", or `leaf_budget` to 0"
    )]
    Budget {
        /// The structure that was asked for.
        index: &'static str,
    },
    /// A query has fewer admissible candidates than `k`.
    #[error(
        "ensemble member {member} has states with only {candidates} possible neighbours, fewer than `neighbors` = {k}; use more data, or lower `neighbors`, `members`, `theiler` or `prototypes`"
    )]
    TooFewCandidates {
        /// The member.
        member: usize,
        /// Candidates that the exclusion leaves to the worst-off query.
        candidates: usize,
        /// Neighbours asked for.
        k: usize,
    },
    /// States and transitions disagree about the number of rows.
    #[error(
        "{states} states do not match transitions over {segments} rows; build both from the same frames"
    )]
    Rows {
        /// Rows of the states.
        states: usize,
        /// Rows of the segments behind the transitions.
        segments: usize,
    },
    /// Query states have another width than the model's.
    #[error(
        "query states have {got} columns, the model's have {expected}; prepare both in the same way"
    )]
    Columns {
        /// Columns of the model's states.
        expected: usize,
        /// Columns of the query states.
        got: usize,
    },
    /// The k-d tree was asked for more dimensions than it is compiled for.
    #[error(
        "the k-d tree supports at most {max} columns, got {columns}; choose the index \"auto\" (`model.index`, or --index), or search in fewer (`model.components`, `data.include`)"
    )]
    Dimensions {
        /// Columns of the states.
        columns: usize,
        /// The most that the tree supports.
        max: usize,
    },
    /// Softmax weights need a positive temperature.
    #[error("`temperature` must be positive and finite, got {got}")]
    Temperature {
        /// The temperature given.
        got: f64,
    },
    /// A stored table does not fit the model.
    #[error("the table of ensemble member {member} is damaged: {reason}")]
    Table {
        /// The member.
        member: usize,
        /// Where, what was expected and what was found.
        reason: String,
    },
    /// No points to search, or more than positions can number.
    #[error("{count} points: expected from 1 to {}", u32::MAX - 1)]
    Points {
        /// Points that were given.
        count: usize,
    },
    /// There is no room for what would be found.
    #[error("cannot allocate {bytes} bytes for what is found; lower k, or ask for fewer at a time")]
    Memory {
        /// Of one of the arrays.
        bytes: usize,
    },
    /// There are not as many points to find.
    #[error("each point has only {most} others to find, fewer than k = {k}; lower k")]
    TooFewPoints {
        /// Neighbours asked for.
        k: usize,
        /// Points that there are.
        most: usize,
    },
    /// Values are not those of states.
    #[error(transparent)]
    States(#[from] calib_core::StatesError),
    /// A file cannot be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// The observer asked to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}
