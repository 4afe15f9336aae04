#![expect(
    clippy::inline_always,
    reason = "only what is inlined into the dispatch is compiled for the processor"
)]

use calib_core::{Seed, Stream};
use calib_nn::{Mlp, Moments, Optimiser};
use pulp::{Arch, Simd, WithSimd};

use crate::{
    AgentConfig, Checkpoint, Learner,
    checkpointer::ValueState,
    kernels::{LANES, add_scaled, dot_products},
    learner::Cumulants,
    values::{Batch, Learned, TargetClock, Values, optimiser, parameter_seed},
};

/// A population of linear value functions v(s) = w · s + b.
///
/// Weights, bias and padding zeros up to a multiple of [`LANES`] form one vector that is multiplied with
/// (s, 1, 0 …). A transition is read once for all agents.
pub(crate) struct LinearValues {
    gamma: f32,
    agents: Vec<Agent>,
    /// Distinct cumulants on arriving at each state, and the cumulants of one block of transitions.
    series: Vec<Vec<f32>>,
    cumulants: Vec<[f32; BLOCK]>,
    /// Length of (s, 1), and of (s, 1, 0 …).
    length: usize,
    padded: usize,
    /// Features (s, 1, 0 …) of one block of transitions.
    states: Vec<f32>,
    /// Features ahead for the same block: γ (s', 1, 0 …) with target networks, γ (s', 1, 0 …) − (s, 1, 0
    /// …) without.
    ahead: Vec<f32>,
}

/// Transitions read at a time, so that their states stay in registers and the nearest cache.
const BLOCK: usize = 8;

struct Agent {
    config: AgentConfig,
    /// Index of the cumulant that the agent learns from.
    series: usize,
    weights: Vec<f32>,
    /// Weights of the target network for bootstrapping, if there is one.
    target: Option<Vec<f32>>,
    clock: TargetClock,
    gradient: Vec<f32>,
    optimiser: Optimiser,
}

impl LinearValues {
    /// Returns agents of one discount factor, either all with target networks or all without, for the
    /// states of `stream`. Initial weights are those of a network without hidden layers, or 0 if there
    /// is a baseline.
    pub(crate) fn new(learners: &[Learner<'_>], stream: &dyn Stream, seed: Seed) -> Self {
        let width = stream.width();
        let padded = (width + 1).next_multiple_of(LANES);
        let mut weights = Mlp::new(&[width, 1], parameter_seed(seed)).parameters().to_vec();
        weights.resize(padded, 0.0);
        let Cumulants { series, series_of } = Cumulants::new(learners, stream);
        let mut states = vec![0.0; BLOCK * padded];
        states.iter_mut().skip(width).step_by(padded).for_each(|one| *one = 1.0);
        Self {
            gamma: learners[0].config.gamma as f32,
            agents: learners
                .iter()
                .zip(series_of)
                .map(|(learner, series): (&Learner<'_>, usize)| {
                    let clock = TargetClock::new(learner.config.target_network_period);
                    let weights = if learner.baseline.is_some() {
                        vec![0.0; padded]
                    } else {
                        weights.clone()
                    };
                    Agent {
                        config: learner.config.clone(),
                        series,
                        target: clock.is_on().then(|| weights.clone()),
                        clock,
                        gradient: vec![0.0; padded],
                        optimiser: optimiser(learner.config, padded),
                        weights,
                    }
                })
                .collect(),
            cumulants: vec![[0.0; BLOCK]; series.len()],
            series,
            length: width + 1,
            padded,
            states,
            ahead: vec![0.0; BLOCK * padded],
        }
    }

    #[cfg(test)]
    pub(crate) fn weights(&self, agent: usize) -> &[f32] {
        &self.agents[agent].weights
    }
}

impl Values for LinearValues {
    fn predict(&mut self, agent: usize, state: &[f32]) -> f32 {
        self.states[..state.len()].copy_from_slice(state);
        Arch::new().dispatch(Predict {
            weights: &self.agents[agent].weights,
            state: &self.states[..self.padded],
        })
    }

