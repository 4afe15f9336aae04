use calib_dynamics::DynamicsError;

/// Why libtorch could not do what was asked.
#[derive(Debug, thiserror::Error)]
pub enum TorchError {
    /// A name that is no device.
    #[error("there is no device \"{got}\"; expected cpu, cuda or auto")]
    UnknownDevice {
        /// What was asked for.
        got: String,
    },
    /// CUDA was asked for and is not there.
    #[error("CUDA is not available: {reason}; use `--device cpu` or `--device auto`")]
    NoCuda {
        /// Why.
        reason: String,
    },
    /// libtorch refused.
    #[error("libtorch: {0}")]
    Torch(#[from] tch::TchError),
}

impl From<TorchError> for DynamicsError {
    fn from(error: TorchError) -> Self {
        Self::Backend(error.to_string())
    }
}
