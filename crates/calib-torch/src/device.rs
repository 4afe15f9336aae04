use std::{fmt, str::FromStr, sync::OnceLock};

use libloading::os::unix::{Library, RTLD_GLOBAL, RTLD_NOW};
use tch::{Cuda, Device};

use crate::TorchError;

/// The requested device.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DeviceChoice {
    /// The CPU.
    Cpu,
    /// The first GPU.
    Cuda,
    /// The first GPU if there is one, or the CPU.
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

/// The CUDA part of libtorch once it is loaded, or the error of loading it.
static LOADED: OnceLock<Result<Library, String>> = OnceLock::new();

/// Returns the device of a choice.
///
/// On the CPU, libtorch uses one thread. Networks of these sizes gain little from more. Threads that wait for each other lose much if the
/// machine has other work. Results do not depend on their number. The CUDA part of libtorch is loaded when it is first requested, so
/// programs link only to parts that work everywhere.
///
/// # Errors
/// [`TorchError::NoCuda`] if CUDA was requested and is not available.
pub fn device(choice: DeviceChoice) -> Result<Device, TorchError> {
    tch::set_num_threads(1);
    if choice == DeviceChoice::Cpu {
        return Ok(Device::Cpu);
    }
    let loaded = LOADED.get_or_init(|| {
        // SAFETY: loading libtorch's CUDA part runs its initialisers. They register kernels with the libtorch that this program is linked
        // with, which is of the same installation (the run path leads there). It is never unloaded.
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
