//! The memory that an agent takes.

use super::{AgentConfig, Algorithm, network::Network, weights::Weights};
use crate::ControlError;

impl AgentConfig {
    /// Returns the memory of an agent for states of this many columns, in bytes. It covers weights with their moments, or
    /// networks and their replay buffer.
    ///
    /// # Errors
    /// If tile coding has more features than can be numbered, 2³² − 1.
    pub fn bytes(&self, columns: usize, actions: usize) -> Result<u64, ControlError> {
        if self.algorithm == Algorithm::DeepQLearning {
            return Ok(Network::bytes(self, columns, actions));
        }
        let weights = self.tiling(columns).len() as u128 * actions as u128;
        if weights > u128::from(u32::MAX) {
            return Err(ControlError::ManyFeatures { columns, weights });
        }
        Ok(Weights::bytes(weights as usize))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the memory of an agent for states of four columns and three actions.
    fn bytes_of(config: AgentConfig) -> u64 {
        config.bytes(4, 3).expect("few")
    }

    #[test]
    fn memory_follows_from_what_is_tiled() {
        let tiles = AgentConfig::default();
        // 16 tilings with 9 tiles per column and 81 per pair. Each weight has a value, two moments and the place of its trace.
        assert_eq!(bytes_of(tiles), 3 * 16 * (4 * 9 + 6 * 81) * 16);
        assert_eq!(bytes_of(AgentConfig { pairs: false, ..tiles }), 3 * 16 * 4 * 9 * 16);
        let network = AgentConfig { algorithm: Algorithm::DeepQLearning, ..tiles };
        let replayed = network.replay as u64 * ((2 * 4 + 1) * 4 + 24);
        assert!(
            (replayed..replayed + 200_000).contains(&bytes_of(network)),
            "{}",
            bytes_of(network)
        );
    }

    #[test]
    fn features_beyond_all_numbers_are_refused() {
        let tiles = AgentConfig::default();
        let told = tiles.bytes(5_000, 1).expect_err("16 billion pairs").to_string();
        assert!(
            told.contains("states of 5000 columns") && told.contains("pairs = false"),
            "{told}"
        );
        assert!(AgentConfig { pairs: false, ..tiles }.bytes(5_000, 1).is_ok());
    }
}
