use calib_core::{Monitor, Seed};
use calib_files::Tensors;
use calib_nn::{Adam, AdamRule, Mlp, Workspace};

use crate::{
    DynamicsConfig, DynamicsError, EpochLoss, FeedForward, Trainer, TrainingRecord, TrainingState,
    Transitioning, pass, seed_of_parameters,
};

/// Minimum number of items in a mini-batch that is shared by two threads.
const WORTH_SHARING: usize = 64;

/// A network and its training data. Items are transitions, or first transitions of sequences.
pub trait Learnable: Sync {
    /// The buffers of a pass, and its gradient.
    type Workspace: Send;

    /// Creates buffers for up to `items` items.
    fn workspace(&self, items: usize) -> Self::Workspace;

    /// Returns the number of predicted values per item.
    fn outputs_per_item(&self) -> usize;

    /// Returns the sum of squared errors over the items. If there is a scale, also computes the gradient of half the sum times the scale.
    fn squared_error(
        &self,
        parameters: &[f32],
        items: &[u32],
        scale: Option<f32>,
        workspace: &mut Self::Workspace,
    ) -> f64;

    /// Returns the gradient of the last pass.
    fn gradient<'w>(&self, workspace: &'w mut Self::Workspace) -> &'w mut [f32];

    /// Returns the parameters with their names.
    fn weights(&self, parameters: &[f32]) -> Tensors;
}

/// The items for training and for validation.
#[derive(Clone, Debug)]
pub(crate) struct Parts {
    pub(crate) training: Vec<u32>,
    pub(crate) validation: Vec<u32>,
}

/// Trains a network on this machine's CPU: Adam on the mean squared error, with shuffled mini-batches. The last batch of an epoch may be
/// smaller.
///
/// A mini-batch is always split into the same two halves, whose gradients are added. So the result does not depend on the number of
/// threads.
#[derive(Debug)]
pub struct NativeTrainer<L: Learnable> {
    learnable: L,
    config: DynamicsConfig,
    seed: Seed,
    parts: Parts,
    parameters: Vec<f32>,
    adam: Adam,
    kept: Vec<f32>,
    record: TrainingRecord,
    halves: [L::Workspace; 2],
}

impl<L: Learnable> NativeTrainer<L> {
    /// Starts training with these parameters.
    pub(crate) fn with(
        learnable: L,
        config: &DynamicsConfig,
        seed: Seed,
        parts: Parts,
        parameters: Vec<f32>,
    ) -> Self {
        let rule = AdamRule { learning_rate: config.learning_rate, ..AdamRule::default() };
        let items = config.batch_size.div_ceil(2).max(WORTH_SHARING);
        Self {
            halves: [learnable.workspace(items), learnable.workspace(items)],
            learnable,
            config: config.clone(),
            seed,
            parts,
            adam: Adam::new(rule, parameters.len()),
            kept: parameters.clone(),
            parameters,
            record: TrainingRecord::default(),
        }
    }

    /// Returns the training as it was at this [`checkpoint`](Trainer::checkpoint). Data, configuration and seed must be the same.
    ///
    /// # Errors
    /// If the checkpoint does not belong to such training.
    pub fn resumed(mut self, checkpoint: &Tensors) -> Result<Self, DynamicsError> {
        let state = TrainingState::from_tensors(checkpoint, self.parameters.len())?;
        self.parameters = state.parameters;
        self.adam = Adam::from_moments(self.adam.rule(), state.moments);
        self.kept = state.kept;
        self.record = state.record;
        Ok(self)
    }

    pub(crate) fn learnable(&self) -> &L {
        &self.learnable
    }

    pub(crate) fn parameters(&self) -> &[f32] {
        &self.parameters
    }

    /// Makes one update on these items. Returns the mean squared error before it.
    pub fn update(&mut self, items: &[u32]) -> f64 {
        let scale = 2.0 / (items.len() * self.learnable.outputs_per_item()) as f32;
        let squares = self.squared_error(items, Some(scale));
        let [first, second] = &mut self.halves;
        let gradient = self.learnable.gradient(first);
        if cut(items.len()) < items.len() {
            for (sum, other) in gradient.iter_mut().zip(self.learnable.gradient(second)) {
                *sum += *other;
            }
        }
        self.adam.step(&mut self.parameters, gradient);
        self.record.updates += 1;
        squares / (items.len() * self.learnable.outputs_per_item()) as f64
    }

    /// Returns the sum of squared errors. If there is a scale, each half computes the gradient of its share.
    fn squared_error(&mut self, items: &[u32], scale: Option<f32>) -> f64 {
        let learnable = &self.learnable;
        let parameters = &self.parameters[..];
        let (mine, theirs) = items.split_at(cut(items.len()));
        let [first, second] = &mut self.halves;
        if theirs.is_empty() {
            return learnable.squared_error(parameters, mine, scale, first);
        }
        let (a, b) = rayon::join(
            || learnable.squared_error(parameters, mine, scale, first),
            || learnable.squared_error(parameters, theirs, scale, second),
        );
        a + b
    }

    fn validate(&mut self) -> f64 {
        let items = std::mem::take(&mut self.parts.validation);
        let batch = self.config.batch_size.max(WORTH_SHARING);
        let squares: f64 = items.chunks(batch).map(|batch| self.squared_error(batch, None)).sum();
        let count = items.len() * self.learnable.outputs_per_item();
        self.parts.validation = items;
        squares / count as f64
    }
}

