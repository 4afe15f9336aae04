use std::ops::Range;

use calib_core::{Seed, Stream};
use calib_nn::{Mlp, Optimiser};

use crate::{
    AgentConfig, Checkpoint, Learner,
    checkpointer::ValueState,
    layer_sizes,
    learner::Cumulants,
    network::{Network, Pass},
    values::{Batch, Learned, TargetClock, Values, optimiser, parameter_seed},
};

/// A population of multilayer perceptrons of one shape and precision.
///
/// A batch is gathered once for all of them. Each agent then computes its own products, so that its bytes do not
/// depend on the other agents. One wide product for the first layer of nine agents was measured to be 4 % slower,
/// because its output leaves the cache.
pub(crate) struct MlpValues {
    gamma: f32,
    agents: Vec<Agent>,
    /// Distinct cumulants on arriving at each state of the stream.
    series: Vec<Vec<f32>>,
    /// Input rows: s of the batch, then the present state if asked for, then s' of the batch.
    pass: Pass,
    /// Cumulants of the batch, series after series.
    cumulants: Vec<f32>,
    /// v(s') of the batch under the target network.
    next_values: Vec<f32>,
    /// Gradient of the loss with respect to v(s).
    output_gradient: Vec<f32>,
}

struct Agent {
    config: AgentConfig,
    network: Network,
    /// Index of the cumulant that the agent learns from.
    series: usize,
    /// Whether updates can change the parameters. Otherwise the agent only predicts.
    learns: bool,
    /// The target network for bootstrapping, if there is one.
    target: Option<Network>,
    clock: TargetClock,
    optimiser: Optimiser,
}

impl MlpValues {
    /// Returns agents of one shape, discount factor and batch size, for the states of `stream`.
    pub(crate) fn new(
        learners: &[Learner<'_>],
        stream: &dyn Stream,
        batch: usize,
        seed: Seed,
    ) -> Self {
        let shape = learners[0].config;
        let parameters = Mlp::new(&layer_sizes(shape, stream.width()), parameter_seed(seed));
        let pass = Pass::new(shape.precision, &parameters, 2 * batch + 1, batch);
        let count = parameters.parameter_count();
        let network = Network::new(shape.precision, parameters);
        let mut zero_output = network.clone();
        let mut zeroed = network.parameters().to_vec();
        // Weights and bias of the output come last. Hidden layers keep their random weights; otherwise every
        // gradient would be 0.
        zeroed[count - network.hidden_units() - 1..].fill(0.0);
        zero_output.set_parameters(&zeroed);
        let Cumulants { series, series_of } = Cumulants::new(learners, stream);
        Self {
            gamma: shape.gamma as f32,
            agents: learners
                .iter()
                .zip(series_of)
                .map(|(learner, series): (&Learner<'_>, usize)| {
                    let clock = TargetClock::new(learner.config.target_network_period);
                    let network = if learner.baseline.is_some() { &zero_output } else { &network };
                    Agent {
                        config: learner.config.clone(),
                        target: clock.is_on().then(|| network.clone()),
                        clock,
                        optimiser: optimiser(learner.config, count),
                        network: network.clone(),
                        series,
                        learns: learner.learns(),
                    }
                })
                .collect(),
            pass,
            cumulants: Vec::with_capacity(series.len() * batch),
            series,
            next_values: vec![0.0; batch],
            output_gradient: vec![0.0; batch],
        }
    }

    fn gather(&mut self, batch: Batch<'_>) {
        let Batch { stream, starts, present } = batch;
        let after = starts.iter().map(|&t| t + 1);
        let states = starts.iter().copied().chain(present).chain(after);
        self.pass.set(states.map(|t| stream.state(t)), starts.len());
        self.cumulants.clear();
        for series in &self.series {
            self.cumulants.extend(starts.iter().map(|&t| series[t + 1]));
        }
    }

    fn learn_one(&mut self, agent: usize, present: bool) -> Learned {
        let Self { gamma, agents, series, pass, cumulants, .. } = self;
        let next_values = &mut self.next_values;
        let output_gradient = &mut self.output_gradient;
        let agent = &mut agents[agent];
        let batch = cumulants.len() / series.len();
        let cumulants = &cumulants[agent.series * batch..][..batch];
        let ahead = batch + usize::from(present);
        let values = if let Some(target) = &agent.target {
            next_values[..batch].copy_from_slice(target.values(ahead..ahead + batch, pass));
            agent.network.values(0..ahead, pass)
        } else {
            let values = agent.network.values(0..ahead + batch, pass);
            next_values[..batch].copy_from_slice(&values[ahead..]);
            values
        };
        let prediction = present.then(|| values[batch]);
        let mut learned = Learned { prediction, squared_errors: 0.0, finite: true };
        let scale = -1.0 / batch as f32;
        let gradients = &mut output_gradient[..batch];
        let targets = cumulants.iter().zip(&next_values[..batch]);
        for ((gradient, value), (cumulant, next)) in gradients.iter_mut().zip(values).zip(targets) {
            let td_error = cumulant + *gamma * next - value;
            learned.finite &= td_error.is_finite();
            learned.squared_errors += td_error * td_error;
            *gradient = scale * td_error;
        }
        if agent.config.halve_after > 0 {
            agent.optimiser.set_learning_rate(agent.config.rate_after(agent.clock.updates()));
        }
        agent.network.step(&mut agent.optimiser, gradients, pass);
        if agent.clock.tick()
            && let Some(target) = &mut agent.target
        {
            target.set_parameters(agent.network.parameters());
        }
        learned
    }
}

impl Values for MlpValues {
    fn predict(&mut self, agent: usize, state: &[f32]) -> f32 {
        self.agents[agent].network.value(state, &mut self.pass)
    }

