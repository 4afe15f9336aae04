use calib_core::Stream;

use crate::{
    AgentConfig, Checkpoint, Learner, OptimiserKind,
    checkpointer::ValueState,
    learner::Cumulants,
    values::{Batch, Learned, Values},
};

/// A population of linear value functions v(s) = w · (s, 1) that learn from each transition once, in time order. The
/// algorithm is true online TD(λ) (van Seijen and others 2016), or `SwiftTD` (Javed, Sharifnassab and Sutton 2024),
/// which also adapts a step size for every weight and bounds the rate of learning.
pub(crate) struct OnlineValues {
    gamma: f32,
    agents: Vec<Agent>,
    /// Distinct cumulants on arriving at each state.
    series: Vec<Vec<f32>>,
    /// Features (s, 1) of the next state.
    features: Vec<f32>,
}

struct Agent {
    rule: Rule,
    series: usize,
    learns: bool,
    weights: Vec<f32>,
    memory: Memory,
    updates: usize,
}

/// The smallest step size. Features far outside their range would otherwise shrink it until it can neither be divided
/// by nor grow again.
const LEAST_RATE: f32 = 1e-10;

/// The update rule of an agent. Names and symbols are those of the paper: λ, η, ε and θ.
#[derive(Clone, Copy, Debug)]
struct Rule {
    lambda: f32,
    /// The largest share of the error at the present state that an update may correct.
    bound: f32,
    /// Logarithm of the factor by which step sizes shrink where they would exceed the bound.
    log_decay: f32,
    /// Step size of the gradient descent on the step sizes.
    meta_step_size: f32,
}

/// The state of an agent between steps: values of each weight, and of the present state.
#[derive(Clone, Debug, Default)]
struct Memory {
    /// Logarithms of the step sizes.
    log_rates: Vec<f32>,
    /// Eligibility, and the present state's contribution to it.
    trace: Vec<f32>,
    trace_step: Vec<f32>,
    /// The last change of the weight.
    weight_step: Vec<f32>,
    /// Sensitivity of the weight to its step size: now, a step before, and a step ahead.
    h: Vec<f32>,
    h_old: Vec<f32>,
    h_next: Vec<f32>,
    /// Sensitivity of the eligibility to the step size.
    trace_bar: Vec<f32>,
    /// The trace that step sizes learn from.
    p: Vec<f32>,
    /// v of the present state, with the weights before the last update.
    value: f32,
    /// Change of v of the present state by the last update.
    value_step: f32,
}

impl Memory {
    fn new(length: usize, learning_rate: f64, rule: Rule) -> Self {
        let mut memory = Self::default();
        for part in memory.parts() {
            part.resize(length, 0.0);
        }
        memory.log_rates.fill((learning_rate as f32).min(rule.bound).ln());
        memory
    }

    fn parts(&mut self) -> [&mut Vec<f32>; 9] {
        [
            &mut self.log_rates,
            &mut self.trace,
            &mut self.trace_step,
            &mut self.weight_step,
            &mut self.h,
            &mut self.h_old,
            &mut self.h_next,
            &mut self.trace_bar,
            &mut self.p,
        ]
    }

    /// Resets the traces after a gap. Step sizes, and what adapts them, are kept.
    fn begin(&mut self) {
        let Self { trace, trace_step, weight_step, trace_bar, p, .. } = self;
        for part in [trace, trace_step, weight_step, trace_bar, p] {
            part.fill(0.0);
        }
        self.value_step = 0.0;
    }

    /// Returns all numbers as one vector.
    fn flat(&self) -> Vec<f32> {
        let mut copy = self.clone();
        let mut numbers = copy.parts().map(std::mem::take).concat();
        numbers.extend([self.value, self.value_step]);
        numbers
    }

    /// Restores the output of [`flat`](Self::flat) for the same number of weights.
    fn restore(&mut self, numbers: &[f32]) {
        let [parts @ .., value, value_step] = numbers else { return };
        let length = self.trace.len();
        for (part, numbers) in self.parts().into_iter().zip(parts.chunks_exact(length)) {
            part.copy_from_slice(numbers);
        }
        (self.value, self.value_step) = (*value, *value_step);
    }
}

impl Agent {
    /// Returns an agent with `length` weights that learns from the first cumulant.
    fn new(config: &AgentConfig, length: usize) -> Self {
        let rule = Rule::of(config);
        let memory = Memory::new(length, config.learning_rate, rule);
        Self { rule, series: 0, learns: true, weights: vec![0.0; length], memory, updates: 0 }
    }

    fn value(&self, features: &[f32]) -> f32 {
        self.weights.iter().zip(features).map(|(w, x)| w * x).sum()
    }

