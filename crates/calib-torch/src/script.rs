use std::{fmt, path::Path, sync::Mutex};

use calib_dynamics::{Dynamics, DynamicsError, LANES, LaneRollouts};
use tch::{CModule, Device, Kind, Tensor, no_grad};

use crate::{TorchError, adam::values};

/// A user's dynamics model, exported from PyTorch with `torch.jit.script` or `torch.jit.trace`. Its `forward` takes
/// normalised states `[n, columns]` and returns the next ones.
pub struct Script {
    /// Only one rollout runs at a time, because a module may have buffers.
    module: Mutex<CModule>,
    columns: usize,
    device: Device,
}

impl fmt::Debug for Script {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Script").field("columns", &self.columns).finish_non_exhaustive()
    }
}

impl Script {
    /// Opens the file at `path` for states of `columns` values, and runs it once on zeros.
    ///
    /// # Errors
    /// If it is not a `TorchScript` file, or its `forward` does not map states to states.
    pub fn open(path: &Path, columns: usize, device: Device) -> Result<Self, DynamicsError> {
        let mut module = CModule::load_on_device(path, device)
            .map_err(|error| refused(path, &first_line(&error)))?;
        module.set_eval();
        let script = Self { module: Mutex::new(module), columns, device };
        let mut next = vec![0.0; LANES * columns];
        script
            .run(&vec![0.0; LANES * columns], &mut next)
            .map_err(|error| refused(path, &error.to_string()))?;
        Ok(script)
    }

    fn run(&self, states: &[f32], next: &mut [f32]) -> Result<(), DynamicsError> {
        let module =
            self.module.lock().map_err(|error| DynamicsError::Backend(error.to_string()))?;
        no_grad(|| {
            let shape = [LANES as i64, self.columns as i64];
            let input = Tensor::from_slice(states).view(shape).to_device(self.device);
            let output = module
                .forward_ts(&[input])
                .map_err(|error| DynamicsError::Backend(first_line(&error)))?;
            if output.size() != shape {
                let got = output.size();
                let columns = self.columns;
                return Err(DynamicsError::Backend(format!(
                    "forward gives {got:?} for states [{LANES}, {columns}], expected as many"
                )));
            }
            next.copy_from_slice(&values(&output.to_kind(Kind::Float)).map_err(TorchError::from)?);
            Ok(())
        })
    }
}

fn refused(path: &Path, reason: &str) -> DynamicsError {
    DynamicsError::Weights { reason: format!("{}: {reason}", path.display()) }
}

/// Returns the first line of a libtorch message. The other lines are positions in libtorch's own code.
fn first_line(error: &tch::TchError) -> String {
    error.to_string().lines().find(|line| !line.trim().is_empty()).unwrap_or_default().to_owned()
}

impl Dynamics for Script {
    fn columns(&self) -> usize {
        self.columns
    }

    fn history(&self) -> usize {
        0
    }

    fn begin_rollouts(&self) -> Result<Box<dyn LaneRollouts + '_>, DynamicsError> {
        Ok(Box::new(ScriptRollouts { script: self }))
    }
}

struct ScriptRollouts<'a> {
    script: &'a Script,
}

impl LaneRollouts for ScriptRollouts<'_> {
    fn step(&mut self, states: &[f32], next: &mut [f32]) -> Result<(), DynamicsError> {
        self.script.run(states, next)
    }

    fn forget(&mut self, _lane: usize) {}
}
