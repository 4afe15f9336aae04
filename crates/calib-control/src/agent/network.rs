use calib_core::{Rng, Seed};
use calib_files::{Tensor, Tensors};
use calib_nn::{Adam, AdamRule, Mlp, Moments, Workspace};

use super::{
    AgentConfig,
    arrays::{moments_of, named, network_of, progress, progress_of},
};
use crate::{ControlError, Ending, Outcome};

/// Action values that are the outputs of a multilayer perceptron, q(s, ·). It learns by Q-learning from replayed transitions (Mnih et
/// al. 2015).
///
/// Every step draws one batch uniformly from the last `replay` transitions. Adam then steps down the mean of ½(q(s, a) − y)² with y = r +
/// γ max q⁻(s', ·), or y = r at a terminal. Every `target_steps` steps the target network q⁻ becomes a copy of the online one.
#[derive(Clone, Debug)]
pub(super) struct Network {
    online: Mlp,
    target: Mlp,
    adam: Adam,
    /// Workspaces for one state, and for a batch.
    one: Workspace,
    batch: Workspace,
    replay: Replay,
    rng: Rng,
    steps: usize,
    state: Vec<f32>,
    drawn: Drawn,
}

/// The replay buffer: the latest transitions. A new one replaces the oldest.
#[derive(Clone, Debug)]
struct Replay {
    columns: usize,
    most: usize,
    oldest: usize,
    states: Vec<f32>,
    nexts: Vec<f32>,
    taken: Vec<(usize, Outcome)>,
    /// max q⁻(s', ·) of each transition, valid until the target network changes; NaN where it is not computed yet.
    bests: Vec<f32>,
}

/// A batch of replayed transitions.
#[derive(Clone, Debug, Default)]
struct Drawn {
    /// Positions of the transitions in the replay buffer.
    numbers: Vec<usize>,
    states: Vec<f32>,
    /// Transitions whose next state has no known value. `nexts` holds these next states.
    unknown: Vec<usize>,
    nexts: Vec<f32>,
    gradients: Vec<f32>,
}

impl Replay {
    fn keep(&mut self, state: &[f32], action: usize, outcome: Outcome, next: &[f32]) {
        if self.taken.len() < self.most {
            self.states.extend_from_slice(state);
            self.nexts.extend_from_slice(next);
            self.taken.push((action, outcome));
            self.bests.push(f32::NAN);
            return;
        }
        let start = self.oldest * self.columns;
        self.states[start..start + self.columns].copy_from_slice(state);
        self.nexts[start..start + self.columns].copy_from_slice(next);
        self.taken[self.oldest] = (action, outcome);
        self.bests[self.oldest] = f32::NAN;
        self.oldest = (self.oldest + 1) % self.most;
    }

    fn draw(&self, count: usize, rng: &mut Rng, drawn: &mut Drawn) {
        drawn.numbers.clear();
        drawn.states.clear();
        drawn.unknown.clear();
        drawn.nexts.clear();
        for _ in 0..count {
            let number = rng.below(self.taken.len());
            let columns = number * self.columns..(number + 1) * self.columns;
            drawn.numbers.push(number);
            drawn.states.extend_from_slice(&self.states[columns.clone()]);
            let (_, outcome) = self.taken[number];
            if outcome.ending == Ending::Continues && self.bests[number].is_nan() {
                drawn.unknown.push(number);
                drawn.nexts.extend_from_slice(&self.nexts[columns]);
            }
        }
    }

    /// Returns y of a transition whose next state has a known value.
    fn target(&self, number: usize, gamma: f64) -> f64 {
        let (_, outcome) = self.taken[number];
        match outcome.ending {
            Ending::Terminal => outcome.reward,
            Ending::Continues => outcome.reward + gamma * f64::from(self.bests[number]),
        }
    }
}

