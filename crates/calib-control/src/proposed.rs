//! Proposes settings for a plant of which only a log is known.

use crate::{AgentConfig, Algorithm};

/// Changes of a value per step, in spreads of recorded returns. Adam moves each weight of a value by about its step size, however large
/// rewards are, so step sizes have the unit of returns. The second one is the default of docs/control.md, "Tasks that are drawn", at four
/// columns.
const STEPS_OF_VALUES: [f64; 3] = [0.003, 0.03, 0.3];
/// Step sizes of a network to sweep: Adam's usual one (Kingma & Ba 2015), a tenth of it and ten times as much. Weights of a network are
/// not values, and those of its hidden layers have the same size whatever the rewards are. So its step sizes have no unit.
const NETWORK_STEP_SIZES: [f64; 3] = [0.0001, 0.001, 0.01];
/// Temperatures to sweep, in spreads of recorded returns. With the lowest, an agent nearly always takes the better of two actions that
/// differ by a twentieth of a spread. With the highest, it takes an action that is better by a spread in three of four steps. Our choice.
const TEMPERATURES: [f64; 3] = [0.01, 0.1, 1.0];
/// First values to sweep, in spreads of recorded returns: zero, and a value that makes the agent try new actions. Our choice.
const FIRST_VALUES: [f64; 2] = [0.0, 5.0];
/// Position of the default among step sizes and temperatures.
const DEFAULT: usize = 1;
/// With a higher temperature, in spreads, agents choose nearly at random. Our choice.
const MOST_TEMPERATURE: f64 = 1.0;
/// With larger first values, in spreads, agents spend their run on unlearning them. Our choice.
const MOST_FIRST_VALUE: f64 = 100.0;
/// With a lower temperature, in spreads, agents nearly always take the action with the highest value. It is a fifth of the lowest
/// one that is proposed, and above all proposed ones after rewards have become a thousand times as large. Our choice.
const LEAST_TEMPERATURE: f64 = 1.0 / 500.0;
/// With smaller changes of a value per step, in spreads, agents hardly learn. It is a seventh of the smallest one that is proposed, and
/// above all proposed ones after rewards have become a thousand times as large. The largest one of the published grid is 0.0007 in a log
/// of random actions in the puddle world, whose returns have the largest spread. Our choice.
const LEAST_STEP_OF_VALUE: f64 = 1.0 / 2_500.0;
/// With more columns in the states, the proposed agents have no pairs of columns: pairs would take most of their time. Our choice.
pub const PAIRED_COLUMNS: usize = 32;

/// Proposed settings of agents that act, by the spread of recorded returns
/// ([`Decisions::return_spread`](crate::Decisions::return_spread)), each to two significant digits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProposedSettings {
    /// The default step size, one of `step_sizes`.
    pub step_size: f64,
    /// The default temperature, one of `temperatures`.
    pub temperature: f64,
    /// Step sizes to sweep, in units of reward. Those of a network have no unit.
    pub step_sizes: [f64; 3],
    /// Temperatures to sweep, in units of reward.
    pub temperatures: [f64; 3],
    /// Initial weights to sweep, in units of reward, for a first value of 0 and for one of several spreads.
    pub initial_weights: [f64; 2],
}

impl ProposedSettings {
    /// Returns the settings for recorded returns with this standard deviation, a positive number in units of reward. The agents have
    /// the algorithm and the pairs of `agent`, in states of `columns` columns, at least 1.
    pub fn for_spread(spread: f64, agent: &AgentConfig, columns: usize) -> Self {
        let weights = agent.initial_weights_in_value(columns);
        let step_sizes = if agent.algorithm == Algorithm::DeepQLearning {
            NETWORK_STEP_SIZES
        } else {
            STEPS_OF_VALUES.map(|share| two_digits(share / weights * spread))
        };
        let temperatures = TEMPERATURES.map(|share| two_digits(share * spread));
        Self {
            step_size: step_sizes[DEFAULT],
            temperature: temperatures[DEFAULT],
            step_sizes,
            temperatures,
            initial_weights: FIRST_VALUES.map(|share| two_digits(share / weights * spread)),
        }
    }
}

/// Returns whether agents with this temperature choose nearly at random if recorded returns have this spread.
pub fn is_random(temperature: f64, spread: f64) -> bool {
    temperature > MOST_TEMPERATURE * spread
}

/// Returns whether agents with this first value ([`AgentConfig::first_value`]) hardly learn lower values if recorded returns have this
/// spread.
pub fn is_beyond_returns(first_value: f64, spread: f64) -> bool {
    first_value.abs() > MOST_FIRST_VALUE * spread
}

