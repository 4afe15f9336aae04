use std::fmt::Debug;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{AgentConfig, Algorithm, ControlError};

/// The values to sweep of each field of the agent. An omitted field keeps the agent's value. The settings are all combinations.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Grid {
    /// Learning algorithms.
    pub algorithm: Option<Vec<Algorithm>>,
    /// Step sizes α.
    pub step_size: Option<Vec<f64>>,
    /// Adam's β₁.
    pub beta1: Option<Vec<f64>>,
    /// Temperatures of the softmax policy.
    pub temperature: Option<Vec<f64>>,
    /// Probabilities of a random action.
    pub epsilon: Option<Vec<f64>>,
    /// Initial weights.
    pub initial_weight: Option<Vec<f64>>,
    /// Decays λ of the traces.
    pub lambda: Option<Vec<f64>>,
    /// Numbers of tilings.
    pub tilings: Option<Vec<usize>>,
    /// Numbers of tiles of a column.
    pub tiles: Option<Vec<usize>>,
    /// With pairs of columns, without, or both.
    pub pairs: Option<Vec<bool>>,
    /// Discount factors γ.
    pub gamma: Option<Vec<f64>>,
    /// Units of each hidden layer.
    pub hidden_width: Option<Vec<usize>>,
    /// Numbers of hidden layers.
    pub hidden_layers: Option<Vec<usize>>,
    /// Transitions of a batch.
    pub batch: Option<Vec<usize>>,
    /// Capacities of the replay buffer.
    pub replay: Option<Vec<usize>>,
    /// Steps between updates of the target network.
    pub target_steps: Option<Vec<usize>>,
}

/// Replaces every setting that uses `field` by one setting per value.
fn each<T: Copy + PartialEq + Debug>(
    candidates: &mut Vec<AgentConfig>,
    field: &'static str,
    values: Option<&Vec<T>>,
    set: impl Fn(&mut AgentConfig, T),
) -> Result<(), ControlError> {
    let Some(values) = values else { return Ok(()) };
    if values.is_empty() {
        return Err(ControlError::EmptyAxis { field });
    }
    for (place, value) in values.iter().enumerate() {
        if values[..place].contains(value) {
            return Err(ControlError::RepeatedValue { field, value: format!("{value:?}") });
        }
    }
    if !candidates.iter().any(|candidate| candidate.algorithm.uses(field)) {
        let algorithm = candidates[0].algorithm.name();
        return Err(ControlError::UnusedAxis { field, algorithm });
    }
    let mut all = Vec::with_capacity(candidates.len() * values.len());
    for candidate in candidates.iter() {
        if !candidate.algorithm.uses(field) {
            all.push(*candidate);
            continue;
        }
        for &value in values {
            let mut one = *candidate;
            set(&mut one, value);
            all.push(one);
        }
    }
    *candidates = all;
    Ok(())
}

impl Grid {
    /// Returns the grid of the published protocol: three step sizes, two β₁, three temperatures and three initial weights, which are 54
    /// settings (Wang et al. 2022).
    pub fn published() -> Self {
        Self {
            step_size: Some(vec![0.003, 0.03, 0.3]),
            beta1: Some(vec![0.0, 0.9]),
            temperature: Some(vec![1.0, 10.0, 100.0]),
            initial_weight: Some(vec![0.0, 8.0, 16.0]),
            ..Self::default()
        }
    }

    /// Returns all combinations of the fields that an algorithm uses. The last field changes fastest. Every setting differs from `agent`
    /// only in swept fields.
    ///
    /// # Errors
    /// If a list is empty or has a value twice, no algorithm uses a field, or a value is not valid for its field.
    pub fn candidates(&self, agent: AgentConfig) -> Result<Vec<AgentConfig>, ControlError> {
        let mut all = vec![agent];
        each(&mut all, "algorithm", self.algorithm.as_ref(), |agent, value| {
            agent.algorithm = value;
        })?;
        each(&mut all, "step_size", self.step_size.as_ref(), |agent, value| {
            agent.step_size = value;
        })?;
        each(&mut all, "beta1", self.beta1.as_ref(), |agent, value| agent.beta1 = value)?;
        each(&mut all, "temperature", self.temperature.as_ref(), |agent, value| {
            agent.temperature = value;
        })?;
        each(&mut all, "epsilon", self.epsilon.as_ref(), |agent, value| agent.epsilon = value)?;
        each(&mut all, "initial_weight", self.initial_weight.as_ref(), |agent, value| {
            agent.initial_weight = value;
        })?;
        each(&mut all, "lambda", self.lambda.as_ref(), |agent, value| agent.lambda = value)?;
        each(&mut all, "tilings", self.tilings.as_ref(), |agent, value| agent.tilings = value)?;
        each(&mut all, "tiles", self.tiles.as_ref(), |agent, value| agent.tiles = value)?;
        each(&mut all, "pairs", self.pairs.as_ref(), |agent, value| agent.pairs = value)?;
        each(&mut all, "gamma", self.gamma.as_ref(), |agent, value| agent.gamma = value)?;
        self.networks(&mut all)?;
        let checked = all.iter().try_for_each(AgentConfig::check);
        checked.map_err(|error| self.with_key(error, &agent))?;
        Ok(all)
    }

    /// Names the field of an error by its key: that of the grid if the field is swept, or else that of the agent.
    fn with_key(&self, error: ControlError, agent: &AgentConfig) -> ControlError {
        let ControlError::Field { field, .. } = error else { return error };
        let is_swept = self.told(agent).iter().any(|(swept, _)| *swept == field);
        error.in_section(if is_swept { "grid" } else { "agent" })
    }