impl Network {
    pub(super) fn new(config: &AgentConfig, columns: usize, actions: usize, seed: Seed) -> Self {
        let sizes = sizes(config, columns, actions);
        let mut online = Mlp::new(&sizes, seed.child("network"));
        // Values begin near the initial weight, which makes the agent optimistic, as with tiles.
        let bias = online.layers().last().map(|layer| layer.bias.clone()).unwrap_or_default();
        online.parameters_mut()[bias]
            .iter_mut()
            .for_each(|parameter| *parameter += config.initial_weight as f32);
        let rule = AdamRule {
            learning_rate: config.step_size,
            beta1: config.beta1,
            ..AdamRule::default()
        };
        Self {
            adam: Adam::new(rule, online.parameter_count()),
            one: Workspace::new(&online, 1),
            batch: Workspace::new(&online, config.batch),
            target: online.clone(),
            online,
            replay: Replay {
                columns,
                most: config.replay,
                oldest: 0,
                states: Vec::new(),
                nexts: Vec::new(),
                taken: Vec::new(),
                bests: Vec::new(),
            },
            rng: seed.child("replay").rng(),
            steps: 0,
            state: vec![0.0; columns],
            drawn: Drawn::default(),
        }
    }

    pub(super) fn to_tensors(&self) -> Tensors {
        let Moments { mean, square, powers } = self.adam.moments();
        let mut tensors = named(&self.online, "online.");
        tensors.extend(named(&self.target, "target."));
        tensors.extend([Tensor::flat("mean", mean), Tensor::flat("square", square)]);
        let metadata = [progress(&[powers.0, powers.1, self.steps as f64])].into();
        Tensors { tensors, metadata }
    }

    /// Takes over stored networks and moments.
    ///
    /// # Errors
    /// If the tensors belong to another agent.
    pub(super) fn restore(&mut self, tensors: &Tensors) -> Result<(), ControlError> {
        let [one, two, steps] = progress_of(tensors)?;
        let moments = moments_of(tensors, self.online.parameter_count(), (one, two))?;
        self.online = network_of(tensors, "online.", &self.online)?;
        self.target = network_of(tensors, "target.", &self.target)?;
        self.adam = Adam::from_moments(self.adam.rule(), moments);
        self.steps = steps as usize;
        Ok(())
    }

    /// Returns the number of weights and biases of each of the two networks.
    pub(super) fn parameters(config: &AgentConfig, columns: usize, actions: usize) -> usize {
        let sizes = sizes(config, columns, actions);
        sizes.windows(2).map(|layer| (layer[0] + 1) * layer[1]).sum()
    }

    /// Returns the memory of an agent with a full replay buffer, in bytes: both networks, two moments, two gradients, two
    /// transposes, and the buffer.
    pub(super) fn bytes(config: &AgentConfig, columns: usize, actions: usize) -> u64 {
        let parameters = Self::parameters(config, columns, actions);
        let transition = (2 * columns + 1) * size_of::<f32>() + size_of::<(usize, Outcome)>();
        (8 * parameters * size_of::<f32>() + config.replay * transition) as u64
    }

    /// Moves to `state`, and writes its action values to `values`.
    pub(super) fn go_on(&mut self, state: &[f32], values: &mut [f64]) {
        self.state.copy_from_slice(state);
        let outputs = self.online.forward(&self.state, &mut self.one);
        values.iter_mut().zip(outputs).for_each(|(value, &output)| *value = f64::from(output));
    }

    pub(super) fn values_in(&self, state: &[f32], values: &mut [f64]) {
        let mut workspace = Workspace::new(&self.online, 1);
        let outputs = self.online.forward(state, &mut workspace);
        values.iter_mut().zip(outputs).for_each(|(value, &output)| *value = f64::from(output));
    }

    /// Stores the outcome of `action`, learns from a batch, and moves to `next`, whose action values it writes to `values`.
    pub(super) fn learn(
        &mut self,
        config: &AgentConfig,
        action: usize,
        outcome: Outcome,
        next: &[f32],
        values: &mut [f64],
    ) {
        self.replay.keep(&self.state, action, outcome, next);
        if self.replay.taken.len() >= config.batch {
            self.update(config);
            self.steps += 1;
            if self.steps.is_multiple_of(config.target_steps) {
                self.target.clone_from(&self.online);
                self.replay.bests.fill(f32::NAN);
            }
        }
        self.go_on(next, values);
    }

