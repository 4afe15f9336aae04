use calib_core::Seed;
use calib_nn::{Mlp, Optimiser};
use pulp::{Arch, NullaryFnOnce};

use crate::{
    AgentConfig,
    kernels::{LANES, add_products, add_scaled, total},
    values::{Batch, Learned, TargetClock, Values, optimiser, parameter_seed},
};

/// A population of linear value functions v(s) = w · s + b.
///
/// Weights, bias and zeros up to a multiple of [`LANES`] lie in one vector that is multiplied with
/// (s, 1, 0 …). A transition is read once for all agents.
pub(crate) struct LinearValues {
    gamma: f32,
    agents: Vec<Agent>,
    /// (s, 1, 0 …).
    state: Vec<f32>,
    /// γ (s', 1, 0 …).
    next: Vec<f32>,
}

struct Agent {
    weights: Vec<f32>,
    /// Bootstraps come from here, where there is one.
    target: Option<Vec<f32>>,
    clock: TargetClock,
    gradient: Vec<f32>,
    optimiser: Optimiser,
}

impl LinearValues {
    /// Agents of one discount factor, for states of `width` values. Initial weights are those of a
    /// network without hidden layers.
    pub(crate) fn new(configs: &[&AgentConfig], width: usize, seed: Seed) -> Self {
        let padded = (width + 1).next_multiple_of(LANES);
        let mut weights = Mlp::new(&[width, 1], parameter_seed(seed)).parameters().to_vec();
        weights.resize(padded, 0.0);
        let agent = |config: &&AgentConfig| {
            let clock = TargetClock::new(config.target_network_period);
            Agent {
                target: clock.is_on().then(|| weights.clone()),
                clock,
                gradient: vec![0.0; padded],
                optimiser: optimiser(config, padded),
                weights: weights.clone(),
            }
        };
        let gamma = configs[0].gamma as f32;
        let row = |one: f32| {
            let mut row = vec![0.0; padded];
            row[width] = one;
            row
        };
        Self {
            gamma,
            agents: configs.iter().map(agent).collect(),
            state: row(1.0),
            next: row(gamma),
        }
    }

    #[cfg(test)]
    pub(crate) fn weights(&self, agent: usize) -> &[f32] {
        &self.agents[agent].weights
    }
}

impl Values for LinearValues {
    fn predict(&mut self, agent: usize, state: &[f32]) -> f32 {
        self.state[..state.len()].copy_from_slice(state);
        Arch::new().dispatch(Predict { weights: &self.agents[agent].weights, state: &self.state })
    }

    fn learn(&mut self, batch: Batch<'_>, live: &[usize], learned: &mut [Learned]) {
        for (learned, &agent) in learned.iter_mut().zip(live) {
            *learned = Learned {
                prediction: batch.present.map(|t| self.predict(agent, batch.stream.state(t))),
                finite: true,
            };
        }
        Arch::new().dispatch(Pass { values: self, batch, live, learned });
        for &agent in live {
            let agent = &mut self.agents[agent];
            agent.optimiser.step(&mut agent.weights, &agent.gradient);
            if agent.clock.tick()
                && let Some(target) = &mut agent.target
            {
                target.copy_from_slice(&agent.weights);
            }
        }
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

impl NullaryFnOnce for Predict<'_> {
    type Output = f32;

    #[expect(
        clippy::inline_always,
        reason = "only what is inlined into the dispatch is compiled for the processor"
    )]
    #[inline(always)]
    fn call(self) -> f32 {
        let mut sums = [0.0; LANES];
        add_products(&mut sums, self.state, self.weights);
        total(sums)
    }
}

/// Gradients of all live agents, one transition after the other.
struct Pass<'a> {
    values: &'a mut LinearValues,
    batch: Batch<'a>,
    live: &'a [usize],
    learned: &'a mut [Learned],
}

