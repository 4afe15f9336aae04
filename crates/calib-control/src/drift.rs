//! Measures how far jumps move rollouts: from their state to the sources of other transitions.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Displacement of episodes by jumps. For each column and episode it is the sum over steps of the difference between the source of the
/// sampled transition and the state of the rollout.
///
/// Each jump may be small, and together they may still undo the actions of the agent. For example, an actuator is moved by increments and
/// was never recorded beyond some level. A rollout that is moved back a little in every step stays below that level for ever, although
/// every step is covered.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Drift {
    /// Number of episodes.
    pub episodes: u64,
    /// Sum over episodes of the displacement of each column, in units of the states.
    pub sums: Vec<f64>,
    /// Sum over episodes of the squared displacement of each column.
    pub squares: Vec<f64>,
}

impl Drift {
    /// Counts an episode.
    pub(crate) fn count(&mut self, displacement: &[f32]) {
        self.sums.resize(displacement.len(), 0.0);
        self.squares.resize(displacement.len(), 0.0);
        self.episodes += 1;
        let sums = self.sums.iter_mut().zip(&mut self.squares);
        for ((sum, squares), &displacement) in sums.zip(displacement) {
            let displacement = f64::from(displacement);
            *sum += displacement;
            *squares += displacement * displacement;
        }
    }

    /// Returns the sum of both.
    #[must_use]
    pub fn and(mut self, other: &Self) -> Self {
        let columns = self.sums.len().max(other.sums.len());
        self.sums.resize(columns, 0.0);
        self.squares.resize(columns, 0.0);
        self.episodes += other.episodes;
        self.sums.iter_mut().zip(&other.sums).for_each(|(own, other)| *own += other);
        self.squares.iter_mut().zip(&other.squares).for_each(|(own, other)| *own += other);
        self
    }

    /// Returns the mean displacement per episode of each column, and its standard error. The list is empty for fewer than two episodes.
    pub fn means(&self) -> Vec<[f64; 2]> {
        if self.episodes < 2 {
            return Vec::new();
        }
        let count = self.episodes as f64;
        self.sums
            .iter()
            .zip(&self.squares)
            .map(|(sum, squares)| {
                let mean = sum / count;
                let variance = ((squares - sum * mean) / (count - 1.0)).max(0.0);
                [mean, (variance / count).sqrt()]
            })
            .collect()
    }
}
