use calib_core::Cancelled;
use calib_files::FileError;

/// An error from building, opening or querying a neighbour model.
#[derive(Debug, thiserror::Error)]
pub enum KnnError {
    /// There are fewer than two members: one block must be left out and one kept.
    #[error(
        "{members} ensemble members: an ensemble that leaves one block out needs at least 2; set `members` to 2 or more"
    )]
    TooFewMembers {
        /// Number of members that was asked for.
        members: usize,
    },
    /// There are fewer transitions than blocks.
    #[error(
        "{transitions} transitions cannot be split into {members} blocks; \
         use more data, lower `members`, or sub-sample less"
    )]
    TooFewTransitions {
        /// Number of transitions in the data.
        transitions: usize,
        /// Number of blocks that was asked for.
        members: usize,
    },
    /// `k` is zero.
    #[error("`neighbors` is 0: a step needs at least 1 neighbour to draw from")]
    NoNeighbors,
    /// A search in a member without transitions.
    #[error(
        "ensemble member {member} has no transitions to search; use more data, or lower `members`"
    )]
    EmptyMember {
        /// Number of the member.
        member: usize,
    },
    /// `prototypes` is zero.
    #[error(
        "`prototypes` is 0: it is the number of sources of which one can be a neighbour; 1 is all of them"
    )]
    NoPrototypes,
    /// There are as many components as columns, or more.
    #[error(
        "`components` is {components}, expected fewer than the {columns} columns of the states; set it to 0 to search in all of them"
    )]
    Components {
        /// Number of components that was asked for.
        components: usize,
        /// Number of columns of the states.
        columns: usize,
    },
    /// There is a leaf budget for a structure without leaves.
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
        /// Number of the member.
        member: usize,
        /// Smallest number of candidates that the exclusion leaves to any query.
        candidates: usize,
        /// Number of neighbours that was asked for.
        k: usize,
    },
    /// The states and the transitions have different numbers of rows.
    #[error(
        "{states} states do not match transitions over {segments} rows; build both from the same frames"
    )]
    Rows {
        /// Number of rows of the states.
        states: usize,
        /// Number of rows of the segments behind the transitions.
        segments: usize,
    },
    /// The query states have another number of columns than the model's states.
    #[error(
        "query states have {got} columns, the model's have {expected}; prepare both in the same way"
    )]
    Columns {
        /// Number of columns of the model's states.
        expected: usize,
        /// Number of columns of the query states.
        got: usize,
    },
    /// The states have more columns than the k-d tree supports.
    #[error(
        "the k-d tree supports at most {max} columns, got {columns}; choose the index \"auto\" (`model.index`, or --index), or search in fewer (`model.components`, `data.include`)"
    )]
    Dimensions {
        /// Number of columns of the states.
        columns: usize,
        /// Maximum number of columns that the tree supports.
        max: usize,
    },
    /// The temperature of the softmax weights is not positive and finite.
    #[error("`temperature` must be positive and finite, got {got}")]
    Temperature {
        /// The temperature given.
        got: f64,
    },
    /// A stored table does not fit the model.
    #[error("the table of ensemble member {member} is damaged: {reason}")]
    Table {
        /// Number of the member.
        member: usize,
        /// Where the damage is, what was expected and what was found.
        reason: String,
    },
    /// There are no points to search, or more than a `u32` position can number.
    #[error("{count} points: expected from 1 to {}", u32::MAX - 1)]
    Points {
        /// Number of points that were given.
        count: usize,
    },
    /// There is not enough memory for the results.
    #[error("cannot allocate {bytes} bytes for what is found; lower k, or ask for fewer at a time")]
    Memory {
        /// Size of one of the arrays, in bytes.
        bytes: usize,
    },
    /// There are fewer than `k` points to find.
    #[error("each point has only {most} others to find, fewer than k = {k}; lower k")]
    TooFewPoints {
        /// Number of neighbours that was asked for.
        k: usize,
        /// Number of points that can be found.
        most: usize,
    },
    /// The values are not valid states.
    #[error(transparent)]
    States(#[from] calib_core::StatesError),
    /// A file cannot be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// The monitor interrupted.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}
