//! Fitted Q evaluation: estimates the value of a policy from a log, without a model. It is a baseline.

use calib_core::{Cancelled, Monitor, States, TransitionIndex};

use crate::{Decisions, Ending, agent::Tiles};

/// Tilings, tiles and step size of the fitted values. There are fewer tilings than agents have, to save time.
const TILINGS: usize = 4;
const TILES: usize = 8;
const STEP: f64 = 0.3;
/// States with more columns have tiles of single columns only: pairs would be hundreds of times as many.
const PAIRED_COLUMNS: usize = 16;
/// Passes over the log after which values are compared with those at the check before, half as many passes ago. One pass changes little
/// even where values drift for hundreds of passes. The last check is our choice: on random logs of 3,000 transitions of four classic tasks,
/// few values settle later, and those of sharp policies drift away for a thousand passes.
const CHECKS: [usize; 5] = [10, 20, 40, 80, 160];
/// Largest change between two checks of values that have converged, as a share of their spread. Our choice: on the log of the cart-pole,
/// the values of random actions never change by less than 5 %.
const MOST_CHANGE: f64 = 0.1;
/// Smallest spread of values, as a share of their root mean square. Equal values differ only by rounding.
const LEAST_SPREAD: f64 = 1e-3;

/// Values q̂ of a policy π, fitted to a log.
///
/// Fitted Q evaluation (Le, Voloshin & Yue 2019). Its values are linear in a separate tile coding, with pairs of columns where there are at
/// most 16 columns. It makes passes over the log, last transition first, with q̂(s, a) ← q̂(s, a) + 0.3 · (r + γ Σ π(a' | s') q̂(s', a')
/// − q̂(s, a)). The target is cut to the possible returns of an episode of `timeout` steps. The passes end when the values have converged:
/// between passes n/2 and n, the root mean square of their changes over the recorded steps is at most a tenth of their standard deviation.
/// They end after 160 passes in any case. Values that are linear in features need not converge for a policy other than the recorded one
/// (Baird 1995).
#[derive(Clone, Debug)]
pub(crate) struct FittedQ {
    tiles: Tiles,
    actions: usize,
    /// Shape `[actions, features]`.
    weights: Vec<f64>,
    /// Number of passes that were made.
    passes: usize,
    has_converged: bool,
}

/// Fitted values of one recorded step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct StepValues {
    /// q̂(s, a) of the recorded action.
    pub(crate) taken: f64,
    /// v̂(s) = Σ π(a | s) q̂(s, a).
    pub(crate) expected: f64,
}

/// The targets of the fitted values.
struct Targets<'a> {
    /// The policy's probabilities in the next states of the transitions, `[transitions, actions]`.
    after: &'a [f64],
    gamma: f64,
    /// Lowest and highest possible return of an episode.
    lowest: f64,
    highest: f64,
}

impl<'a> Targets<'a> {
    fn new(log: &Decisions, after: &'a [f64], gamma: f64, timeout: usize) -> Self {
        let [least, largest] = log.reward_range();
        let lowest = lowest_return(least, timeout);
        let highest = -lowest_return(-largest, timeout);
        Self { after, gamma, lowest, highest }
    }
}

/// Returns the lowest return of an episode of up to `timeout` steps, if `reward` is the lowest reward.
fn lowest_return(reward: f64, timeout: usize) -> f64 {
    (timeout as f64 * reward).min(reward.min(0.0))
}

/// The change of the values at the recorded steps from one check to the next.
#[derive(Clone, Copy, Debug, Default)]
struct Change {
    steps: usize,
    /// Sum of the values, and sum of their squares.
    sum: f64,
    squares: f64,
    /// Sum of the squared changes.
    changes: f64,
}

impl Change {
    fn add(&mut self, before: f64, value: f64) {
        self.steps += 1;
        self.sum += value;
        self.squares += value * value;
        self.changes += (value - before) * (value - before);
    }

