use calib_core::{Rng, Seed, Segments, States};
use calib_nn::{Adam, AdamRule, Mlp, Workspace};

use crate::{
    LaplacianConfig, Loss, LossBuffers, PairSampler, RepresentError, Split, laplacian_loss,
};

/// An encoder in training: parameters, optimiser, and every buffer of a step.
///
/// A step draws B pairs (u, v) and B independent states x of the training part, forwards all 3B rows as
/// one batch, and follows the gradient of [`laplacian_loss`] with Adam. The draws of step t depend on the
/// seed and on t alone, so training goes on anywhere from parameters and moments.
#[derive(Clone, Debug)]
pub struct Training {
    config: LaplacianConfig,
    states: States,
    rows: std::ops::Range<usize>,
    pairs: PairSampler,
    draws: Seed,
    pub(crate) encoder: Mlp,
    pub(crate) adam: Adam,
    pub(crate) done: usize,
    workspace: Workspace,
    buffers: LossBuffers,
    /// ψ's inputs: u of every pair, v of every pair, x. `[3B, columns]`.
    inputs: Vec<f32>,
}

impl Training {
    /// A fresh encoder for `states`, to be trained on the training part of `split`.
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
        let rows = split.training.clone();
        let pairs = PairSampler::new(segments, rows.clone(), config.kappa, config.trajectory)
            .ok_or(RepresentError::NoPairs { part: "training", rows: rows.len() })?;
        let encoder = Mlp::new(&config.sizes(states.columns()), seed.child("encoder"));
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
            inputs: vec![0.0; 3 * config.batch_size * states.columns()],
            encoder,
        })
    }

    /// One update; the loss of its batch before the update.
    pub fn step(&mut self) -> Loss {
        let mut rng = self.draws.number(self.done as u64).rng();
        self.gather(&mut rng);
        self.done += 1;
        let outputs = self.encoder.forward(&self.inputs, &mut self.workspace);
        let (loss, gradient) = laplacian_loss(&self.config.loss, outputs, &mut self.buffers);
        let gradients = self.encoder.backward(&self.inputs, gradient, &mut self.workspace);
        self.adam.step(self.encoder.parameters_mut(), gradients);
        loss
    }

    fn gather(&mut self, rng: &mut Rng) {
        let (states, columns) = (self.states.as_slice(), self.states.columns());
        let block = self.config.batch_size * columns;
        let (u_rows, rest) = self.inputs.split_at_mut(block);
        let (v_rows, x_rows) = rest.split_at_mut(block);
        let copy = |to: &mut [f32], row: usize| {
            to.copy_from_slice(&states[row * columns..][..columns]);
        };
        let places = u_rows.chunks_exact_mut(columns).zip(v_rows.chunks_exact_mut(columns));
        for ((u_row, v_row), x_row) in places.zip(x_rows.chunks_exact_mut(columns)) {
            let (u, v) = self.pairs.draw(rng);
            copy(u_row, u);
            copy(v_row, v);
            copy(x_row, self.rows.start + rng.below(self.rows.len()));
        }
    }

    /// Hyperparameters.
    pub fn config(&self) -> &LaplacianConfig {
        &self.config
    }

    /// Updates so far.
    pub fn done(&self) -> usize {
        self.done
    }

    /// The encoder as it is now.
    pub fn encoder(&self) -> &Mlp {
        &self.encoder
    }
}