    /// Learns from the transition to these features with this reward, and returns the TD error.
    fn arrive(&mut self, features: &[f32], reward: f32, gamma: f32) -> f32 {
        let value = self.value(features);
        let error = reward + gamma * value - self.memory.value;
        let Rule { lambda, bound, meta_step_size, .. } = self.rule;
        let length = self.weights.len();
        let value_step = self.memory.value_step;
        let decay = gamma * lambda;
        let Memory {
            log_rates,
            trace,
            trace_step,
            weight_step,
            h,
            h_old,
            h_next,
            trace_bar,
            p,
            ..
        } = &mut self.memory;
        for i in 0..length {
            weight_step[i] = error * trace[i] - trace_step[i] * value_step;
            self.weights[i] += weight_step[i];
            if meta_step_size > 0.0 {
                log_rates[i] += meta_step_size / log_rates[i].exp() * (error - value_step) * p[i];
                let rate = log_rates[i].exp();
                if rate > bound || rate.is_infinite() {
                    log_rates[i] = bound.ln();
                } else if rate.is_nan() || rate < LEAST_RATE {
                    log_rates[i] = LEAST_RATE.ln();
                }
                h_old[i] = h[i];
                h[i] = h_next[i] + error * trace_bar[i] - trace_step[i] * value_step;
                h_next[i] = h[i];
                p[i] *= decay;
                trace_bar[i] *= decay;
            }
            trace_step[i] = 0.0;
            trace[i] *= decay;
        }
        self.observe(features, value);
        error
    }

    /// Adds the present features to the traces.
    fn observe(&mut self, features: &[f32], value: f32) {
        let Rule { bound, log_decay, meta_step_size, .. } = self.rule;
        let least = LEAST_RATE.ln();
        let Memory {
            log_rates,
            trace,
            trace_step,
            weight_step,
            h,
            h_old,
            h_next,
            trace_bar,
            p,
            ..
        } = &mut self.memory;
        let mut rate = 0.0;
        let mut overlap = 0.0;
        let mut value_step = 0.0;
        for (i, x) in features.iter().enumerate() {
            rate += log_rates[i].exp() * x * x;
            overlap += trace[i] * x;
            value_step += weight_step[i] * x;
        }
        let factor = (bound / rate).min(1.0);
        for (i, x) in features.iter().enumerate() {
            trace_step[i] = factor * log_rates[i].exp() * x;
            trace[i] += trace_step[i] * (1.0 - overlap);
            if meta_step_size > 0.0 {
                p[i] += h_old[i] * x;
                trace_bar[i] += trace_step[i] * (1.0 - overlap - trace_bar[i] * x);
                h_next[i] =
                    h[i] - h_old[i] * x * (trace[i] - trace_step[i]) - h[i] * trace_step[i] * x;
            }
            if rate > bound {
                h_next[i] = 0.0;
                h[i] = 0.0;
                h_old[i] = 0.0;
                trace_bar[i] = 0.0;
                log_rates[i] = (log_rates[i] + log_decay * x * x).max(least);
            }
        }
        self.memory.value = value;
        self.memory.value_step = value_step;
    }
}

impl OnlineValues {
    /// Returns agents of one discount factor. All weights start at 0.
    pub(crate) fn new(learners: &[Learner<'_>], stream: &dyn Stream) -> Self {
        let length = stream.width() + 1;
        let Cumulants { series, series_of } = Cumulants::new(learners, stream);
        Self {
            gamma: learners[0].config.gamma as f32,
            agents: learners
                .iter()
                .zip(series_of)
                .map(|(learner, series): (&Learner<'_>, usize)| Agent {
                    series,
                    learns: learner.learns(),
                    ..Agent::new(learner.config, length)
                })
                .collect(),
            series,
            features: vec![1.0; length],
        }
    }

    fn set(&mut self, state: &[f32]) {
        self.features[..state.len()].copy_from_slice(state);
    }
}

impl Rule {
    fn of(config: &AgentConfig) -> Self {
        let adapts = config.optimiser == OptimiserKind::SwiftTd;
        Self {
            lambda: config.lambda as f32,
            bound: if adapts { config.rate_bound as f32 } else { f32::INFINITY },
            log_decay: config.rate_decay.ln() as f32,
            meta_step_size: if adapts { config.meta_step_size as f32 } else { 0.0 },
        }
    }
}

impl Values for OnlineValues {
    fn predict(&mut self, agent: usize, state: &[f32]) -> f32 {
        self.set(state);
        self.agents[agent].value(&self.features)
    }

    fn learn(&mut self, batch: Batch<'_>, live: &[usize], learned: &mut [Learned]) {
        let Batch { stream, starts, present } = batch;
        for (learned, &agent) in learned.iter_mut().zip(live) {
            let prediction = present.map(|t| self.predict(agent, stream.state(t)));
            *learned = Learned { prediction, squared_errors: 0.0, finite: true };
        }
        for &t in starts {
            let is_first = stream.pieces().binary_search_by_key(&t, |piece| piece.start).is_ok();
            if is_first {
                self.set(stream.state(t));
                for &agent in live {
                    let agent = &mut self.agents[agent];
                    agent.memory.begin();
                    let value = agent.value(&self.features);
                    agent.observe(&self.features, value);
                }
            }
            self.set(stream.state(t + 1));
            for (learned, &agent) in learned.iter_mut().zip(live) {
                let agent = &mut self.agents[agent];
                agent.updates += 1;
                if agent.learns {
                    let reward = self.series[agent.series][t + 1];
                    let error = agent.arrive(&self.features, reward, self.gamma);
                    learned.squared_errors += error * error;
                    learned.finite &= error.is_finite();
                }
            }
        }
    }