    fn is_finite(&self) -> bool {
        self.squares.is_finite() && self.changes.is_finite()
    }

    /// Whether the values have converged.
    fn is_small(&self) -> bool {
        let steps = self.steps as f64;
        let mean_square = self.squares / steps;
        let deviation = (mean_square - (self.sum / steps).powi(2)).max(0.0).sqrt();
        let spread = deviation.max(LEAST_SPREAD * mean_square.sqrt());
        (self.changes / steps).sqrt() <= MOST_CHANGE * spread
    }
}

impl FittedQ {
    /// Largest number of passes over the log.
    pub(crate) const MOST_PASSES: usize = CHECKS[CHECKS.len() - 1];

    /// Fits the values of a policy to `log`. `after` has its probabilities in the next states of the transitions, `[transitions, actions]`.
    ///
    /// # Errors
    /// If the monitor interrupts.
    pub(crate) fn fit(
        log: &Decisions,
        after: &[f64],
        gamma: f64,
        timeout: usize,
        monitor: &dyn Monitor,
    ) -> Result<Self, Cancelled> {
        let targets = Targets::new(log, after, gamma, timeout);
        let tiles = Self::tiles(log.states().columns());
        let actions = log.levels();
        let weights = vec![0.0; actions * tiles.len()];
        let mut fitted = Self { tiles, actions, weights, passes: 0, has_converged: false };
        // The values at the check before.
        let mut before = vec![0.0; log.len()];
        for check in CHECKS {
            let mut change = Change::default();
            while fitted.passes < check {
                monitor.check()?;
                fitted.passes += 1;
                let is_checked = fitted.passes == check;
                fitted.pass(log, &targets, |number, value| {
                    if is_checked {
                        change.add(std::mem::replace(&mut before[number], value), value);
                    }
                });
            }
            // Before the first check there are no values to compare with.
            fitted.has_converged = check > CHECKS[0] && change.is_small();
            if fitted.has_converged || !change.is_finite() {
                break;
            }
        }
        Ok(fitted)
    }

    /// Makes a pass over the log. Gives `seen` the number of each transition and its q̂(s, a) before it moves.
    fn pass(&mut self, log: &Decisions, targets: &Targets<'_>, mut seen: impl FnMut(usize, f64)) {
        let Self { tiles, actions, weights, .. } = self;
        let (actions, length) = (*actions, tiles.len());
        let states = log.states();
        // Every pass computes the features again: those of all rows of a long log would take more memory than the log.
        let mut here = Vec::new();
        let mut ahead = Vec::new();
        let mut row_here = None;
        let step = STEP / tiles.active() as f64;
        for number in (0..log.len()).rev() {
            let transition = TransitionIndex::new(number);
            let mut target = f64::from(log.rewards()[number]);
            if log.endings()[number] == Ending::Continues {
                let policy = &targets.after[number * actions..][..actions];
                let next = log.transitions().next(transition).get();
                // In reverse order the next row is mostly the row of the previous step, whose features are in `here`.
                if row_here == Some(next) {
                    std::mem::swap(&mut here, &mut ahead);
                } else {
                    tiles.put_features(states.row(next), &mut ahead);
                }
                target += targets.gamma * expected(weights, policy, &ahead);
            }
            let own = &mut weights[usize::from(log.actions()[number]) * length..][..length];
            let source = log.transitions().source(transition).get();
            tiles.put_features(states.row(source), &mut here);
            row_here = Some(source);
            let value = sum(own, &here);
            seen(number, value);
            let change = step * (target.clamp(targets.lowest, targets.highest) - value);
            for &feature in &here {
                own[feature as usize] += change;
            }
        }
    }

    /// Returns the number of passes over the log that were made.
    pub(crate) fn passes(&self) -> usize {
        self.passes
    }