/// Returns the number of items in the first half of a mini-batch.
fn cut(items: usize) -> usize {
    if items < WORTH_SHARING { items } else { items.div_ceil(2) }
}

impl<L: Learnable> Trainer for NativeTrainer<L> {
    fn updates_per_epoch(&self) -> usize {
        self.parts.training.len().div_ceil(self.config.batch_size)
    }

    fn record(&self) -> &TrainingRecord {
        &self.record
    }

    fn epoch(&mut self, monitor: &dyn Monitor) -> Result<EpochLoss, DynamicsError> {
        let items = self.parts.training.clone().into_iter();
        let epoch = (self.seed, self.record.epochs.len());
        let batch_size = self.config.batch_size;
        let training = pass(items, epoch, batch_size, monitor, |batch| Ok(self.update(batch)))?;
        let loss = EpochLoss { training, validation: self.validate() };
        if self.record.push(loss, &self.config)? {
            self.kept.copy_from_slice(&self.parameters);
        }
        Ok(loss)
    }

    fn checkpoint(&self) -> Result<Tensors, DynamicsError> {
        let state = TrainingState {
            parameters: self.parameters.clone(),
            kept: self.kept.clone(),
            moments: self.adam.moments(),
            record: self.record.clone(),
        };
        Ok(state.into_tensors())
    }

    fn weights(&self) -> Result<Tensors, DynamicsError> {
        Ok(self.learnable.weights(&self.kept))
    }
}

/// Trains a [`FeedForward`] network on the mean squared error of the next state, over transitions and columns.
pub type FeedForwardTrainer<'a> = NativeTrainer<NextState<'a>>;

/// A feed-forward network and its training transitions.
#[derive(Debug)]
pub struct NextState<'a> {
    data: Transitioning<'a>,
    /// The shape of the network. Its parameters are the initial ones.
    network: Mlp,
}

/// Buffers for some transitions of a mini-batch.
#[derive(Debug)]
pub struct NextStateWorkspace {
    inputs: Vec<f32>,
    targets: Vec<f32>,
    errors: Vec<f32>,
    network: Mlp,
    workspace: Workspace,
}

impl Learnable for NextState<'_> {
    type Workspace = NextStateWorkspace;

    fn workspace(&self, items: usize) -> NextStateWorkspace {
        NextStateWorkspace {
            inputs: Vec::new(),
            targets: Vec::new(),
            errors: Vec::new(),
            network: self.network.clone(),
            workspace: Workspace::new(&self.network, items),
        }
    }

    fn outputs_per_item(&self) -> usize {
        self.data.columns()
    }

    fn squared_error(
        &self,
        parameters: &[f32],
        items: &[u32],
        scale: Option<f32>,
        workspace: &mut NextStateWorkspace,
    ) -> f64 {
        let NextStateWorkspace { inputs, targets, errors, network, workspace } = workspace;
        network.parameters_mut().copy_from_slice(parameters);
        self.data.gather(items, inputs, targets);
        let outputs = network.forward(inputs, workspace);
        errors.clear();
        errors.extend(outputs.iter().zip(targets.iter()).map(|(output, target)| output - target));
        let squares: f64 = errors.iter().map(|&error| f64::from(error).powi(2)).sum();
        if let Some(scale) = scale {
            for error in errors.iter_mut() {
                *error *= scale;
            }
            network.backward(inputs, errors, workspace);
        }
        squares
    }

    fn gradient<'w>(&self, workspace: &'w mut NextStateWorkspace) -> &'w mut [f32] {
        workspace.workspace.gradients_mut()
    }

    fn weights(&self, parameters: &[f32]) -> Tensors {
        self.model(parameters).to_tensors()
    }
}

impl NextState<'_> {
    fn model(&self, parameters: &[f32]) -> FeedForward {
        let mut network = self.network.clone();
        network.parameters_mut().copy_from_slice(parameters);
        FeedForward::new(network).unwrap_or_else(|_| unreachable!("made for states"))
    }
}

impl<'a> FeedForwardTrainer<'a> {
    /// Starts training with parameters drawn by [`Mlp::new`].
    pub fn new(data: &Transitioning<'a>, config: &DynamicsConfig, seed: Seed) -> Self {
        let mut sizes = vec![config.hidden_units; config.hidden_layers + 2];
        sizes[0] = data.columns();
        sizes[config.hidden_layers + 1] = data.columns();
        let network = Mlp::new(&sizes, seed_of_parameters(seed));
        let parameters = network.parameters().to_vec();
        let parts = Parts {
            training: data.training().map(|transition| transition as u32).collect(),
            validation: data.validation().map(|transition| transition as u32).collect(),
        };
        Self::with(NextState { data: *data, network }, config, seed, parts, parameters)
    }

    /// Returns the current network.
    pub fn network(&self) -> Mlp {
        self.learnable.model(&self.parameters).network().clone()
    }

    /// Returns the model of the weights that are kept.
    pub fn model(&self) -> FeedForward {
        self.learnable.model(&self.kept)
    }
}

#[cfg(test)]
mod tests;