    fn learn(&mut self, batch: Batch<'_>, live: &[usize], learned: &mut [Learned]) {
        for (learned, &agent) in learned.iter_mut().zip(live) {
            *learned = Learned {
                prediction: batch.present.map(|t| self.predict(agent, batch.stream.state(t))),
                squared_errors: 0.0,
                finite: true,
            };
        }
        Arch::new().dispatch(Pass { values: self, batch, live, learned });
        for &agent in live {
            let agent = &mut self.agents[agent];
            if agent.config.halve_after > 0 {
                agent.optimiser.set_learning_rate(agent.config.rate_after(agent.clock.updates()));
            }
            agent.optimiser.step(&mut agent.weights, &agent.gradient);
            if agent.clock.tick()
                && let Some(target) = &mut agent.target
            {
                target.copy_from_slice(&agent.weights);
            }
        }
    }

    fn state(&self, agent: usize) -> ValueState {
        let agent = &self.agents[agent];
        let length = self.length;
        ValueState {
            checkpoint: Checkpoint {
                parameters: agent.weights[..length].to_vec(),
                moments: agent.optimiser.moments().map(|moments| Moments {
                    mean: moments.mean[..length].to_vec(),
                    square: moments.square[..length].to_vec(),
                    powers: moments.powers,
                }),
            },
            target: agent.target.as_deref().map(|target| target[..length].to_vec()),
            traces: None,
            updates: agent.clock.updates(),
        }
    }

    fn restore(&mut self, agent: usize, state: &ValueState) {
        let agent = &mut self.agents[agent];
        let padded = self.padded;
        let Checkpoint { parameters, moments } = &state.checkpoint;
        agent.weights = pad(parameters, padded);
        if agent.target.is_some() {
            agent.target = Some(pad(state.target.as_ref().unwrap_or(parameters), padded));
        }
        agent.clock.set_updates(state.updates);
        let optimiser = optimiser(&agent.config, padded);
        agent.optimiser = match moments {
            Some(Moments { mean, square, powers }) => optimiser.with_moments(Moments {
                mean: pad(mean, padded),
                square: pad(square, padded),
                powers: *powers,
            }),
            None => optimiser,
        };
    }

    fn is_finite(&self, agent: usize) -> bool {
        let weights = &self.agents[agent].weights;
        weights.iter().all(|value| value.is_finite())
    }
}

struct Predict<'a> {
    weights: &'a [f32],
    state: &'a [f32],
}

impl WithSimd for Predict<'_> {
    type Output = f32;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f32 {
        let [value] = dot_products(simd, [self.state], self.weights);
        value
    }
}

/// One pass that sums the gradients of all live agents from the transitions of a batch.
struct Pass<'a> {
    values: &'a mut LinearValues,
    batch: Batch<'a>,
    live: &'a [usize],
    learned: &'a mut [Learned],
}

impl WithSimd for Pass<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        for &agent in self.live {
            self.values.agents[agent].gradient.fill(0.0);
        }
        let (blocks, rest) = self.batch.starts.as_chunks::<BLOCK>();
        for &block in blocks {
            self.add_gradients(simd, block);
        }
        for &start in rest {
            self.add_gradients(simd, [start]);
        }
    }
}

impl Pass<'_> {
    /// Reads a block of transitions once, then adds to the gradient of each agent.
    #[inline(always)]
    fn add_gradients<S: Simd, const ROWS: usize>(&mut self, simd: S, starts: [usize; ROWS]) {
        let LinearValues { gamma, agents, series, cumulants, padded, states, ahead, .. } =
            &mut *self.values;
        let stream = self.batch.stream;
        let gamma = *gamma;
        let width = stream.width();
        let padded = *padded;
        let with_targets = agents[0].target.is_some();
        let rows = states.chunks_exact_mut(padded).zip(ahead.chunks_exact_mut(padded));
        for (t, (state, ahead)) in starts.into_iter().zip(rows) {
            let now = stream.state(t);
            let next = stream.state(t + 1);
            state[..width].copy_from_slice(now);
            let kept = if with_targets { 0.0 } else { -1.0 };
            for ((ahead, next), now) in ahead.iter_mut().zip(next).zip(now) {
                *ahead = gamma * next + kept * now;
            }
            ahead[width] = gamma + kept;
        }
        let states: [&[f32]; ROWS] = rows_of(states, padded);
        let ahead: [&[f32]; ROWS] = rows_of(ahead, padded);
        for (cumulants, series) in cumulants.iter_mut().zip(&*series) {
            for (cumulant, t) in cumulants.iter_mut().zip(starts) {
                *cumulant = series[t + 1];
            }
        }
        let scale = -1.0 / self.batch.starts.len() as f32;
        for (&agent, learned) in self.live.iter().zip(&mut *self.learned) {
            let agent = &mut agents[agent];
            let (bootstraps, values): (_, [f32; ROWS]) = match &agent.target {
                // γ v(s') and v(s) from two sets of weights,
                Some(target) => {
                    let bootstraps = dot_products(simd, ahead, target);
                    (bootstraps, dot_products(simd, states, &agent.weights))
                }
                // or γ v(s') − v(s) at once.
                None => (dot_products(simd, ahead, &agent.weights), [0.0; ROWS]),
            };
            let cumulants = &cumulants[agent.series];
            let mut scales = [0.0; ROWS];
            for (index, scaled) in scales.iter_mut().enumerate() {
                let td_error = cumulants[index] + bootstraps[index] - values[index];
                learned.finite &= td_error.is_finite();
                learned.squared_errors += td_error * td_error;
                *scaled = scale * td_error;
            }
            add_scaled(simd, &mut agent.gradient, scales, states);
        }
    }
}