    /// Whether the values had converged after these passes.
    pub(crate) fn has_converged(&self) -> bool {
        self.has_converged
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
    use crate::{AgentConfig, Columns, FittedQValue, off_policy_values};

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
        let values: Vec<f64> = found.fitted_q.iter().map(|fitted| fitted.value).collect();
        assert_eq!((found.importance, found.doubly_robust), (None, None), "no probabilities");
        let five_steps = -(1.0 - 0.95_f64.powi(5)) / 0.05;
        assert!((values[0] - five_steps).abs() < 1.0, "{values:?}, not {five_steps}");
        assert!(values[1] < values[0] - 4.0, "{values:?}");
    }

    /// Returns 50 equal episodes with −1 per step. The agent stays in each of four places for a step, and then goes to the next one. Right of
    /// the last place is the end. No two places have a tile in common.
    fn chain() -> Decisions {
        let mut states = Vec::new();
        let mut actions = Vec::new();
        let mut endings = Vec::new();
        for _ in 0..50 {
            for place in [0.0_f32, 0.25, 0.5, 0.75] {
                for action in 0..2 {
                    states.push(place);
                    actions.push(Some(action));
                    endings.push(Ending::Continues);
                }
            }
            states.push(1.0);
            actions.push(None);
            endings.push(Ending::Terminal);
        }
        let rows = states.len();
        let columns = Columns { actions: &actions, rewards: &vec![-1.0; rows], endings: &endings };
        let states = States::new(states, rows, 1).expect("valid");
        let segments = Segments::from_lengths(vec![9; 50]).expect("valid");
        Decisions::new(states, &segments, columns, 2).expect("a log")
    }

    #[test]
    fn values_converge_to_those_of_a_chain() {
        let log = chain();
        let policy = [0.25, 0.75].repeat(log.len());
        let mut fitted = FittedQ::fit(&log, &policy, 0.9, 100, &Silent).expect("run");
        // v = −1 + 0.9 (0.25 v + 0.75 v'), where v' is the value of the next place, and 0 at the end.
        let value = (0..4).fold(0.0, |next: f64, _| (-1.0 + 0.675 * next) / 0.775);
        let start = States::new(vec![0.0], 1, 1).expect("valid");
        let got = fitted.mean_over(&start, &policy[..2]);
        assert!((got - value).abs() < 1e-6, "{got}, not {value}");
        assert_eq!((fitted.passes(), fitted.has_converged()), (20, true));
    }

    #[test]
    fn random_actions_take_each_action_as_often() {
        let log = chain();
        let start = States::new(vec![0.0], 1, 1).expect("valid");
        let random = FittedQValue::of_random_actions(&log, &start, 0.9, 100, &Silent).expect("run");
        // As above, with 0.5 in place of 0.25 and 0.75.
        let value = (0..4).fold(0.0, |next: f64, _| (-1.0 + 0.45 * next) / 0.55);
        assert!((random.value - value).abs() < 1e-3, "{random:?}, not {value}");
        assert!(random.converged, "{random:?}");
    }

    /// Returns the fit to one long episode in one state, with 1 per step.
    fn fitted_without_end(gamma: f64) -> FittedQ {
        let rows = 100;
        let columns = Columns {
            actions: &vec![Some(0); rows],
            rewards: &vec![1.0; rows],
            endings: &vec![Ending::Continues; rows],
        };
        let states = States::new(vec![0.5; rows], rows, 1).expect("valid");
        let segments = Segments::from_lengths(vec![rows]).expect("valid");
        let log = Decisions::new(states, &segments, columns, 1).expect("a log");
        FittedQ::fit(&log, &vec![1.0; log.len()], gamma, 1_000_000, &Silent).expect("run")
    }

    #[test]
    fn values_that_keep_growing_have_not_converged() {
        let fitted = fitted_without_end(1.0);
        assert_eq!((fitted.passes(), fitted.has_converged()), (FittedQ::MOST_PASSES, false));
    }

    #[test]
    fn equal_values_have_converged() {
        let fitted = fitted_without_end(0.5);
        assert_eq!((fitted.passes(), fitted.has_converged()), (20, true));
    }
}
