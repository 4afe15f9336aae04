//! Agents as named arrays, so that they can be stored and restored.

use calib_core::Seed;
use calib_files::Tensors;

use super::{Agent, AgentConfig, Algorithm, Learner, Network};
use crate::ControlError;

impl Agent {
    /// Returns the learned arrays. Tiles: `weights`, and Adam's `mean` and `square`, `[actions, features]`. Networks:
    /// `online.layers.0.weight` and so on in the layout of PyTorch, the same for `target`, and Adam's `mean` and `square`. Traces and
    /// replayed transitions are not stored.
    pub fn to_tensors(&self) -> Tensors {
        match &self.learner {
            Learner::Linear(linear) => linear.to_tensors(self.actions),
            Learner::Network(network) => network.to_tensors(),
        }
    }

    /// Returns the agent that [`to_tensors`](Self::to_tensors) stored, at the beginning of an episode. `seed` determines its further draws.
    ///
    /// # Errors
    /// If the tensors are not those of such an agent, or the settings are not valid.
    pub fn from_tensors(
        config: AgentConfig,
        columns: usize,
        actions: usize,
        seed: Seed,
        tensors: &Tensors,
    ) -> Result<Self, ControlError> {
        config.check()?;
        config.bytes(columns, actions)?;
        // This comes before the allocation of arrays, whose size the settings describe.
        if !has_size_of(&config, columns, actions, tensors) {
            let reason = "its settings describe another size than its numbers have".to_owned();
            return Err(ControlError::NoAgent { reason });
        }
        let mut agent = Self::seeded(config, columns, actions, seed);
        match &mut agent.learner {
            Learner::Linear(linear) => linear.restore(tensors)?,
            Learner::Network(network) => network.restore(tensors)?,
        }
        Ok(agent)
    }
}

/// Returns whether the moments have one number per weight that the settings describe.
fn has_size_of(config: &AgentConfig, columns: usize, actions: usize, tensors: &Tensors) -> bool {
    let weights = if config.algorithm == Algorithm::DeepQLearning {
        Network::parameters(config, columns, actions)
    } else {
        config.tiling(columns).len() * actions
    };
    tensors.get("mean").is_some_and(|mean| mean.values.len() == weights)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Ending, Outcome};

    /// Takes steps of a made-up episode, and returns the agent's actions.
    fn after(agent: &mut Agent, steps: usize, seed: Seed) -> Vec<usize> {
        let mut rng = seed.rng();
        agent.look(&[0.5, 0.5]);
        (0..steps)
            .map(|step: usize| -> usize {
                let action = agent.act(&mut rng).expect("finite");
                let next = [rng.unit() as f32, rng.unit() as f32];
                let ending = if step % 7 == 6 { Ending::Terminal } else { Ending::Continues };
                let reward = f64::from(next[0]) - action as f64 / 3.0;
                agent.learn(action, Outcome { reward, ending }, &next);
                if ending == Ending::Terminal {
                    agent.look(&next);
                }
                action
            })
            .collect()
    }

    #[test]
    fn what_is_stored_goes_on() {
        for algorithm in [Algorithm::ExpectedSarsa, Algorithm::QLearning, Algorithm::DeepQLearning]
        {
            let config = AgentConfig {
                algorithm,
                tilings: 4,
                hidden_width: 8,
                batch: 4,
                beta1: 0.9,
                temperature: 0.5,
                target_steps: 5,
                ..AgentConfig::default()
            };
            let mut agent = Agent::new(config, 2, 3);
            after(&mut agent, 35, Seed::new(1));
            let stored = agent.to_tensors();
            let mut again =
                Agent::from_tensors(config, 2, 3, Seed::new(0), &stored).expect("its own");
            assert_eq!(again.to_tensors(), stored);
            let before = agent.values().to_vec();
            let values = agent.values_in(&[0.2, 0.9]);
            assert_eq!(agent.values(), before, "it stays where it is");
            agent.look(&[0.2, 0.9]);
            again.look(&[0.2, 0.9]);
            assert_eq!(again.values(), agent.values());
            assert_eq!(again.values(), values);
            // Replayed transitions are not stored, so only tiles learn the same from here on.
            if algorithm != Algorithm::DeepQLearning {
                let seed = Seed::new(2);
                assert_eq!(after(&mut again, 30, seed), after(&mut agent, 30, seed));
                assert_eq!(again.to_tensors(), agent.to_tensors());
            }
            let other = AgentConfig { tilings: 5, hidden_width: 9, ..config };
            assert!(Agent::from_tensors(other, 2, 3, Seed::new(0), &stored).is_err());
            assert!(Agent::from_tensors(config, 2, 3, Seed::new(0), &Tensors::default()).is_err());
        }
    }
}
