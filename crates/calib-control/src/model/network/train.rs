use calib_core::{Monitor, Seed, TransitionIndex};
use calib_knn::Blocks;
use calib_nn::{Adam, AdamRule, Mlp, Workspace};

use super::NetworkConfig;
use crate::{ControlError, Decisions, Ending};

/// Means, scales and ranges of the states, changes and rewards of a log.
#[derive(Clone, Debug)]
pub(super) struct Scales {
    pub(super) columns: Vec<Column>,
    pub(super) reward: Scale,
    pub(super) actions: usize,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Column {
    pub(super) values: Scale,
    /// Root mean square of the changes.
    pub(super) change: f32,
}

/// Mean, standard deviation and range of some values. A standard deviation of 0 becomes 1, so that constant values are scaled to 0.
#[derive(Clone, Copy, Debug)]
pub(super) struct Scale {
    pub(super) mean: f32,
    pub(super) std: f32,
    pub(super) lowest: f32,
    pub(super) highest: f32,
}

impl Scale {
    fn of_values(values: impl Iterator<Item = f32> + Clone) -> Self {
        let wide = values.clone().map(f64::from);
        let count = wide.clone().count() as f64;
        let mean = wide.clone().sum::<f64>() / count;
        let variance = wide.map(|value| (value - mean).powi(2)).sum::<f64>() / count;
        Self {
            mean: mean as f32,
            std: unless_zero(variance.sqrt() as f32),
            lowest: values.clone().fold(f32::INFINITY, f32::min),
            highest: values.fold(f32::NEG_INFINITY, f32::max),
        }
    }
}

fn unless_zero(spread: f32) -> f32 {
    if spread > 1e-6 { spread } else { 1.0 }
}

impl Scales {
    pub(super) fn new(log: &Decisions) -> Self {
        let all = (0..log.len()).map(TransitionIndex::new);
        Self {
            columns: (0..log.states().columns())
                .map(|column: usize| {
                    let values =
                        all.clone().flat_map(move |at| log.ends(at).map(|state| state[column]));
                    let squares = all.clone().map(|at| {
                        let [from, to] = log.ends(at);
                        f64::from(to[column] - from[column]).powi(2)
                    });
                    let change =
                        unless_zero((squares.sum::<f64>() / log.len() as f64).sqrt() as f32);
                    Column { values: Scale::of_values(values), change }
                })
                .collect(),
            reward: Scale::of_values(log.rewards().iter().copied()),
            actions: log.levels(),
        }
    }

    /// Writes the input of a network.
    pub(super) fn put_input(&self, state: &[f32], action: usize, input: &mut [f32]) {
        let (scaled, actions) = input.split_at_mut(self.columns.len());
        for ((scaled, value), column) in scaled.iter_mut().zip(state).zip(&self.columns) {
            *scaled = (value - column.values.mean) / column.values.std;
        }
        actions.fill(0.0);
        actions[action] = 1.0;
    }

    /// Writes the target of a network.
    fn put_target(&self, log: &Decisions, number: usize, target: &mut [f32]) {
        let [from, to] = log.ends(TransitionIndex::new(number));
        for (place, column) in self.columns.iter().enumerate() {
            target[place] = (to[place] - from[place]) / column.change;
        }
        let width = self.columns.len();
        target[width] = (log.rewards()[number] - self.reward.mean) / self.reward.std;
        target[width + 1] = f32::from(u8::from(log.endings()[number] == Ending::Terminal));
    }
}

/// Inputs and targets of transitions, row by row.
struct Examples {
    inputs: Vec<f32>,
    targets: Vec<f32>,
    /// Widths of an input and a target.
    widths: [usize; 2],
}

impl Examples {
    fn new(log: &Decisions, scales: &Scales, transitions: impl Iterator<Item = usize>) -> Self {
        let widths = [scales.columns.len() + scales.actions, scales.columns.len() + 2];
        // A growing vector would take up to three times as much memory for a moment, in every network at once.
        let [mut inputs, mut targets] =
            widths.map(|width| Vec::with_capacity(transitions.size_hint().0 * width));
        let mut input = vec![0.0; widths[0]];
        let mut target = vec![0.0; widths[1]];
        for number in transitions {
            let [from, _] = log.ends(TransitionIndex::new(number));
            scales.put_input(from, usize::from(log.actions()[number]), &mut input);
            scales.put_target(log, number, &mut target);
            inputs.extend_from_slice(&input);
            targets.extend_from_slice(&target);
        }
        Self { inputs, targets, widths }
    }

