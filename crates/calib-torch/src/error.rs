use calib_dynamics::DynamicsError;

/// An error of libtorch or of its set-up.
#[derive(Debug, thiserror::Error)]
pub enum TorchError {
    /// A name is not a device.
    #[error("there is no device \"{got}\"; expected cpu, cuda or auto")]
    UnknownDevice {
        /// The name that was given.
        got: String,
    },
    /// CUDA was requested and is not available.
    #[error("CUDA is not available: {reason}; use `--device cpu` or `--device auto`")]
    NoCuda {
        /// The reason.
        reason: String,
    },
    /// libtorch returned an error.
    #[error("libtorch: {0}")]
    Torch(#[from] tch::TchError),
}

impl From<TorchError> for DynamicsError {
    fn from(error: TorchError) -> Self {
        Self::Backend(error.to_string())
    }
}
