use calib_core::{Seed, Segments, States};
use calib_nn::{Adam, AdamRule, Mlp, Moments, Workspace};

use crate::{
    LaplacianConfig, Loss, LossBuffers, PairSampler, RepresentError, Split, laplacian_loss,
};

/// The rows of a mini-batch, equally many of each kind.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Batch {
    /// First states of the pairs.
    pub u: Vec<usize>,
    /// Second states of the pairs.
    pub v: Vec<usize>,
    /// Independent states.
    pub x: Vec<usize>,
}

/// An encoder in training: parameters, optimiser, and every buffer of a step.
///
/// A step draws B pairs (u, v) and B independent states x of the training part. It passes all 3B rows
/// forward as one batch, and follows the gradient of [`laplacian_loss`] with Adam. The draws of step t
/// depend only on the seed and on t. So training can resume at any step from parameters and moments.
#[derive(Clone, Debug)]
pub struct Training {
    config: LaplacianConfig,
    states: States,
    rows: std::ops::Range<usize>,
    pairs: PairSampler,
    draws: Seed,
    pub(crate) encoder: Mlp,
    pub(crate) adam: Adam,
    done: usize,
    workspace: Workspace,
    buffers: LossBuffers,
    batch: Batch,
    /// The inputs of ψ: u of every pair, v of every pair, x. `[3B, columns]`.
    inputs: Vec<f32>,
}

impl Training {
    /// Creates a new encoder for `states`, for the training part of `split`.
    ///
    /// # Errors
    /// A hyperparameter outside its range, or a training part without two successive states.
    pub fn new(
        config: &LaplacianConfig,
        states: &States,
        segments: &Segments,
        split: &Split,
        seed: Seed,
    ) -> Result<Self, RepresentError> {
        config.check()?;
        let encoder = Mlp::new(&config.sizes(states.columns()), seed.child("encoder"));
        Self::from_encoder(config, states, segments, split, seed, encoder)
    }

    /// Starts with an existing encoder, and an optimiser without moments.
    ///
    /// # Errors
    /// As [`Training::new`].
    ///
    /// # Panics
    /// If the encoder has not the layers that `config` describes.
    pub fn from_encoder(
        config: &LaplacianConfig,
        states: &States,
        segments: &Segments,
        split: &Split,
        seed: Seed,
        encoder: Mlp,
    ) -> Result<Self, RepresentError> {
        config.check()?;
        assert_eq!(encoder.sizes(), config.sizes(states.columns()), "layers as configured");
        let rows = split.training.clone();
        let pairs = PairSampler::new(segments, rows.clone(), config.kappa, config.trajectory)
            .ok_or(RepresentError::NoPairs { part: "training", rows: rows.len() })?;
        let rule = AdamRule { learning_rate: config.learning_rate, ..AdamRule::default() };
        Ok(Self {
            config: *config,
            states: states.clone(),
            rows,
            pairs,
            draws: seed.child("batches"),
            adam: Adam::new(rule, encoder.parameter_count()),
            done: 0,
            workspace: Workspace::new(&encoder, 3 * config.batch_size),
            buffers: LossBuffers::new(config.batch_size, config.dimension),
            batch: Batch::default(),
            inputs: vec![0.0; 3 * config.batch_size * states.columns()],
            encoder,
        })
    }

    /// Makes one update. Returns the loss of its batch before the update.
    pub fn step(&mut self) -> Loss {
        let mut batch = std::mem::take(&mut self.batch);
        self.draw(&mut batch);
        let loss = self.step_on(&batch);
        self.batch = batch;
        loss
    }

    /// Makes one update on these rows. Returns the loss before the update.
    ///
    /// # Panics
    /// If the batch has not as many rows as configured, or a row is not one of the states.
    pub fn step_on(&mut self, batch: &Batch) -> Loss {
        let (states, columns) = (self.states.as_slice(), self.states.columns());
        let rows = batch.u.iter().chain(&batch.v).chain(&batch.x);
        assert_eq!(rows.clone().count(), 3 * self.config.batch_size, "u, v and x of a batch");
        for (input, &row) in self.inputs.chunks_exact_mut(columns).zip(rows) {
            input.copy_from_slice(&states[row * columns..][..columns]);
        }
        self.done += 1;
        let outputs = self.encoder.forward(&self.inputs, &mut self.workspace);
        let (loss, gradient) = laplacian_loss(&self.config.loss, outputs, &mut self.buffers);
        let gradients = self.encoder.backward(&self.inputs, gradient, &mut self.workspace);
        self.adam.step(self.encoder.parameters_mut(), gradients);
        loss
    }

    /// Draws the rows of the next step's batch.
    pub fn draw(&self, batch: &mut Batch) {
        self.draw_at(self.done, batch);
    }

    /// Draws the rows of the batch for the step after `done` updates.
    pub fn draw_at(&self, done: usize, batch: &mut Batch) {
        let mut rng = self.draws.number(done as u64).rng();
        batch.u.clear();
        batch.v.clear();
        batch.x.clear();
        for _ in 0..self.config.batch_size {
            let (u, v) = self.pairs.draw(&mut rng);
            batch.u.push(u);
            batch.v.push(v);
            batch.x.push(self.rows.start + rng.below(self.rows.len()));
        }
    }

    /// Restores the state of earlier training with the same shape, after `done` updates.
    pub(crate) fn restore(&mut self, parameters: &[f32], moments: Moments, done: usize) {
        self.encoder.parameters_mut().copy_from_slice(parameters);
        self.adam = Adam::from_moments(self.adam.rule(), moments);
        self.done = done;
    }

    /// Returns the hyperparameters.
    pub fn config(&self) -> &LaplacianConfig {
        &self.config
    }

    /// Returns the number of updates so far.
    pub fn done(&self) -> usize {
        self.done
    }

    /// Returns the current encoder.
    pub fn encoder(&self) -> &Mlp {
        &self.encoder
    }
}
