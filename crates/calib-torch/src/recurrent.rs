use calib_core::{Monitor, Seed};
use calib_dynamics::{
    DynamicsConfig, DynamicsError, EpochLoss, Recurrent, Trainer, TrainingRecord, Transitioning,
    seed_of_parameters, sequences,
};
use calib_files::Tensors;
use tch::{Device, Reduction, Tensor};

use crate::{
    TorchError,
    trainer::{Epochs, Network, parts},
};

/// Trains the GRU baseline on the mean squared error of every next state of a sequence, by back-propagation through
/// the whole sequence. Each sequence begins with an empty hidden state (burn-in 0, the paper).
pub struct RecurrentTrainer {
    epochs: Epochs<Sequences>,
    start: Recurrent,
}

struct Sequences {
    shapes: Vec<Vec<i64>>,
    layers: i64,
    hidden: i64,
    length: i64,
    /// The source row of each transition.
    sources: Vec<u32>,
}

impl Network for Sequences {
    fn loss(&self, parameters: &Tensor, states: &Tensor, batch: &[u32]) -> Tensor {
        let device = states.device();
        let columns = states.size()[1];
        let first = batch.iter().map(|&transition| i64::from(self.sources[transition as usize]));
        let first = first.collect::<Vec<i64>>();
        let offsets = Tensor::arange(self.length, (tch::Kind::Int64, Device::Cpu));
        let rows = Tensor::from_slice(&first).unsqueeze(1) + offsets.unsqueeze(0);
        let rows = rows.view(-1).to_device(device);
        let shape = [batch.len() as i64, self.length, columns];
        let input = states.index_select(0, &rows).view(shape);
        let target = states.index_select(0, &(rows + 1)).view(shape);
        let mut weights = parts(parameters, &self.shapes);
        let head = weights.split_off(weights.len() - 2);
        let empty = [self.layers, batch.len() as i64, self.hidden];
        let empty = Tensor::zeros(empty, (tch::Kind::Float, device));
        let (hidden, _) = input.gru(&empty, &weights, true, self.layers, 0.0, true, false, true);
        let output = hidden.matmul(&head[0].transpose(0, 1)) + &head[1];
        output.mse_loss(&target, Reduction::Mean)
    }
}

impl RecurrentTrainer {
    /// Starts training.
    ///
    /// # Errors
    /// If no sequence fits into a part of the data.
    pub fn new(
        data: &Transitioning<'_>,
        config: &DynamicsConfig,
        seed: Seed,
        device: Device,
    ) -> Result<Self, DynamicsError> {
        let length = config.sequence_length;
        let stride = config.sequence_stride;
        let parts = [("training", data.training()), ("validation", data.validation())];
        let [training, validation] = parts.map(|(part, range)| {
            let found = sequences(data.transitions(), range, length, stride);
            if found.is_empty() {
                Err(DynamicsError::NoSequence { part, length })
            } else {
                Ok(found)
            }
        });
        let parts = (training?, validation?);
        let columns = data.columns();
        let hidden = config.hidden_units;
        let start = Recurrent::random(
            columns,
            hidden,
            config.hidden_layers,
            length - 1,
            seed_of_parameters(seed),
        );
        let network = Sequences {
            shapes: shapes(&start),
            layers: config.hidden_layers as i64,
            hidden: hidden as i64,
            length: length as i64,
            sources: data.transitions().sources().to_vec(),
        };
        let epochs =
            Epochs::new(network, config, seed, data.states(), parts, &start.flat(), device);
        Ok(Self { epochs, start })
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
        let mut trainer = Self::new(data, config, seed, device)?;
        trainer.epochs.resume(checkpoint)?;
        Ok(trainer)
    }

    /// Makes one update on the sequences that begin with these transitions. Returns the mean squared error before it.
    ///
    /// # Errors
    /// If libtorch fails.
    pub fn update(&mut self, first: &[u32]) -> Result<f64, TorchError> {
        self.epochs.update(first)
    }

    /// Returns the current model.
    ///
    /// # Errors
    /// If libtorch fails.
    pub fn present(&self) -> Result<Recurrent, DynamicsError> {
        Ok(self.start.with_flat(&self.epochs.parameters()?))
    }
}

/// Returns the shapes of all weights, in the order of [`Recurrent::flat`].
fn shapes(model: &Recurrent) -> Vec<Vec<i64>> {
    let units = model.hidden() as i64;
    let mut shapes = Vec::new();
    for layer in model.layers() {
        let inputs = layer.weight_ih.len() as i64 / (3 * units);
        shapes.extend([vec![3 * units, inputs], vec![3 * units, units]]);
        shapes.extend([vec![3 * units], vec![3 * units]]);
    }
    let columns = model.head().1.len() as i64;
    shapes.extend([vec![columns, units], vec![columns]]);
    shapes
}

impl Trainer for RecurrentTrainer {
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
        Ok(self.start.with_flat(self.epochs.kept()).to_tensors())
    }
}
