//! Fitted Q evaluation: estimates the value of a policy from a log, without a model. It is a baseline.

use calib_core::{States, TransitionIndex};

use crate::{Decisions, Ending, agent::Tiles};

/// Tilings, tiles and step size of the fitted values. There are fewer tilings than agents have, to save time.
const TILINGS: usize = 4;
const TILES: usize = 8;
const STEP: f64 = 0.3;
/// States with more columns have tiles of single columns only: pairs would be hundreds of times as many.
const PAIRED_COLUMNS: usize = 16;
/// Number of passes over the log.
const PASSES: usize = 20;

/// Values q̂ of a policy π, fitted to a log.
///
/// Fitted Q evaluation (Le, Voloshin & Yue 2019). Its values are linear in a separate tile coding, with pairs of columns where there are at
/// most 16 columns. It makes 20 passes over the log, last transition first, with q̂(s, a) ← q̂(s, a) + 0.3 · (r + γ Σ π(a' | s') q̂(s', a')
/// − q̂(s, a)). The target is cut to the possible returns of an episode of `timeout` steps.
#[derive(Clone, Debug)]
pub(crate) struct FittedQ {
    tiles: Tiles,
    actions: usize,
    /// Shape `[actions, features]`.
    weights: Vec<f64>,
}

/// Fitted values of one recorded step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct StepValues {
    /// q̂(s, a) of the recorded action.
    pub(crate) taken: f64,
    /// v̂(s) = Σ π(a | s) q̂(s, a).
    pub(crate) expected: f64,
}

impl FittedQ {
    /// Fits the values of a policy to `log`. `after` has its probabilities in the next states of the transitions, `[transitions, actions]`.
    pub(crate) fn fit(log: &Decisions, after: &[f64], gamma: f64, timeout: usize) -> Self {
        let states = log.states();
        let source = |number: usize| log.transitions().source(TransitionIndex::new(number)).get();
        let next = |number: usize| log.transitions().next(TransitionIndex::new(number)).get();
        // Every pass computes the features again: those of all rows of a long log would take more memory than the log.
        let mut tiles = Self::tiles(states.columns());
        let mut here = Vec::new();
        let mut ahead = Vec::new();
        let mut row_here = None;
        let actions = log.levels();
        let length = tiles.len();
        let mut weights = vec![0.0_f64; actions * length];
        let rewards = log.rewards().iter().copied().map(f64::from);
        let extreme = |reward: f64, other: f64| (timeout as f64 * reward).min(other.min(reward));
        let lowest = extreme(rewards.clone().fold(f64::INFINITY, f64::min), 0.0);
        let highest = -extreme(rewards.map(|reward| -reward).fold(f64::INFINITY, f64::min), 0.0);
        let step = STEP / tiles.active() as f64;
        for _ in 0..PASSES {
            for number in (0..log.len()).rev() {
                let mut target = f64::from(log.rewards()[number]);
                if log.endings()[number] == Ending::Continues {
                    let policy = &after[number * actions..][..actions];
                    // In reverse order the next row is mostly the row of the previous step, whose features are in `here`.
                    if row_here == Some(next(number)) {
                        std::mem::swap(&mut here, &mut ahead);
                    } else {
                        tiles.put_features(states.row(next(number)), &mut ahead);
                    }
                    target += gamma * expected(&weights, policy, &ahead);
                }
                let own = &mut weights[usize::from(log.actions()[number]) * length..][..length];
                tiles.put_features(states.row(source(number)), &mut here);
                row_here = Some(source(number));
                let change = step * (target.clamp(lowest, highest) - sum(own, &here));
                for &feature in &here {
                    own[feature as usize] += change;
                }
            }
        }
        Self { tiles, actions, weights }
    }

    /// Returns the memory of the values for states of this many columns, in bytes.
    pub(crate) fn bytes(columns: usize, actions: usize) -> u64 {
        (Self::tiles(columns).len() * actions * size_of::<f64>()) as u64
    }

    fn tiles(columns: usize) -> Tiles {
        Tiles::new(TILINGS, TILES, columns, columns <= PAIRED_COLUMNS)
    }