impl NullaryFnOnce for Pass<'_> {
    type Output = ();

    #[expect(
        clippy::inline_always,
        reason = "only what is inlined into the dispatch is compiled for the processor"
    )]
    #[inline(always)]
    fn call(self) {
        let LinearValues { gamma, agents, state, next } = self.values;
        let Batch { stream, cumulant, starts, .. } = self.batch;
        let width = stream.width();
        let scale = -1.0 / starts.len() as f32;
        for &agent in self.live {
            agents[agent].gradient.fill(0.0);
        }
        for &t in starts {
            state[..width].copy_from_slice(stream.state(t));
            let following = stream.state(t + 1);
            for (next, value) in next.iter_mut().zip(following) {
                *next = *gamma * value;
            }
            for (&agent, learned) in self.live.iter().zip(&mut *self.learned) {
                let agent = &mut agents[agent];
                let (mut values, mut next_values) = ([0.0; LANES], [0.0; LANES]);
                add_products(&mut values, state, &agent.weights);
                let bootstrap = agent.target.as_ref().unwrap_or(&agent.weights);
                add_products(&mut next_values, next, bootstrap);
                for (next_value, value) in next_values.iter_mut().zip(values) {
                    *next_value -= value;
                }
                let td_error = following[cumulant] + total(next_values);
                learned.finite &= td_error.is_finite();
                add_scaled(&mut agent.gradient, scale * td_error, state);
            }
        }
    }
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

    /// Learn from the transition that starts at `t`, as without replay.
    fn online(agents: &mut LinearValues, stream: &RowStream, t: usize) -> Learned {
        let mut learned = [Learned::default()];
        let batch = Batch { stream, cumulant: 0, starts: &[t], present: Some(t) };
        agents.learn(batch, &[0], &mut learned);
        learned[0]
    }

    #[test]
    fn one_online_update_is_the_one_done_by_hand() {
        let states = States::new(vec![1.0, 0.5, 0.25, -1.0], 2, 2).expect("valid");
        let stream = RowStream::unbroken(states, vec![RowIndex::new(0), RowIndex::new(1)]);
        let mut agents = LinearValues::new(&[&sgd(0.5, 0.5)], 2, Seed::new(1));
        agents.agents[0].weights[..3].copy_from_slice(&[2.0, -1.0, 0.5]);
        // v(s) = 2 − 0.5 + 0.5 = 2, v(s') = 0.5 + 1 + 0.5 = 2, δ = 0.25 + 0.5 · 2 − 2 = −0.75.
        let learned = online(&mut agents, &stream, 0);
        assert_eq!(learned.prediction, Some(2.0));
        let half_error = 0.5 * -0.75;
        let expected = [2.0 + half_error, -1.0 + 0.5 * half_error, 0.5 + half_error];
        assert_eq!(agents.weights(0)[..3], expected);
        assert!(agents.weights(0)[3..].iter().all(|&padding| padding == 0.0));
    }

    /// TD(0) with linear values converges to the w with Σ x (x − γx')ᵀ w = Σ x o (Bradtke & Barto 1996).
    #[test]
    fn converges_to_the_fixed_point_of_td() {
        let (n, gamma) = (400, 0.8);
        let mut rng = Seed::new(6).rng();
        let mut values = vec![0.0_f64; 2];
        for t in 1..n {
            let (a, b) = (values[2 * t - 2], values[2 * t - 1]);
            values.push(0.7 * a - 0.3 * b + 0.5 * rng.normal());
            values.push(0.4 * a + 0.6 * b * b.cos() + 0.2);
        }
        let states = States::new(values.iter().map(|&x| x as f32).collect(), n, 2).expect("valid");
        let stream = RowStream::unbroken(states, (0..n).map(RowIndex::new).collect());
        let x = |t: usize| [values[2 * t], values[2 * t + 1], 1.0];
        let mut system = [[0.0; 4]; 3];
        for t in 0..n - 1 {
            for (i, row) in system.iter_mut().enumerate() {
                let [left @ .., right] = row;
                for (left, (x_j, next)) in left.iter_mut().zip(x(t).into_iter().zip(x(t + 1))) {
                    *left += x(t)[i] * (x_j - gamma * next);
                }
                *right += x(t)[i] * x(t + 1)[0];
            }
        }
        let expected = solve(system);
        let mut agents = LinearValues::new(&[&sgd(0.3, gamma)], 2, Seed::new(1));
        let all: Vec<usize> = (0..n - 1).collect();
        let batch = Batch { stream: &stream, cumulant: 0, starts: &all, present: None };
        for _ in 0..3_000 {
            agents.learn(batch, &[0], &mut [Learned::default()]);
        }
        for (got, expected) in agents.weights(0).iter().zip(expected) {
            assert!((f64::from(*got) - expected).abs() < 1e-4, "{got} {expected}");
        }
    }

    /// Gauss–Jordan elimination of three equations.
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
