use calib_core::{Cancelled, RowIndex};
use calib_dynamics::DynamicsError;
use calib_knn::KnnError;

/// An error in finding start states or making rollouts.
#[derive(Debug, thiserror::Error)]
pub enum RolloutError {
    /// The start source is rows, but no rows are listed.
    #[error(
        "`start` is \"rows\", but no rows or timestamps are given; list them in `rows` or `timestamps`"
    )]
    NoRows,
    /// A start row is not a row of the data.
    #[error("start row {} does not exist: the data has rows 0 to {}", row.0, rows - 1)]
    UnknownRow {
        /// The requested row.
        row: RowIndex,
        /// Rows of the data.
        rows: usize,
    },
    /// The number of a month is invalid.
    #[error("`month` must be 1 to 12, got {got}")]
    Month {
        /// The given number.
        got: u8,
    },
    /// The data have no rows in the month.
    #[error(
        "the model's data has no rows in month {month}{}; \
         use `start` = \"random\" or \"nearest\", another `month`, or more data",
        before.map_or_else(String::new, |year| format!(" of a year before {year}"))
    )]
    EmptyMonth {
        /// The month, 1 to 12.
        month: u8,
        /// The calendar year in which the deployment begins.
        before: Option<i64>,
    },
    /// There are no recent rows.
    #[error(
        "`start` is \"recent\", but the model's data has no transition before the deployment; \
         use `start` = \"random\" or \"nearest\""
    )]
    NothingBefore,
    /// A model without transitions cannot be rolled out from anywhere.
    #[error("the model has no transitions to start from; use more data, or sub-sample less")]
    NoTransitions,
    /// The number of timestamps differs from the number of rows.
    #[error("{timestamps} timestamps do not match {rows} rows")]
    Timestamps {
        /// Number of timestamps.
        timestamps: usize,
        /// Rows of the data.
        rows: usize,
    },
    /// The deployment period has no states to start from.
    #[error("`start` is \"nearest\", but the deployment period has no states")]
    NoStates,
    /// Every source in the ensemble member is forbidden for a start row.
    #[error(
        "row {} has no possible neighbour in ensemble member {member}; lower `theiler`, or start elsewhere",
        row.0
    )]
    NoNeighbor {
        /// The start row.
        row: RowIndex,
        /// The ensemble member.
        member: usize,
    },
    /// The search for start states failed.
    #[error(transparent)]
    Search(KnnError),
    /// The observer asked to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

impl From<KnnError> for RolloutError {
    fn from(error: KnnError) -> Self {
        match error {
            KnnError::Cancelled(cancelled) => Self::Cancelled(cancelled),
            other => Self::Search(other),
        }
    }
}

/// An error of a calibration model.
#[derive(Debug, thiserror::Error)]
pub enum ModelError {
    /// There are no usable start states.
    #[error(transparent)]
    Start(RolloutError),
    /// The network cannot be run.
    #[error(transparent)]
    Network(DynamicsError),
    /// Neighbours cannot be searched.
    #[error(transparent)]
    Search(KnnError),
    /// A start state of a neighbour model was given to a network, or the other way
    /// round.
    #[error("the start is one of another kind of model")]
    OtherStart,
    /// The observer asked to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

impl From<RolloutError> for ModelError {
    fn from(error: RolloutError) -> Self {
        match error {
            RolloutError::Cancelled(cancelled) => Self::Cancelled(cancelled),
            other => Self::Start(other),
        }
    }
}

impl From<DynamicsError> for ModelError {
    fn from(error: DynamicsError) -> Self {
        match error {
            DynamicsError::Cancelled(cancelled) => Self::Cancelled(cancelled),
            other => Self::Network(other),
        }
    }
}

impl From<KnnError> for ModelError {
    fn from(error: KnnError) -> Self {
        match error {
            KnnError::Cancelled(cancelled) => Self::Cancelled(cancelled),
            other => Self::Search(other),
        }
    }
}