    /// Combines the fields of networks.
    fn networks(&self, all: &mut Vec<AgentConfig>) -> Result<(), ControlError> {
        each(all, "hidden_width", self.hidden_width.as_ref(), |agent, value| {
            agent.hidden_width = value;
        })?;
        each(all, "hidden_layers", self.hidden_layers.as_ref(), |agent, value| {
            agent.hidden_layers = value;
        })?;
        each(all, "batch", self.batch.as_ref(), |agent, value| agent.batch = value)?;
        each(all, "replay", self.replay.as_ref(), |agent, value| agent.replay = value)?;
        each(all, "target_steps", self.target_steps.as_ref(), |agent, value| {
            agent.target_steps = value;
        })
    }

    /// Returns the names of the swept fields, with the values that `agent` has in them.
    pub fn told(&self, agent: &AgentConfig) -> Vec<(&'static str, String)> {
        let algorithm = agent.algorithm;
        let all = [
            ("algorithm", self.algorithm.is_some(), algorithm.name().to_owned()),
            ("step_size", self.step_size.is_some(), agent.step_size.to_string()),
            ("beta1", self.beta1.is_some(), agent.beta1.to_string()),
            ("temperature", self.temperature.is_some(), agent.temperature.to_string()),
            ("epsilon", self.epsilon.is_some(), agent.epsilon.to_string()),
            ("initial_weight", self.initial_weight.is_some(), agent.initial_weight.to_string()),
            ("lambda", self.lambda.is_some(), agent.lambda.to_string()),
            ("tilings", self.tilings.is_some(), agent.tilings.to_string()),
            ("tiles", self.tiles.is_some(), agent.tiles.to_string()),
            ("pairs", self.pairs.is_some(), agent.pairs.to_string()),
            ("gamma", self.gamma.is_some(), agent.gamma.to_string()),
            ("hidden_width", self.hidden_width.is_some(), agent.hidden_width.to_string()),
            ("hidden_layers", self.hidden_layers.is_some(), agent.hidden_layers.to_string()),
            ("batch", self.batch.is_some(), agent.batch.to_string()),
            ("replay", self.replay.is_some(), agent.replay.to_string()),
            ("target_steps", self.target_steps.is_some(), agent.target_steps.to_string()),
        ];
        all.into_iter()
            .filter(|(_, is_swept, _)| *is_swept)
            .map(|(name, _, value)| (name, value))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_published_grid_has_54_candidates_which_all_differ() {
        let all = Grid::published().candidates(AgentConfig::default()).expect("valid");
        assert_eq!(all.len(), 54);
        for (number, one) in all.iter().enumerate() {
            assert!(!all[..number].contains(one));
        }
        let told = Grid::published().told(&all[1]);
        let names: Vec<_> = told.iter().map(|field| field.0).collect();
        assert_eq!(names, ["step_size", "beta1", "temperature", "initial_weight"]);
        assert_eq!(told[3].1, "8", "the last field changes fastest");
    }

    fn refused(grid: &Grid, agent: AgentConfig) -> String {
        grid.candidates(agent).expect_err("refused").to_string()
    }

    #[test]
    fn what_no_agent_uses_and_values_that_come_twice_are_refused() {
        let agent = AgentConfig::default();
        let unused = refused(&Grid { epsilon: Some(vec![0.1, 0.2]), ..Grid::default() }, agent);
        assert!(unused.contains("grid.epsilon") && unused.contains("expected_sarsa"), "{unused}");
        let unused = refused(&Grid { hidden_width: Some(vec![8]), ..Grid::default() }, agent);
        assert!(unused.contains("grid.hidden_width"), "{unused}");
        let twice =
            refused(&Grid { step_size: Some(vec![0.1, 0.2, 0.1]), ..Grid::default() }, agent);
        assert!(twice.contains("grid.step_size") && twice.contains("0.1 twice"), "{twice}");
        let twice = refused(&Grid { pairs: Some(vec![true, true]), ..Grid::default() }, agent);
        assert!(twice.contains("true twice"), "{twice}");
        // The values of a field apply only to the algorithms that use it.
        let mixed = Grid {
            algorithm: Some(vec![Algorithm::ExpectedSarsa, Algorithm::QLearning]),
            epsilon: Some(vec![0.1, 0.2]),
            ..Grid::default()
        };
        let all = mixed.candidates(agent).expect("one of them uses it");
        assert_eq!(all.len(), 3);
        assert_eq!(mixed.told(&all[2])[1], ("epsilon", "0.2".to_owned()));
    }

    #[test]
    fn empty_lists_and_impossible_values_are_refused() {
        let empty = Grid { epsilon: Some(vec![]), ..Grid::default() };
        let told = empty.candidates(AgentConfig::default()).expect_err("empty").to_string();
        assert!(told.contains("epsilon"), "{told}");
        let tiles = Grid { tiles: Some(vec![8, 0]), ..Grid::default() };
        let told = refused(&tiles, AgentConfig::default());
        assert_eq!(told, "`control.grid.tiles` is 0, expected from 1 to 64");
        // The batches of the grid are larger than the agent's replay buffer.
        let agent = AgentConfig {
            algorithm: Algorithm::DeepQLearning,
            replay: 100,
            ..AgentConfig::default()
        };
        let told = refused(&Grid { batch: Some(vec![32, 200]), ..Grid::default() }, agent);
        assert!(told.starts_with("`control.agent.replay` is 100, expected from batch"), "{told}");
        assert_eq!(Grid::default().candidates(AgentConfig::default()).expect("one").len(), 1);
    }
}
