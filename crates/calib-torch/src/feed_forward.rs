use std::ops::Range;

use calib_core::{Monitor, Seed};
use calib_dynamics::{
    DynamicsConfig, DynamicsError, EpochLoss, FeedForward, Trainer, TrainingRecord, Transitioning,
    seed_of_parameters,
};
use calib_files::Tensors;
use calib_nn::Mlp;
use tch::{Device, Reduction, Tensor};

use crate::{
    TorchError,
    trainer::{Epochs, Network, parts},
};

/// Trains the NN baseline through libtorch, with the same initial parameters and mini-batches as
/// [`calib_dynamics::FeedForwardTrainer`].
pub struct FeedForwardTrainer {
    epochs: Epochs<OneStep>,
    start: Mlp,
}

/// A network of fully connected layers. The parameters are `[inputs, outputs]` weights and biases,
/// layer after layer.
pub(crate) struct Layers {
    shapes: Vec<Vec<i64>>,
}

/// Layers and their training transitions.
struct OneStep {
    layers: Layers,
    /// The source row of each transition.
    sources: Vec<u32>,
}

impl Layers {
    pub(crate) fn of(network: &Mlp) -> Self {
        let shapes = network.layers().iter();
        let shapes = shapes.flat_map(|layer| {
            let inputs = layer.inputs as i64;
            let outputs = layer.outputs as i64;
            [vec![inputs, outputs], vec![outputs]]
        });
        Self { shapes: shapes.collect() }
    }

    /// Returns the outputs, `[rows, outputs]`.
    pub(crate) fn forward(&self, parameters: &Tensor, input: &Tensor) -> Tensor {
        let parts = parts(parameters, &self.shapes);
        let last = parts.len() / 2 - 1;
        let mut hidden = input.shallow_clone();
        for (number, layer) in parts.chunks_exact(2).enumerate() {
            hidden = hidden.matmul(&layer[0]) + &layer[1];
            if number < last {
                hidden = hidden.relu();
            }
        }
        hidden
    }
}

impl Network for OneStep {
    fn loss(&self, parameters: &Tensor, states: &Tensor, batch: &[u32]) -> Tensor {
        let rows = batch.iter().map(|&transition| i64::from(self.sources[transition as usize]));
        let rows = Tensor::from_slice(&rows.collect::<Vec<i64>>()).to_device(states.device());
        let outputs = self.layers.forward(parameters, &states.index_select(0, &rows));
        outputs.mse_loss(&states.index_select(0, &(rows + 1)), Reduction::Mean)
    }
}

impl FeedForwardTrainer {
    /// Starts training.
    pub fn new(
        data: &Transitioning<'_>,
        config: &DynamicsConfig,
        seed: Seed,
        device: Device,
    ) -> Self {
        let mut sizes = vec![config.hidden_units; config.hidden_layers + 2];
        sizes[0] = data.columns();
        sizes[config.hidden_layers + 1] = data.columns();
        let start = Mlp::new(&sizes, seed_of_parameters(seed));
        let sources = data.transitions().sources().to_vec();
        let parts = (numbers(data.training()), numbers(data.validation()));
        let network = OneStep { layers: Layers::of(&start), sources };
        let epochs =
            Epochs::new(network, config, seed, data.states(), parts, start.parameters(), device);
        Self { epochs, start }
    }

    /// Resumes training from a [`checkpoint`](Trainer::checkpoint).
    ///
    /// # Errors
    /// If the checkpoint does not belong to such training.
    pub fn resume(
        data: &Transitioning<'_>,
        config: &DynamicsConfig,
        seed: Seed,
        device: Device,
        checkpoint: &Tensors,
    ) -> Result<Self, DynamicsError> {
        let mut trainer = Self::new(data, config, seed, device);
        trainer.epochs.resume(checkpoint)?;
        Ok(trainer)
    }

    /// Makes one update on these transitions. Returns the mean squared error before it.
    ///
    /// # Errors
    /// If libtorch fails.
    pub fn update(&mut self, transitions: &[u32]) -> Result<f64, TorchError> {
        self.epochs.update(transitions)
    }

    /// Returns all parameters, in the order of [`Mlp::parameters`].
    ///
    /// # Errors
    /// If libtorch fails.
    pub fn parameters(&self) -> Result<Vec<f32>, TorchError> {
        self.epochs.parameters()
    }
}

/// Returns the numbers of a range of transitions.
fn numbers(transitions: Range<usize>) -> Vec<u32> {
    transitions.map(|number| number as u32).collect()
}

impl Trainer for FeedForwardTrainer {
    fn updates_per_epoch(&self) -> usize {
        self.epochs.updates_per_epoch()
    }

    fn record(&self) -> &TrainingRecord {
        &self.epochs.record
    }

    fn epoch(&mut self, monitor: &dyn Monitor) -> Result<EpochLoss, DynamicsError> {
        self.epochs.epoch(monitor)
    }

    fn checkpoint(&self) -> Result<Tensors, DynamicsError> {
        self.epochs.checkpoint()
    }

    fn weights(&self) -> Result<Tensors, DynamicsError> {
        let mut network = self.start.clone();
        network.parameters_mut().copy_from_slice(self.epochs.kept());
        Ok(FeedForward::new(network)?.to_tensors())
    }
}