    fn state(&self, agent: usize) -> ValueState {
        let agent = &self.agents[agent];
        let checkpoint = Checkpoint { parameters: agent.weights.clone(), moments: None };
        let traces = Some(agent.memory.flat());
        ValueState { checkpoint, target: None, traces, updates: agent.updates }
    }

    fn restore(&mut self, agent: usize, state: &ValueState) {
        let agent = &mut self.agents[agent];
        agent.weights.clone_from(&state.checkpoint.parameters);
        agent.updates = state.updates;
        if let Some(traces) = &state.traces {
            agent.memory.restore(traces);
        }
    }

    fn is_finite(&self, agent: usize) -> bool {
        self.agents[agent].weights.iter().all(|value| value.is_finite())
    }
}

#[cfg(test)]
mod tests {
    use calib_core::{RowIndex, RowStream, States};
    use serde::Deserialize;

    use super::*;
    use crate::{ReplayKind, ValueFunction};

    #[derive(Deserialize)]
    struct Golden {
        gamma: f64,
        features: Vec<Vec<f32>>,
        rewards: Vec<f32>,
        cases: Vec<Case>,
    }

    #[derive(Deserialize)]
    struct Case {
        lambda: f64,
        learning_rate: f64,
        rate_bound: f64,
        rate_decay: f64,
        meta_step_size: f64,
        /// v of each state, with the weights before the transition to it was learned from.
        values: Vec<f64>,
        weights: Vec<f64>,
        log_rates: Vec<f64>,
    }

    fn swift_td() -> AgentConfig {
        AgentConfig {
            value_function: ValueFunction::Linear,
            replay: ReplayKind::None,
            optimiser: OptimiserKind::SwiftTd,
            ..AgentConfig::default()
        }
    }

    fn close(got: f32, expected: f64) -> bool {
        (f64::from(got) - expected).abs() < 2e-4 * expected.abs().max(1.0)
    }

    #[test]
    fn the_published_implementation_gives_the_same() {
        let golden: Golden =
            serde_json::from_str(include_str!("../tests/golden/swift_td.json")).expect("reads");
        let steps = golden.features.len();
        let width = golden.features[0].len();
        // A state is all features but the constant, and the reward that comes with it.
        let values = golden.features.iter().zip(&golden.rewards);
        let values: Vec<f32> = values
            .flat_map(|(features, reward)| [&features[..width - 1], &[*reward]].concat())
            .collect();
        let states = States::new(values, steps, width).expect("valid");
        let stream = RowStream::unbroken(states, (0..steps).map(RowIndex::new).collect());
        for case in &golden.cases {
            let config = AgentConfig {
                gamma: golden.gamma,
                lambda: case.lambda,
                learning_rate: case.learning_rate,
                rate_bound: case.rate_bound,
                rate_decay: case.rate_decay,
                meta_step_size: case.meta_step_size,
                ..swift_td()
            };
            config.check().expect("valid");
            let mut agent = Agent::new(&config, width);
            for t in 0..steps {
                let features = &golden.features[t];
                if t == 0 {
                    agent.observe(features, 0.0);
                } else {
                    let reward = stream.state(t)[width - 1];
                    agent.arrive(features, reward, golden.gamma as f32);
                }
                assert!(close(agent.memory.value, case.values[t]), "step {t}");
            }
            for (got, expected) in agent.weights.iter().zip(&case.weights) {
                assert!(close(*got, *expected), "{got} {expected}");
            }
            for (got, expected) in agent.memory.log_rates.iter().zip(&case.log_rates) {
                assert!(close(*got, *expected), "{got} {expected}");
            }
        }
    }

    /// A sensor is off the scale for a while: the state is far outside its scaling range.
    #[test]
    fn outliers_end_nothing() {
        for learning_rate in [1e-6, 1e-3] {
            let mut agent = Agent::new(&AgentConfig { learning_rate, ..swift_td() }, 3);
            let mut error = 0.0;
            for t in 0..20_000 {
                let wave = (t as f32 * 0.05).sin();
                let outlier = if (500..560).contains(&t) { 3e3 } else { 0.5 };
                error = agent.arrive(&[wave, outlier, 1.0], wave, 0.5);
                assert!(agent.weights.iter().all(|weight| weight.is_finite()), "step {t}");
            }
            assert!(error.abs() < 0.1, "it learns again: {error}");
        }
    }
}