/// Returns whether agents with this temperature nearly always take the action with the highest value if recorded returns have this spread.
pub fn is_nearly_greedy(temperature: f64, spread: f64) -> bool {
    temperature < LEAST_TEMPERATURE * spread
}

/// Returns whether agents whose values change by this much per step ([`AgentConfig::step_of_value`]) hardly learn if recorded returns have
/// this spread.
pub fn is_below_returns(step_of_value: f64, spread: f64) -> bool {
    step_of_value < LEAST_STEP_OF_VALUE * spread
}

/// Rounds to two significant digits. A log does not give these numbers more precisely.
pub fn two_digits(value: f64) -> f64 {
    calib_core::rounded(value, 2)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Grid;

    /// Returns settings for agents whose first value has the initial weights of four columns and six pairs.
    fn proposed(spread: f64) -> ProposedSettings {
        ProposedSettings::for_spread(spread, &AgentConfig::default(), 4)
    }

    #[test]
    fn settings_are_in_units_of_the_spread() {
        let settings = proposed(12.34);
        assert_eq!(settings.step_sizes, [0.0037, 0.037, 0.37]);
        assert_eq!(settings.temperatures, [0.12, 1.2, 12.0]);
        assert_eq!((settings.step_size, settings.temperature), (0.037, 1.2));
        assert_eq!(proposed(0.001).temperatures, [1e-5, 1e-4, 1e-3]);
    }

    #[test]
    fn first_values_are_five_spreads_whatever_is_tiled() {
        let agent = AgentConfig::default();
        for (agent, columns) in [
            (agent, 1),
            (agent, 4),
            (agent, 32),
            (AgentConfig { pairs: false, ..agent }, 141),
            (AgentConfig { algorithm: Algorithm::DeepQLearning, ..agent }, 141),
        ] {
            let settings = ProposedSettings::for_spread(12.34, &agent, columns);
            let values = settings
                .initial_weights
                .map(|initial_weight| AgentConfig { initial_weight, ..agent }.first_value(columns));
            assert_eq!(values[0], 0.0);
            assert!((values[1] / (5.0 * 12.34) - 1.0).abs() < 0.05, "{agent:?}: {values:?}");
        }
    }

    #[test]
    fn step_sizes_of_a_network_have_no_unit() {
        let agent = AgentConfig { algorithm: Algorithm::DeepQLearning, ..AgentConfig::default() };
        let [small, large] =
            [0.01, 1e6].map(|spread| ProposedSettings::for_spread(spread, &agent, 4).step_sizes);
        assert_eq!(small, large);
    }

    #[test]
    fn the_default_is_one_of_the_settings() {
        for spread in [1e-6, 0.37, 9.99, 4_321.0] {
            let settings = proposed(spread);
            let grid = Grid {
                step_size: Some(settings.step_sizes.to_vec()),
                temperature: Some(settings.temperatures.to_vec()),
                initial_weight: Some(settings.initial_weights.to_vec()),
                ..Grid::default()
            };
            let agent = AgentConfig {
                step_size: settings.step_size,
                temperature: settings.temperature,
                ..AgentConfig::default()
            };
            let candidates = grid.candidates(agent).expect("all differ");
            assert_eq!(candidates.len(), 18);
            assert!(candidates.contains(&agent), "spread {spread}: {settings:?}");
        }
    }

    #[test]
    fn numbers_are_too_large_by_the_spread() {
        assert!(is_random(10.0, 5.0) && !is_random(5.0, 5.0));
        assert!(is_beyond_returns(-501.0, 5.0) && !is_beyond_returns(16.0, 5.0));
    }

    /// Even the smallest proposed ones are not. After rewards a thousand times as large, even the largest are.
    #[test]
    fn numbers_are_too_small_by_the_spread() {
        for spread in [0.001_04, 9.99, 4_321.0] {
            for (columns, pairs) in [(1, true), (4, true), (141, false)] {
                let agent = AgentConfig { pairs, ..AgentConfig::default() };
                let settings = ProposedSettings::for_spread(spread, &agent, columns);
                let steps = settings
                    .step_sizes
                    .map(|step_size| AgentConfig { step_size, ..agent }.step_of_value(columns));
                let temperatures = settings.temperatures;
                assert!(!is_below_returns(steps[0], spread), "{settings:?}");
                assert!(is_below_returns(steps[2], 1_000.0 * spread), "{settings:?}");
                assert!(!is_nearly_greedy(temperatures[0], spread), "{settings:?}");
                assert!(is_nearly_greedy(temperatures[2], 1_000.0 * spread), "{settings:?}");
            }
        }
    }
}