    /// Returns the mean of v̂ over `states`. `policies` has the policy's probabilities there, `[states, actions]`.
    pub(crate) fn mean_over(&mut self, states: &States, policies: &[f64]) -> f64 {
        let mut features = Vec::new();
        let mut value = 0.0;
        for (row, policy) in policies.chunks(self.actions).enumerate() {
            self.tiles.put_features(states.row(row), &mut features);
            value += expected(&self.weights, policy, &features);
        }
        value / states.rows() as f64
    }

    /// Returns the values at each step of `log`. `policies` has the policy's probabilities there, `[transitions, actions]`.
    pub(crate) fn at_steps(&mut self, log: &Decisions, policies: &[f64]) -> Vec<StepValues> {
        let length = self.tiles.len();
        let mut features = Vec::new();
        let mut values = Vec::with_capacity(log.len());
        for (number, policy) in policies.chunks(self.actions).enumerate() {
            let [state, _] = log.ends(TransitionIndex::new(number));
            self.tiles.put_features(state, &mut features);
            let taken = usize::from(log.actions()[number]);
            values.push(StepValues {
                taken: sum(&self.weights[taken * length..][..length], &features),
                expected: expected(&self.weights, policy, &features),
            });
        }
        values
    }
}

/// Returns q̂ at `features` for the action with the weights `own`.
fn sum(own: &[f64], features: &[u32]) -> f64 {
    features.iter().map(|&feature| own[feature as usize]).sum()
}

/// Returns Σ π(a) q̂(a) at `features`.
fn expected(weights: &[f64], policy: &[f64], features: &[u32]) -> f64 {
    let length = weights.len() / policy.len();
    policy
        .iter()
        .enumerate()
        .map(|(action, probability)| {
            probability * sum(&weights[action * length..][..length], features)
        })
        .sum()
}

#[cfg(test)]
pub(crate) mod tests {
    use calib_core::{Seed, Segments, Silent};

    use super::*;
    use crate::{AgentConfig, Columns, off_policy_values};

    /// Returns a log of random moves in a corridor of ten places, with −1 per step. Right of the last place is the end.
    pub(crate) fn corridor() -> Decisions {
        let mut rng = Seed::new(1).rng();
        let mut states = Vec::new();
        let mut actions = Vec::new();
        let mut endings = Vec::new();
        let mut lengths = Vec::new();
        while states.len() < 6000 {
            let mut place = rng.below(10) as i32;
            let mut length = 1;
            while place < 10 {
                let action = rng.below(2);
                states.push(place as f32 / 10.0);
                actions.push(Some(action as u16));
                endings.push(Ending::Continues);
                place = (place + if action == 1 { 1 } else { -1 }).max(0);
                length += 1;
            }
            states.push(1.0);
            actions.push(None);
            endings.push(Ending::Terminal);
            lengths.push(length);
        }
        let rows = states.len();
        let columns = Columns { actions: &actions, rewards: &vec![-1.0; rows], endings: &endings };
        let states = States::new(states, rows, 1).expect("valid");
        Decisions::new(states, &Segments::from_lengths(lengths).expect("valid"), columns, 2)
            .expect("a log")
    }

    #[test]
    fn the_better_policy_has_the_higher_value() {
        let log = corridor();
        let starts = States::new(vec![0.5], 1, 1).expect("valid");
        // One policy learns to go right, which takes five steps. The other cannot tell left from right.
        let sharp = AgentConfig { temperature: 0.1, gamma: 0.95, ..AgentConfig::default() };
        let dull = AgentConfig { temperature: 1e6, ..sharp };
        let found =
            off_policy_values(&log, &starts, &[sharp, dull], 20_000, 100, &Silent).expect("run");
        let values = found.fitted_q;
        assert_eq!((found.importance, found.doubly_robust), (None, None), "no probabilities");
        let five_steps = -(1.0 - 0.95_f64.powi(5)) / 0.05;
        assert!((values[0] - five_steps).abs() < 1.0, "{values:?}, not {five_steps}");
        assert!(values[1] < values[0] - 4.0, "{values:?}");
    }
}