    fn update(&mut self, config: &AgentConfig) {
        let drawn = &mut self.drawn;
        self.replay.draw(config.batch, &mut self.rng, drawn);
        let actions = self.online.outputs();
        if let (&[number], true) = (&drawn.unknown[..], config.batch > 1) {
            // Wide layers sum a single row in another order than several rows.
            drawn.unknown.push(number);
            drawn.nexts.extend_from_within(..);
        }
        let next = self.target.forward(&drawn.nexts, &mut self.batch);
        for (&number, values) in drawn.unknown.iter().zip(next.chunks(actions)) {
            let best = values.iter().copied().fold(f32::NEG_INFINITY, f32::max);
            self.replay.bests[number] = best;
        }
        let outputs = self.online.forward(&drawn.states, &mut self.batch);
        drawn.gradients.clear();
        drawn.gradients.resize(outputs.len(), 0.0);
        for (row, &number) in drawn.numbers.iter().enumerate() {
            let (action, _) = self.replay.taken[number];
            let place = row * actions + action;
            let error = f64::from(outputs[place]) - self.replay.target(number, config.gamma);
            drawn.gradients[place] = (error / config.batch as f64) as f32;
        }
        let gradients = &drawn.gradients;
        self.online.learn(&drawn.states, gradients, &mut self.batch, &mut self.adam);
    }
}

/// Returns the units of each layer: columns first, actions last.
fn sizes(config: &AgentConfig, columns: usize, actions: usize) -> Vec<usize> {
    let hidden = vec![config.hidden_width; config.hidden_layers];
    [vec![columns], hidden, vec![actions]].concat()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_oldest_is_replaced() {
        let states = Vec::new();
        let nexts = Vec::new();
        let taken = Vec::new();
        let bests = Vec::new();
        let mut replay = Replay { columns: 1, most: 3, oldest: 0, states, nexts, taken, bests };
        for number in 0..5 {
            let outcome = Outcome { reward: f64::from(number), ending: Ending::Continues };
            replay.keep(&[number as f32], 0, outcome, &[number as f32 + 1.0]);
        }
        assert_eq!(replay.states, [3.0, 4.0, 2.0]);
        assert_eq!(replay.nexts, [4.0, 5.0, 3.0]);
        let mut drawn = Drawn::default();
        replay.draw(40, &mut Seed::new(1).rng(), &mut drawn);
        let rewards = drawn.numbers.iter().map(|&number| replay.taken[number].1.reward);
        assert!(
            drawn.states.iter().zip(rewards).all(|(&state, reward)| f64::from(state) == reward)
        );
        assert!((2..5).all(|number| drawn.states.contains(&(number as f32))));
    }

    #[test]
    fn next_states_are_valued_once_a_target_network() {
        let states = vec![0.0; 4];
        let nexts = states.clone();
        let outcome = Outcome { reward: 1.0, ending: Ending::Continues };
        let terminal = Outcome { ending: Ending::Terminal, ..outcome };
        let taken = vec![(0, outcome), (0, outcome), (0, terminal), (0, outcome)];
        let bests = vec![2.0, f32::NAN, f32::NAN, 4.0];
        let mut replay = Replay { columns: 1, most: 4, oldest: 3, states, nexts, taken, bests };
        let mut drawn = Drawn::default();
        replay.draw(40, &mut Seed::new(1).rng(), &mut drawn);
        assert!(drawn.unknown.iter().all(|&number| number == 1) && drawn.numbers.contains(&3));
        assert_eq!(drawn.nexts.len(), drawn.unknown.len());
        assert_eq!([0, 2, 3].map(|number| replay.target(number, 0.5)), [2.0, 1.0, 3.0]);
        // Another transition takes its place.
        replay.keep(&[0.0], 0, outcome, &[0.0]);
        assert!(replay.bests[3].is_nan());
    }
}
