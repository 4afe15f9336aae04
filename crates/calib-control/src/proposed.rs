//! Which settings to try at a plant of which nothing is known but its log.

/// Step sizes to sweep: those of the published grid (Wang et al. 2022).
const STEP_SIZES: [f64; 3] = [0.003, 0.03, 0.3];
/// Temperatures to sweep, in spreads of recorded returns. With the least, an agent nearly always takes the better of two actions that
/// differ by a twentieth of a spread. With the largest, it takes one that is better by a spread in three of four steps. Our choice.
const TEMPERATURES: [f64; 3] = [0.01, 0.1, 1.0];
/// The default among them.
const TEMPERATURE: f64 = TEMPERATURES[1];
/// Initial weights to sweep, in spreads of recorded returns: none, and enough to try what was not done yet. Our choice.
const INITIAL_WEIGHTS: [f64; 2] = [0.0, 1.0];
/// Agents with a temperature of more spreads choose nearly at random. Our choice.
const MOST_TEMPERATURE: f64 = 1.0;
/// Agents with initial weights of more spreads spend their run on unlearning them. Our choice.
const MOST_INITIAL_WEIGHT: f64 = 100.0;
/// Columns of the states above which agents go without pairs of columns: most of their time would go into these. Our choice.
pub const PAIRED_COLUMNS: usize = 32;

/// Settings of agents that act, in units of the spread of recorded returns
/// ([`Decisions::return_spread`](crate::Decisions::return_spread)), each to two significant digits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProposedSettings {
    /// The default temperature, one of `temperatures`.
    pub temperature: f64,
    /// Step sizes to sweep.
    pub step_sizes: [f64; 3],
    /// Temperatures to sweep, in units of reward.
    pub temperatures: [f64; 3],
    /// Initial weights to sweep, in units of reward.
    pub initial_weights: [f64; 2],
}

impl ProposedSettings {
    /// Those for recorded returns with this standard deviation, a positive number in units of reward.
    pub fn for_spread(spread: f64) -> Self {
        Self {
            temperature: two_digits(TEMPERATURE * spread),
            step_sizes: STEP_SIZES,
            temperatures: TEMPERATURES.map(|share| two_digits(share * spread)),
            initial_weights: INITIAL_WEIGHTS.map(|share| two_digits(share * spread)),
        }
    }

    /// The number of settings.
    pub fn count(&self) -> usize {
        self.step_sizes.len() * self.temperatures.len() * self.initial_weights.len()
    }
}

/// Whether agents with this temperature choose nearly at random where recorded returns have this spread.
pub fn is_random(temperature: f64, spread: f64) -> bool {
    temperature > MOST_TEMPERATURE * spread
}

/// Whether agents that begin with this weight hardly learn what is worth less where recorded returns have this spread.
pub fn is_beyond_returns(initial_weight: f64, spread: f64) -> bool {
    initial_weight.abs() > MOST_INITIAL_WEIGHT * spread
}

/// To two significant digits: what follows from a log is known no better.
pub fn two_digits(value: f64) -> f64 {
    format!("{value:.1e}").parse().unwrap_or(value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{AgentConfig, Grid};

    #[test]
    fn settings_are_in_units_of_the_spread() {
        let settings = ProposedSettings::for_spread(12.34);
        assert_eq!(settings.temperatures, [0.12, 1.2, 12.0]);
        assert_eq!(settings.initial_weights, [0.0, 12.0]);
        assert_eq!(settings.temperature, 1.2);
        assert_eq!(ProposedSettings::for_spread(0.001).temperatures, [1e-5, 1e-4, 1e-3]);
    }

    #[test]
    fn the_default_is_one_of_the_settings() {
        for spread in [1e-6, 0.37, 9.99, 4_321.0] {
            let settings = ProposedSettings::for_spread(spread);
            let grid = Grid {
                step_size: Some(settings.step_sizes.to_vec()),
                temperature: Some(settings.temperatures.to_vec()),
                initial_weight: Some(settings.initial_weights.to_vec()),
                ..Grid::default()
            };
            let agent = AgentConfig { temperature: settings.temperature, ..AgentConfig::default() };
            let candidates = grid.candidates(agent).expect("all differ");
            assert_eq!(candidates.len(), settings.count());
            assert!(candidates.contains(&agent), "spread {spread}: {settings:?}");
        }
    }

    #[test]
    fn numbers_are_too_large_by_the_spread() {
        assert!(is_random(10.0, 5.0) && !is_random(5.0, 5.0));
        assert!(is_beyond_returns(-501.0, 5.0) && !is_beyond_returns(16.0, 5.0));
    }
}
