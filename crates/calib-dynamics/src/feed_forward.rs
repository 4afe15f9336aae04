use calib_nn::{Mlp, Workspace};

use crate::{Dynamics, DynamicsError, LANES, LaneRollouts};

/// The NN baseline: a feed-forward network with `ReLU` between layers, whose output is the next
/// state.
#[derive(Clone, Debug, PartialEq)]
pub struct FeedForward {
    network: Mlp,
}

impl FeedForward {
    /// Creates a model from a network.
    ///
    /// # Errors
    /// If it does not map states to states.
    pub fn new(network: Mlp) -> Result<Self, DynamicsError> {
        let inputs = network.inputs();
        let outputs = network.outputs();
        if inputs != outputs {
            let reason = format!("{inputs} values go in and {outputs} come out, expected as many");
            return Err(DynamicsError::Weights { reason });
        }
        Ok(Self { network })
    }

    /// Returns the network.
    pub fn network(&self) -> &Mlp {
        &self.network
    }
}

impl Dynamics for FeedForward {
    fn columns(&self) -> usize {
        self.network.inputs()
    }

    fn history(&self) -> usize {
        0
    }

    fn begin_rollouts(&self) -> Result<Box<dyn LaneRollouts + '_>, DynamicsError> {
        let workspace = Workspace::new(&self.network, LANES);
        Ok(Box::new(FeedForwardRollouts { network: &self.network, workspace }))
    }
}

struct FeedForwardRollouts<'a> {
    network: &'a Mlp,
    workspace: Workspace,
}

impl LaneRollouts for FeedForwardRollouts<'_> {
    fn step(&mut self, states: &[f32], next: &mut [f32]) -> Result<(), DynamicsError> {
        next.copy_from_slice(self.network.forward(states, &mut self.workspace));
        Ok(())
    }

    fn forget(&mut self, _lane: usize) {}
}
