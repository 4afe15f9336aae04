use calib_agent::truncation_horizon;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Length of the streams of a sweep.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Span {
    /// Number of steps of an agent.
    pub steps: usize,
    /// Number of states after these steps, at least one, so that the returns of the last steps are complete. Agents do not
    /// learn from them.
    pub tail: usize,
}

impl Span {
    /// Creates a span of `steps` steps whose returns are complete for all `gammas`.
    ///
    /// # Panics
    /// Panics as [`truncation_horizon`] does.
    pub fn new(steps: usize, gammas: impl IntoIterator<Item = f64>) -> Self {
        let horizons = gammas.into_iter().map(truncation_horizon);
        Self { steps, tail: horizons.max().unwrap_or(0).max(1) }
    }

    /// Returns the number of states of an unbroken stream.
    pub fn states(self) -> usize {
        self.steps + self.tail
    }

    /// Returns the number of steps of an agent in a stream with this many states, which may be shorter.
    pub fn steps_in(self, states: usize) -> usize {
        self.steps.min(states.saturating_sub(1))
    }
}

#[cfg(test)]
mod tests {
    use calib_agent::Part;

    use super::*;

    /// Returns the scored steps of a stream with this many states in one piece.
    fn scored_steps(span: Span, states: usize, gamma: f64) -> usize {
        Part::WholeRun.scored_steps(std::slice::from_ref(&(0..states)), gamma, span.steps)
    }

    #[test]
    fn every_step_can_be_scored() {
        for gammas in [[0.0, 0.0], [0.5, 0.0], [0.9, 0.99]] {
            let span = Span::new(100, gammas);
            let states = span.states();
            assert_eq!(gammas.map(|gamma| scored_steps(span, states, gamma)), [100, 100]);
            assert!(gammas.map(|gamma| scored_steps(span, states - 1, gamma)).contains(&99));
        }
    }
}
