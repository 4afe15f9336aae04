//! The common part of training by epochs, for any network.

use calib_core::{Monitor, Seed};
use calib_dynamics::{
    DynamicsConfig, DynamicsError, EpochLoss, TrainingRecord, TrainingState, pass,
};
use calib_files::Tensors;
use calib_nn::AdamRule;
use tch::{Device, Kind, TchError, Tensor, no_grad};

use crate::{
    TorchError,
    adam::{Adam, values},
};

/// A network whose parameters are one flat vector.
pub(crate) trait Network {
    /// Returns the mean squared error on a mini-batch of transitions, or of sequences, which are
    /// named by their first transition.
    fn loss(&self, parameters: &Tensor, states: &Tensor, batch: &[u32]) -> Tensor;
}

/// Training of a network on states. Transitions name the training items.
pub(crate) struct Epochs<N> {
    pub(crate) network: N,
    config: DynamicsConfig,
    seed: Seed,
    states: Tensor,
    /// The transitions, or first transitions of sequences, for training and for validation.
    training: Vec<u32>,
    validation: Vec<u32>,
    parameters: Tensor,
    adam: Adam,
    kept: Vec<f32>,
    pub(crate) record: TrainingRecord,
}

impl<N: Network> Epochs<N> {
    pub(crate) fn new(
        network: N,
        config: &DynamicsConfig,
        seed: Seed,
        states: &calib_core::States,
        parts: (Vec<u32>, Vec<u32>),
        parameters: &[f32],
        device: Device,
    ) -> Self {
        let shape = [states.rows() as i64, states.columns() as i64];
        let states = Tensor::from_slice(states.as_slice()).view(shape).to_device(device);
        let kept = parameters.to_vec();
        let parameters = leaf(parameters, device);
        let rule = rule(config);
        let adam = Adam::new(rule, &parameters);
        let (training, validation) = parts;
        let record = TrainingRecord::default();
        let config = config.clone();
        Self { network, config, seed, states, training, validation, parameters, adam, kept, record }
    }

    pub(crate) fn resume(&mut self, checkpoint: &Tensors) -> Result<(), DynamicsError> {
        let state = TrainingState::from_tensors(checkpoint, self.kept.len())?;
        let device = self.parameters.device();
        self.parameters = leaf(&state.parameters, device);
        self.adam = Adam::from_moments(rule(&self.config), &state.moments, device);
        self.kept = state.kept;
        self.record = state.record;
        Ok(())
    }

    pub(crate) fn updates_per_epoch(&self) -> usize {
        self.training.len().div_ceil(self.config.batch_size)
    }

    /// Makes one update. Returns the loss before it.
    pub(crate) fn update(&mut self, batch: &[u32]) -> Result<f64, TorchError> {
        let loss = self.loss(batch);
        loss.f_backward()?;
        self.adam.step(&mut self.parameters);
        self.record.updates += 1;
        Ok(f64::try_from(&loss.to_kind(Kind::Double))?)
    }

    fn loss(&self, batch: &[u32]) -> Tensor {
        self.network.loss(&self.parameters, &self.states, batch)
    }

    pub(crate) fn epoch(&mut self, monitor: &dyn Monitor) -> Result<EpochLoss, DynamicsError> {
        let items = self.training.clone().into_iter();
        let epoch = (self.seed, self.record.epochs.len());
        let batch_size = self.config.batch_size;
        let training = pass(items, epoch, batch_size, monitor, |batch| Ok(self.update(batch)?))?;
        let validation = no_grad(|| self.validate()).map_err(TorchError::from)?;
        let loss = EpochLoss { training, validation };
        if self.record.push(loss, &self.config)? {
            self.kept = values(&self.parameters).map_err(TorchError::from)?;
        }
        Ok(loss)
    }

    fn validate(&self) -> Result<f64, TchError> {
        let mut sum = 0.0;
        for batch in self.validation.chunks(self.config.batch_size) {
            sum += f64::try_from(&self.loss(batch).to_kind(Kind::Double))? * batch.len() as f64;
        }
        Ok(sum / self.validation.len() as f64)
    }

    /// Returns the current parameters.
    pub(crate) fn parameters(&self) -> Result<Vec<f32>, TorchError> {
        Ok(values(&self.parameters)?)
    }

    /// Returns the parameters that are kept.
    pub(crate) fn kept(&self) -> &[f32] {
        &self.kept
    }

    pub(crate) fn checkpoint(&self) -> Result<Tensors, DynamicsError> {
        let state = TrainingState {
            parameters: self.parameters()?,
            kept: self.kept.clone(),
            moments: self.adam.moments().map_err(TorchError::from)?,
            record: self.record.clone(),
        };
        Ok(state.into_tensors())
    }
}

fn rule(config: &DynamicsConfig) -> AdamRule {
    AdamRule { learning_rate: config.learning_rate, ..AdamRule::default() }
}

/// Creates a flat vector for which libtorch computes gradients.
pub(crate) fn leaf(values: &[f32], device: Device) -> Tensor {
    Tensor::from_slice(values).to_device(device).set_requires_grad(true)
}

/// Returns consecutive parts of a flat vector, each in its shape.
pub(crate) fn parts(flat: &Tensor, shapes: &[Vec<i64>]) -> Vec<Tensor> {
    let lengths: Vec<i64> = shapes.iter().map(|shape| shape.iter().product()).collect();
    let parts = flat.split_with_sizes(lengths.as_slice(), 0);
    parts.iter().zip(shapes).map(|(part, shape)| part.view(shape.as_slice())).collect()
}
