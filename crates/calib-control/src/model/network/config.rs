use crate::{ControlError, error::check_fields};

/// The training of networks that predict the next state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NetworkConfig {
    /// Ensemble members, each without one block of the log.
    pub members: usize,
    /// Units of each hidden layer.
    pub hidden_units: usize,
    /// Number of hidden layers.
    pub hidden_layers: usize,
    /// Step size of Adam.
    pub learning_rate: f64,
    /// Transitions per batch.
    pub batch: usize,
    /// Number of updates. After each of [`NetworkConfig::CHECKS`] parts of the updates, the network is tried on the member's left-out
    /// block. The best one is kept.
    pub updates: usize,
}

impl Default for NetworkConfig {
    fn default() -> Self {
        Self {
            members: 5,
            hidden_units: 64,
            hidden_layers: 2,
            learning_rate: 1e-3,
            batch: 64,
            updates: 10_000,
        }
    }
}

impl NetworkConfig {
    /// Number of times a network is tried on its left-out block.
    pub const CHECKS: usize = 20;

    /// Returns the number of weights and biases of a network, for a log of this many columns and actions.
    pub fn parameters(&self, columns: usize, actions: usize) -> usize {
        self.sizes(columns, actions).windows(2).map(|pair| (pair[0] + 1) * pair[1]).sum()
    }

    /// Returns the widths of the layers, from the inputs to the outputs.
    pub(super) fn sizes(&self, columns: usize, actions: usize) -> Vec<usize> {
        let hidden = vec![self.hidden_units; self.hidden_layers];
        [vec![columns + actions], hidden, vec![columns + 2]].concat()
    }

    pub(super) fn check(&self) -> Result<(), ControlError> {
        let rate = self.learning_rate;
        let checks = [
            ("members", self.members as f64, self.members > 1, "at least 2"),
            ("hidden_units", self.hidden_units as f64, self.hidden_units > 0, "at least 1"),
            ("learning_rate", rate, rate > 0.0 && rate.is_finite(), "a positive number"),
            ("batch", self.batch as f64, self.batch > 0, "at least 1"),
            ("updates", self.updates as f64, self.updates > 0, "at least 1"),
        ];
        check_fields(&checks)
    }
}
