use calib_files::Fingerprint;

use crate::{Environment, EnvironmentId, RunStream, SweepError};

/// The description of an environment without its streams, for plans of which this process runs only other parts.
#[derive(Clone, Debug)]
pub struct ClosedEnvironment {
    /// The environment.
    pub id: EnvironmentId,
    /// The fingerprint of each run's stream inputs.
    pub inputs: Vec<Fingerprint>,
}

impl Environment for ClosedEnvironment {
    fn id(&self) -> EnvironmentId {
        self.id
    }

    fn runs(&self) -> usize {
        self.inputs.len()
    }

    fn inputs(&self, run: usize) -> Fingerprint {
        self.inputs[run].clone()
    }

    fn stream(&self, _run: usize) -> Result<RunStream, SweepError> {
        Err(SweepError::Closed(self.id))
    }
}