/// Returns values with zeros up to a length.
fn pad(values: &[f32], length: usize) -> Vec<f32> {
    let mut values = values.to_vec();
    values.resize(length, 0.0);
    values
}

/// Returns the first `ROWS` rows of `length` values each.
fn rows_of<const ROWS: usize>(values: &[f32], length: usize) -> [&[f32]; ROWS] {
    std::array::from_fn(|index| &values[index * length..][..length])
}

#[cfg(test)]
mod tests {
    use calib_core::{RowIndex, RowStream, States};

    use super::*;
    use crate::{OptimiserKind, values::Batch};

    fn sgd(learning_rate: f64, gamma: f64) -> AgentConfig {
        AgentConfig {
            optimiser: OptimiserKind::Sgd,
            learning_rate,
            gamma,
            ..AgentConfig::default()
        }
    }

    /// Returns a population of one agent that predicts the first of two columns.
    fn agents_of(config: &AgentConfig, stream: &RowStream) -> LinearValues {
        LinearValues::new(&[Learner::new(config, 0)], stream, Seed::new(1))
    }

    /// TD(0) with linear values converges to the w with Σ x (x − γx')ᵀ w = Σ x o (Bradtke & Barto 1996).
    #[test]
    fn converges_to_the_fixed_point_of_td() {
        let n = 400;
        let gamma = 0.8;
        let mut rng = Seed::new(6).rng();
        let mut values = vec![0.0_f64; 2];
        for t in 1..n {
            let a = values[2 * t - 2];
            let b = values[2 * t - 1];
            values.push(0.7 * a - 0.3 * b + 0.5 * rng.normal());
            values.push(0.4 * a + 0.6 * b * b.cos() + 0.2);
        }
        let states = States::new(values.iter().map(|&x| x as f32).collect(), n, 2).expect("valid");
        let stream = RowStream::unbroken(states, (0..n).map(RowIndex::new).collect());
        let rows: Vec<[f64; 3]> = values.chunks(2).map(|pair| [pair[0], pair[1], 1.0]).collect();
        let mut system = [[0.0; 4]; 3];
        for t in 0..n - 1 {
            for (i, row) in system.iter_mut().enumerate() {
                let [left @ .., right] = row;
                for (left, (x_j, next)) in left.iter_mut().zip(rows[t].into_iter().zip(rows[t + 1]))
                {
                    *left += rows[t][i] * (x_j - gamma * next);
                }
                *right += rows[t][i] * rows[t + 1][0];
            }
        }
        let expected = solve(system);
        let mut agents = agents_of(&sgd(0.3, gamma), &stream);
        let all: Vec<usize> = (0..n - 1).collect();
        let batch = Batch { stream: &stream, starts: &all, present: None };
        for _ in 0..3_000 {
            agents.learn(batch, &[0], &mut [Learned::default()]);
        }
        for (got, expected) in agents.weights(0).iter().zip(expected) {
            assert!((f64::from(*got) - expected).abs() < 1e-4, "{got} {expected}");
        }
    }

    /// Solves three equations by Gauss–Jordan elimination.
    fn solve(mut system: [[f64; 4]; 3]) -> [f64; 3] {
        for pivot in 0..3 {
            let scale = system[pivot][pivot];
            system[pivot] = system[pivot].map(|value| value / scale);
            let row = system[pivot];
            for other in (0..3).filter(|&other| other != pivot) {
                let factor = system[other][pivot];
                for (value, pivot_value) in system[other].iter_mut().zip(row) {
                    *value -= factor * pivot_value;
                }
            }
        }
        system.map(|row| row[3])
    }
}
