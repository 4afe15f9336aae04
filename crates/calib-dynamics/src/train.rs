use calib_core::{Monitor, Seed};
use calib_files::Tensors;
use calib_nn::{Adam, AdamRule, Mlp, Workspace};

use crate::{
    DynamicsConfig, DynamicsError, EpochLoss, FeedForward, Trainer, TrainingRecord, TrainingState,
    Transitioning, pass, seed_of_parameters,
};

/// Fewest rows of a mini-batch of which two threads take a half each.
const WORTH_SHARING: usize = 64;

/// Trains a [`FeedForward`] network: mean squared error of the next state over transitions and columns, Adam, shuffled
/// mini-batches (the last one of an epoch may be smaller).
///
/// A mini-batch is cut into two halves whose gradients are added, always the same way, so that the result does not
/// depend on the number of threads.
#[derive(Debug)]
pub struct FeedForwardTrainer<'a> {
    data: Transitioning<'a>,
    config: DynamicsConfig,
    seed: Seed,
    network: Mlp,
    adam: Adam,
    kept: Vec<f32>,
    record: TrainingRecord,
    halves: [Half; 2],
}

/// Buffers of half a mini-batch.
#[derive(Debug)]
struct Half {
    inputs: Vec<f32>,
    targets: Vec<f32>,
    gradient: Vec<f32>,
    workspace: Workspace,
}

impl<'a> FeedForwardTrainer<'a> {
    /// Training from the start: parameters as [`Mlp::new`] draws them.
    pub fn new(data: &Transitioning<'a>, config: &DynamicsConfig, seed: Seed) -> Self {
        let mut sizes = vec![config.hidden_units; config.hidden_layers + 2];
        sizes[0] = data.columns();
        sizes[config.hidden_layers + 1] = data.columns();
        let network = Mlp::new(&sizes, seed_of_parameters(seed));
        let rule = AdamRule { learning_rate: config.learning_rate, ..AdamRule::default() };
        let adam = Adam::new(rule, network.parameter_count());
        Self::with(*data, config.clone(), seed, network, adam, TrainingRecord::default())
    }

    fn with(
        data: Transitioning<'a>,
        config: DynamicsConfig,
        seed: Seed,
        network: Mlp,
        adam: Adam,
        record: TrainingRecord,
    ) -> Self {
        let rows = config.batch_size.div_ceil(2).max(WORTH_SHARING);
        let half = || Half {
            inputs: Vec::new(),
            targets: Vec::new(),
            gradient: Vec::new(),
            workspace: Workspace::new(&network, rows),
        };
        let halves = [half(), half()];
        let kept = network.parameters().to_vec();
        Self { data, config, seed, network, adam, kept, record, halves }
    }

    /// Go on where [`checkpoint`](Trainer::checkpoint) was taken, with the same data, configuration and seed.
    ///
    /// # Errors
    /// If the checkpoint is not one of such a training.
    pub fn resume(
        data: &Transitioning<'a>,
        config: &DynamicsConfig,
        seed: Seed,
        checkpoint: &Tensors,
    ) -> Result<Self, DynamicsError> {
        let mut trainer = Self::new(data, config, seed);
        let count = trainer.network.parameter_count();
        let state = TrainingState::from_tensors(checkpoint, count)?;
        trainer.network.parameters_mut().copy_from_slice(&state.parameters);
        trainer.adam = Adam::from_moments(trainer.adam.rule(), state.moments);
        trainer.kept = state.kept;
        trainer.record = state.record;
        Ok(trainer)
    }

    /// The network as it is now.
    pub fn network(&self) -> &Mlp {
        &self.network
    }

    /// The model of the weights that are kept.
    pub fn model(&self) -> FeedForward {
        let mut network = self.network.clone();
        network.parameters_mut().copy_from_slice(&self.kept);
        FeedForward::new(network).unwrap_or_else(|_| unreachable!("made for states"))
    }

