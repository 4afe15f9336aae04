use calib_agent::{Checkpoint, FittedPredictor};
use calib_files::Fingerprint;

/// The checkpoint that the agents of one sensor start from.
#[derive(Clone, Debug, PartialEq)]
pub struct Start {
    /// Parameters, and optimiser moments if they are to be kept.
    pub checkpoint: Checkpoint,
    /// The baseline under the value function, if it was pre-trained on top of one.
    pub baseline: Option<FittedPredictor>,
    /// Fingerprint of the checkpoint and of the parts that are used.
    pub fingerprint: Fingerprint,
}
