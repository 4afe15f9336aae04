use calib_core::States;
use calib_nn::{AdamRule, Mlp};
use calib_represent::{Batch, LaplacianConfig};
use tch::{Device, Kind, Tensor};

use crate::{TorchError, adam::Adam, feed_forward::Layers, trainer::leaf};

/// Trains an encoder with the graph-drawing loss through libtorch, on batches that the caller draws.
///
/// It is the loss of [`calib_represent::laplacian_loss`], with the pairs of independent states written out; the
/// gradient is libtorch's.
pub struct LaplacianTraining {
    config: LaplacianConfig,
    layers: Layers,
    start: Mlp,
    states: Tensor,
    parameters: Tensor,
    adam: Adam,
}

impl LaplacianTraining {
    /// Training of `encoder` on rows of `states`.
    pub fn new(config: &LaplacianConfig, states: &States, encoder: Mlp, device: Device) -> Self {
        let shape = [states.rows() as i64, states.columns() as i64];
        let states = Tensor::from_slice(states.as_slice()).view(shape).to_device(device);
        let parameters = leaf(encoder.parameters(), device);
        let rule = AdamRule { learning_rate: config.learning_rate, ..AdamRule::default() };
        let adam = Adam::new(rule, &parameters);
        let layers = Layers::of(&encoder);
        Self { config: *config, layers, start: encoder, states, parameters, adam }
    }

    /// One update on these rows; the loss before it.
    ///
    /// # Errors
    /// If libtorch fails.
    pub fn step_on(&mut self, batch: &Batch) -> Result<f64, TorchError> {
        let loss = self.loss(batch);
        loss.f_backward()?;
        self.adam.step(&mut self.parameters);
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

    /// The encoder as it is now.
    ///
    /// # Errors
    /// If libtorch fails.
    pub fn encoder(&self) -> Result<Mlp, TorchError> {
        let mut encoder = self.start.clone();
        encoder.parameters_mut().copy_from_slice(&crate::adam::values(&self.parameters)?);
        Ok(encoder)
    }
}
