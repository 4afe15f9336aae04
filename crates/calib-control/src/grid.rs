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

/// Calls a macro with the fields of the grid, in the order in which they are combined: the last one changes fastest.
macro_rules! with_fields {
    ($visit:ident) => {
        $visit! {
            algorithm step_size beta1 temperature epsilon initial_weight lambda tilings tiles pairs
            gamma hidden_width hidden_layers batch replay target_steps
        }
    };
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
        macro_rules! combine {
            ($($field:ident)*) => {
                $(
                    let (field, values) = (stringify!($field), self.$field.as_ref());
                    each(&mut all, field, values, |agent, value| agent.$field = value)?;
                )*
            };
        }
        with_fields!(combine);
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

    /// Returns the names of the swept fields, with the values that `agent` has in them.
    pub fn told(&self, agent: &AgentConfig) -> Vec<(&'static str, String)> {
        let mut swept = Vec::new();
        macro_rules! add {
            ($($field:ident)*) => {
                $(
                    if self.$field.is_some() {
                        swept.push((stringify!($field), agent.$field.to_string()));
                    }
                )*
            };
        }
        with_fields!(add);
        swept
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