    fn len(&self) -> usize {
        self.inputs.len() / self.widths[0]
    }

    fn put(&self, row: usize, inputs: &mut Vec<f32>, targets: &mut Vec<f32>) {
        let [input, target] = self.widths;
        inputs.extend_from_slice(&self.inputs[row * input..][..input]);
        targets.extend_from_slice(&self.targets[row * target..][..target]);
    }
}

/// Returns the loss of one row, and writes its gradient: ½ Σ (y − ŷ)² for changes and reward, and the cross-entropy
/// for the terminal.
fn loss(output: &[f32], target: &[f32], gradient: &mut [f32]) -> f64 {
    let last = output.len() - 1;
    let mut sum = 0.0;
    for place in 0..last {
        gradient[place] = output[place] - target[place];
        sum += 0.5 * f64::from(gradient[place]).powi(2);
    }
    let odds = f64::from(output[last]);
    let ended = f64::from(target[last]);
    gradient[last] = (1.0 / (1.0 + (-odds).exp()) - ended) as f32;
    // Computes ln(1 + e^x) − y x without overflow.
    sum + odds.max(0.0) + (-odds.abs()).exp().ln_1p() - ended * odds
}

/// Returns the mean loss of `examples`. It is not finite if the network is not.
fn mean_loss(network: &Mlp, examples: &Examples, workspace: &mut Workspace, rows: usize) -> f64 {
    let [input, target] = examples.widths;
    let mut gradient = vec![0.0; target];
    let mut sum = 0.0;
    let batches = examples.inputs.chunks(rows * input).zip(examples.targets.chunks(rows * target));
    for (inputs, targets) in batches {
        let outputs = network.forward(inputs, workspace);
        for (output, target) in outputs.chunks(target).zip(targets.chunks(target)) {
            sum += loss(output, target, &mut gradient);
        }
    }
    sum / examples.len().max(1) as f64
}

/// Trains the network of an ensemble member. Of the networks after each part of the updates, it returns the one that predicts the
/// left-out block best.
///
/// # Errors
/// If there are no transitions to train on or to validate with, no network was finite after a part, or the monitor interrupts.
pub(super) fn train(
    log: &Decisions,
    scales: &Scales,
    (blocks, member): (&Blocks, usize),
    config: &NetworkConfig,
    seed: Seed,
    monitor: &dyn Monitor,
) -> Result<Mlp, ControlError> {
    let known = blocks.transitions_of(member).map(TransitionIndex::get);
    let known = Examples::new(log, scales, known);
    let held_back = blocks.own(member).map(|transition| transition as usize);
    let held_back = Examples::new(log, scales, held_back);
    if known.len() == 0 || held_back.len() == 0 {
        return Err(ControlError::FewTransitions { members: config.members });
    }
    let outputs = known.widths[1];
    let mut network = Mlp::new(&config.sizes(scales.columns.len(), scales.actions), seed);
    let rule = AdamRule { learning_rate: config.learning_rate, ..AdamRule::default() };
    let mut adam = Adam::new(rule, network.parameter_count());
    let mut workspace = Workspace::new(&network, config.batch);
    let mut rng = seed.child("batches").rng();
    let mut best: Option<(f64, Mlp)> = None;
    let every = config.updates.div_ceil(NetworkConfig::CHECKS);
    let mut batch = Vec::new();
    let mut targets = Vec::new();
    let mut gradient = vec![0.0; config.batch * outputs];
    for update in 1..=config.updates {
        monitor.check()?;
        batch.clear();
        targets.clear();
        for _ in 0..config.batch {
            known.put(rng.below(known.len()), &mut batch, &mut targets);
        }
        let said = network.forward(&batch, &mut workspace).chunks(outputs);
        for ((output, target), own) in
            said.zip(targets.chunks(outputs)).zip(gradient.chunks_mut(outputs))
        {
            loss(output, target, own);
            for derivative in own {
                *derivative /= config.batch as f32;
            }
        }
        let gradients = network.backward(&batch, &gradient, &mut workspace);
        adam.step(network.parameters_mut(), gradients);
        if update.is_multiple_of(every) || update == config.updates {
            let loss = mean_loss(&network, &held_back, &mut workspace, config.batch);
            let is_better = best.as_ref().is_none_or(|best| loss < best.0);
            if loss.is_finite() && is_better {
                best = Some((loss, network.clone()));
            }
        }
        monitor.advance(1);
    }
    best.map(|best| best.1).ok_or(ControlError::NetworkDiverged { member })
}
