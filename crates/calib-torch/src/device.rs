use std::{fmt, str::FromStr, sync::OnceLock};

use libloading::os::unix::{Library, RTLD_GLOBAL, RTLD_NOW};
use tch::{Cuda, Device};

use crate::TorchError;

/// Where to compute.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DeviceChoice {
    /// On the processor.
    Cpu,
    /// On the first GPU.
    Cuda,
    /// On the first GPU if there is one.
    #[default]
    Auto,
}

impl FromStr for DeviceChoice {
    type Err = TorchError;

    fn from_str(text: &str) -> Result<Self, TorchError> {
        match text {
            "cpu" => Ok(Self::Cpu),
            "cuda" => Ok(Self::Cuda),
            "auto" => Ok(Self::Auto),
            got => Err(TorchError::UnknownDevice { got: got.to_owned() }),
        }
    }
}

impl fmt::Display for DeviceChoice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Cpu => "cpu",
            Self::Cuda => "cuda",
            Self::Auto => "auto",
        })
    }
}

/// CUDA's part of libtorch, once it is loaded, or why it cannot be.
static LOADED: OnceLock<Result<Library, String>> = OnceLock::new();

/// The device of a choice.
///
/// On the processor libtorch works on one thread: networks of these sizes gain little from more, threads that wait for
/// each other lose much where the machine has other work, and results do not depend on their number. CUDA's part of libtorch is loaded when it is first asked for: programs link only
/// what works everywhere.
///
/// # Errors
/// [`TorchError::NoCuda`] if CUDA was asked for and is not available.
pub fn device(choice: DeviceChoice) -> Result<Device, TorchError> {
    tch::set_num_threads(1);
    if choice == DeviceChoice::Cpu {
        return Ok(Device::Cpu);
    }
    let loaded = LOADED.get_or_init(|| {
        // SAFETY: loading libtorch's CUDA part runs its initialisers, which register kernels with the libtorch that
        // this program is linked with and is of the same installation (the run path leads there). It is never unloaded.
        unsafe { Library::open(Some("libtorch_cuda.so"), RTLD_NOW | RTLD_GLOBAL) }
            .map_err(|error| error.to_string())
    });
    match (choice, loaded) {
        (_, Ok(_)) if Cuda::is_available() => Ok(Device::Cuda(0)),
        (DeviceChoice::Auto, _) => Ok(Device::Cpu),
        (_, Ok(_)) => Err(TorchError::NoCuda { reason: "no GPU was found".to_owned() }),
        (_, Err(reason)) => Err(TorchError::NoCuda { reason: reason.clone() }),
    }
}
