use calib_nn::{AdamRule, Mlp, Moments};
use calib_represent::{Batch, LaplacianConfig, RepresentError, Stepper, Task, Training};
use tch::{Device, Kind, Tensor};

use crate::{
    TorchError,
    adam::{Adam, values},
    feed_forward::Layers,
    trainer::leaf,
};

/// Trains an encoder with the graph-drawing loss through libtorch, with the same initial parameters and batches as
/// [`calib_represent::Training`].
///
/// The loss is [`calib_represent::laplacian_loss`], computed over explicit pairs of independent states. The gradient
/// comes from libtorch.
pub struct LaplacianTraining {
    config: LaplacianConfig,
    /// The native training, which draws the batches and has the initial parameters.
    native: Training,
    layers: Layers,
    states: Tensor,
    parameters: Tensor,
    adam: Adam,
    done: usize,
}

impl LaplacianTraining {
    /// Starts training with a new encoder.
    ///
    /// # Errors
    /// As [`Training::new`].
    pub fn new(
        config: &LaplacianConfig,
        task: Task<'_>,
        device: Device,
    ) -> Result<Self, RepresentError> {
        let Task { states, segments, split, seed } = task;
        let native = Training::new(config, states, segments, split, seed)?;
        let shape = [states.rows() as i64, states.columns() as i64];
        let states = Tensor::from_slice(states.as_slice()).view(shape).to_device(device);
        let parameters = leaf(native.encoder().parameters(), device);
        let adam = Adam::new(rule(config), &parameters);
        let layers = Layers::of(native.encoder());
        Ok(Self { config: *config, native, layers, states, parameters, adam, done: 0 })
    }

    /// Makes one update on these rows. Returns the loss before it.
    ///
    /// # Errors
    /// If libtorch fails.
    pub fn step_on(&mut self, batch: &Batch) -> Result<f64, TorchError> {
        let loss = self.loss(batch);
        loss.f_backward()?;
        self.adam.step(&mut self.parameters);
        self.done += 1;
        Ok(f64::try_from(&loss.to_kind(Kind::Double))?)
    }

    fn loss(&self, batch: &Batch) -> Tensor {
        let rows = batch.u.iter().chain(&batch.v).chain(&batch.x).map(|&row| row as i64);
        let rows = Tensor::from_slice(&rows.collect::<Vec<i64>>()).to_device(self.states.device());
        let psi = self.layers.forward(&self.parameters, &self.states.index_select(0, &rows));
        let psi = psi.chunk(3, 0);
        let attraction = (&psi[0] - &psi[1])
            .square()
            .sum_dim_intlist(&[1_i64][..], false, Kind::Float)
            .mean(Kind::Float);
        let count = batch.x.len() as f64;
        let norms = psi[2].square().sum_dim_intlist(&[1_i64][..], false, Kind::Float);
        let products = psi[2].matmul(&psi[2].transpose(0, 1)).square().sum(Kind::Float);
        let pairs = (products - norms.square().sum(Kind::Float)) / (count * (count - 1.0));
        let (quartic, quadratic) = self.config.loss.repulsion();
        attraction * self.config.loss.attraction + pairs * quartic
            - norms.mean(Kind::Float) * (2.0 * quadratic)
    }
}

fn rule(config: &LaplacianConfig) -> AdamRule {
    AdamRule { learning_rate: config.learning_rate, ..AdamRule::default() }
}

fn failed(error: &impl ToString) -> RepresentError {
    RepresentError::Backend(error.to_string())
}

impl Stepper for LaplacianTraining {
    fn step(&mut self) -> Result<f64, RepresentError> {
        let mut batch = Batch::default();
        self.native.draw_at(self.done, &mut batch);
        self.step_on(&batch).map_err(|error| failed(&error))
    }

    fn done(&self) -> usize {
        self.done
    }

    fn encoder(&self) -> Result<Mlp, RepresentError> {
        let mut encoder = self.native.encoder().clone();
        let parameters = values(&self.parameters).map_err(|error| failed(&error))?;
        encoder.parameters_mut().copy_from_slice(&parameters);
        Ok(encoder)
    }

    fn moments(&self) -> Result<Moments, RepresentError> {
        self.adam.moments().map_err(|error| failed(&error))
    }

    fn restore(&mut self, parameters: &[f32], moments: Moments, done: usize) {
        let device = self.parameters.device();
        self.parameters = leaf(parameters, device);
        self.adam = Adam::from_moments(rule(&self.config), &moments, device);
        self.done = done;
    }
}