    /// One update on these transitions; the mean squared error before it.
    pub fn update(&mut self, transitions: &[u32]) -> f64 {
        let squares = self.losses(transitions, Pass::Gradients);
        let [first, second] = &mut self.halves;
        let cut = cut(transitions.len());
        let gradients = if cut < transitions.len() {
            let (first, second) =
                (first.workspace.gradients_mut(), second.workspace.gradients_mut());
            for (sum, other) in first.iter_mut().zip(second) {
                *sum += *other;
            }
            first
        } else {
            first.workspace.gradients_mut()
        };
        self.adam.step(self.network.parameters_mut(), gradients);
        self.record.updates += 1;
        squares / (transitions.len() * self.data.columns()) as f64
    }

    /// The sum of squared errors; with [`Pass::Gradients`] the halves hold the gradients of their share of the mean.
    fn losses(&mut self, transitions: &[u32], pass: Pass) -> f64 {
        let scale = 2.0 / (transitions.len() * self.data.columns()) as f32;
        let (data, network) = (&self.data, &self.network);
        let run = |half: &mut Half, transitions: &[u32]| {
            let Half { inputs, targets, gradient, workspace } = half;
            data.gather(transitions, inputs, targets);
            let outputs = network.forward(inputs, workspace);
            let errors = outputs.iter().zip(targets.iter()).map(|(output, target)| output - target);
            gradient.clear();
            gradient.extend(errors);
            let squares: f64 = gradient.iter().map(|&error| f64::from(error).powi(2)).sum();
            if pass == Pass::Gradients {
                for error in gradient.iter_mut() {
                    *error *= scale;
                }
                network.backward(inputs, gradient, workspace);
            }
            squares
        };
        let (mine, theirs) = transitions.split_at(cut(transitions.len()));
        let [first, second] = &mut self.halves;
        if theirs.is_empty() {
            return run(first, mine);
        }
        let (a, b) = rayon::join(|| run(first, mine), || run(second, theirs));
        a + b
    }

    /// Mean squared error over the validation part.
    fn validate(&mut self) -> f64 {
        let part: Vec<u32> = self.data.validation().map(|i| i as u32).collect();
        let batch = self.config.batch_size.max(WORTH_SHARING);
        let squares: f64 = part.chunks(batch).map(|batch| self.losses(batch, Pass::LossOnly)).sum();
        squares / (part.len() * self.data.columns()) as f64
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Pass {
    LossOnly,
    Gradients,
}

/// Rows of a mini-batch that the first half takes.
fn cut(rows: usize) -> usize {
    if rows < WORTH_SHARING { rows } else { rows.div_ceil(2) }
}

impl Trainer for FeedForwardTrainer<'_> {
    fn updates_per_epoch(&self) -> usize {
        self.data.training().len().div_ceil(self.config.batch_size)
    }

    fn record(&self) -> &TrainingRecord {
        &self.record
    }

    fn epoch(&mut self, monitor: &dyn Monitor) -> Result<EpochLoss, DynamicsError> {
        let items = self.data.training().map(|transition| transition as u32);
        let epoch = (self.seed, self.record.epochs.len());
        let batch_size = self.config.batch_size;
        let training = pass(items, epoch, batch_size, monitor, |batch| Ok(self.update(batch)))?;
        let loss = EpochLoss { training, validation: self.validate() };
        if self.record.push(loss, &self.config)? {
            self.kept.copy_from_slice(self.network.parameters());
        }
        Ok(loss)
    }

    fn checkpoint(&self) -> Result<Tensors, DynamicsError> {
        let state = TrainingState {
            parameters: self.network.parameters().to_vec(),
            kept: self.kept.clone(),
            moments: self.adam.moments(),
            record: self.record.clone(),
        };
        Ok(state.into_tensors())
    }

    fn weights(&self) -> Result<Tensors, DynamicsError> {
        Ok(self.model().to_tensors())
    }
}

#[cfg(test)]
mod tests;
