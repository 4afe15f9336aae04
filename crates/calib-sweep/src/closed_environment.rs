use calib_files::Fingerprint;

use crate::{Environment, EnvironmentId, RunStream, SweepError};

/// An environment of which everything is known but its streams: for plans of which this process runs other parts.
#[derive(Clone, Debug)]
pub struct ClosedEnvironment {
    /// Which it is.
    pub id: EnvironmentId,
    /// What the stream of each run is made from.
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
