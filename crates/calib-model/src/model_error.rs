use calib_core::Cancelled;
use calib_dynamics::DynamicsError;
use calib_knn::KnnError;

use crate::RolloutError;

/// Why a calibration model does not start, step or predict.
#[derive(Debug, thiserror::Error)]
pub enum ModelError {
    /// No start states, or none that can be used.
    #[error(transparent)]
    Start(RolloutError),
    /// The network cannot be run.
    #[error(transparent)]
    Network(DynamicsError),
    /// Neighbours cannot be searched.
    #[error(transparent)]
    Search(KnnError),
    /// A start of a model of neighbours was given to a network, or the other way round.
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