    fn predict_all(
        &mut self,
        agent: usize,
        stream: &dyn Stream,
        steps: Range<usize>,
        values: &mut Vec<f32>,
    ) {
        let network = &self.agents[agent].network;
        let rows = self.pass.capacity();
        for first in steps.clone().step_by(rows) {
            let steps = first..steps.end.min(first + rows);
            self.pass.set(steps.clone().map(|t| stream.state(t)), 0);
            values.extend_from_slice(network.values(0..steps.len(), &mut self.pass));
        }
    }

    fn learn(&mut self, batch: Batch<'_>, live: &[usize], learned: &mut [Learned]) {
        if live.iter().any(|&agent| self.agents[agent].learns) {
            self.gather(batch);
        }
        for (learned, &agent) in learned.iter_mut().zip(live) {
            *learned = if self.agents[agent].learns {
                self.learn_one(agent, batch.present.is_some())
            } else {
                let prediction = batch.present.map(|t| self.predict(agent, batch.stream.state(t)));
                Learned { prediction, squared_errors: 0.0, finite: true }
            };
        }
    }

    fn state(&self, agent: usize) -> ValueState {
        let agent = &self.agents[agent];
        ValueState {
            checkpoint: Checkpoint {
                parameters: agent.network.parameters().to_vec(),
                moments: agent.optimiser.moments(),
            },
            target: agent.target.as_ref().map(|target| target.parameters().to_vec()),
            traces: None,
            updates: agent.clock.updates(),
        }
    }

    fn restore(&mut self, agent: usize, state: &ValueState) {
        let agent = &mut self.agents[agent];
        let parameters = &state.checkpoint.parameters;
        agent.network.set_parameters(parameters);
        if let Some(target) = &mut agent.target {
            target.set_parameters(state.target.as_ref().unwrap_or(parameters));
        }
        agent.clock.set_updates(state.updates);
        agent.optimiser = optimiser(&agent.config, parameters.len());
        if let Some(moments) = &state.checkpoint.moments {
            agent.optimiser = agent.optimiser.clone().with_moments(moments.clone());
        }
    }

    fn is_finite(&self, agent: usize) -> bool {
        let parameters = self.agents[agent].network.parameters();
        parameters.iter().all(|value| value.is_finite())
    }
}
