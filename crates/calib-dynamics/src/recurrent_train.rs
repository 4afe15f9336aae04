use calib_core::{Seed, TransitionIndex};

use crate::{
    DynamicsConfig, DynamicsError, Recurrent, Transitioning,
    recurrent_pass::{GruPass, GruShape, Sequences},
    seed_of_parameters, sequences,
    train::{Learnable, NativeTrainer, Parts},
};

/// Trains the GRU baseline on the mean squared error of every next state of a sequence, by back-propagation through the whole
/// sequence. Each sequence begins with an empty hidden state (burn-in 0, the paper). Uses Adam and shuffled mini-batches of
/// sequences.
pub type RecurrentTrainer<'a> = NativeTrainer<Gru<'a>>;

/// A GRU and its training sequences.
#[derive(Debug)]
pub struct Gru<'a> {
    data: Transitioning<'a>,
    start: Recurrent,
    shape: GruShape,
    length: usize,
}

/// Buffers for some sequences of a mini-batch.
#[derive(Debug)]
pub struct GruWorkspace {
    inputs: Vec<f32>,
    targets: Vec<f32>,
    pass: GruPass,
}

impl Learnable for Gru<'_> {
    type Workspace = GruWorkspace;

    fn workspace(&self, _rows: usize) -> GruWorkspace {
        GruWorkspace { inputs: Vec::new(), targets: Vec::new(), pass: GruPass::new(&self.shape) }
    }

    fn outputs_per_item(&self) -> usize {
        self.length * self.shape.columns
    }

    fn squared_error(
        &self,
        parameters: &[f32],
        items: &[u32],
        scale: Option<f32>,
        workspace: &mut GruWorkspace,
    ) -> f64 {
        let GruWorkspace { inputs, targets, pass } = workspace;
        inputs.clear();
        targets.clear();
        let states = self.data.states();
        let transitions = self.data.transitions();
        for step in 0..self.length {
            for &first in items {
                let row = transitions.source(TransitionIndex(first)).get() + step;
                inputs.extend_from_slice(states.row(row));
                targets.extend_from_slice(states.row(row + 1));
            }
        }
        let sequences = Sequences { inputs, targets, length: self.length, count: items.len() };
        let squares = pass.squared_error(&self.shape, parameters, sequences);
        if let Some(scale) = scale {
            pass.back(&self.shape, parameters, sequences, scale);
        }
        squares
    }

    fn gradient<'w>(&self, workspace: &'w mut GruWorkspace) -> &'w mut [f32] {
        &mut workspace.pass.gradient
    }

    fn weights(&self, parameters: &[f32]) -> calib_files::Tensors {
        self.start.with_flat(parameters).to_tensors()
    }
}

impl<'a> RecurrentTrainer<'a> {
    /// Starts training with parameters drawn by [`Recurrent::random`].
    ///
    /// # Errors
    /// If no sequence fits into a part of the data.
    pub fn new(
        data: &Transitioning<'a>,
        config: &DynamicsConfig,
        seed: Seed,
    ) -> Result<Self, DynamicsError> {
        let length = config.sequence_length;
        let stride = config.sequence_stride;
        let parts = [("training", data.training()), ("validation", data.validation())];
        let [training, validation] =
            parts.map(|(part, range)| match sequences(data.transitions(), range, length, stride) {
                found if found.is_empty() => Err(DynamicsError::NoSequence { part, length }),
                found => Ok(found),
            });
        let parts = Parts { training: training?, validation: validation? };
        let start = Recurrent::random(
            data.columns(),
            config.hidden_units,
            config.hidden_layers,
            length - 1,
            seed_of_parameters(seed),
        );
        let shape = GruShape::of(&start);
        let parameters = start.flat();
        let gru = Gru { data: *data, start, shape, length };
        Ok(Self::with(gru, config, seed, parts, parameters))
    }

    /// Returns the current model.
    pub fn present(&self) -> Recurrent {
        self.learnable().start.with_flat(self.parameters())
    }
}

/// Returns the memory for training a GRU without the states, in bytes: activations and gradients of a mini-batch, and copies
/// of the parameters.
pub fn recurrent_training_bytes(config: &DynamicsConfig, columns: usize) -> u64 {
    let units = config.hidden_units;
    let rows = config.batch_size.saturating_mul(config.sequence_length);
    let activations = rows.saturating_mul(12 * units);
    let [first, other] = [columns, units].map(|inputs| 3 * units * (inputs + units + 2));
    let above = (config.hidden_layers - 1).saturating_mul(other);
    let parameters = first + above + columns * (units + 1);
    // The parameters, the kept parameters, two moments, and a gradient for each half of a mini-batch.
    float_bytes(activations)
        .saturating_mul(config.hidden_layers as u64)
        .saturating_add(float_bytes(rows.saturating_mul(3 * columns)))
        .saturating_add(6 * float_bytes(parameters))
}

/// Returns the bytes of `count` single-precision numbers.
fn float_bytes(count: usize) -> u64 {
    4 * count as u64
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use calib_core::{Segments, Silent, States, Transitions};
    use serde::Deserialize;

    use super::*;
    use crate::{Dynamics as _, GruLayer, LANES, Trainer as _};

    #[derive(Deserialize)]
    struct Golden {
        columns: usize,
        layers: usize,
        steps: usize,
        /// The states, `[sequences][length + 1][columns]`.
        states: Vec<Vec<Vec<f32>>>,
        tensors: BTreeMap<String, Vec<f32>>,
        gru: Case,
    }

    #[derive(Deserialize)]
    struct Case {
        /// The predictions, `[sequences][length][columns]`.
        predictions: Vec<Vec<Vec<f64>>>,
        loss: f64,
        gradients: BTreeMap<String, Vec<f64>>,
        tensors_after: BTreeMap<String, Vec<f64>>,
        loss_after: f64,
    }

    impl Golden {
        fn read() -> Self {
            serde_json::from_str(include_str!("../tests/golden/dynamics.json")).expect("reads")
        }

        fn tensor(&self, name: &str) -> Vec<f32> {
            self.tensors[name].clone()
        }

        fn model(&self) -> Recurrent {
            let layers = (0..self.layers)
                .map(|number: usize| GruLayer {
                    weight_ih: self.tensor(&format!("gru.weight_ih_l{number}")),
                    weight_hh: self.tensor(&format!("gru.weight_hh_l{number}")),
                    bias_ih: self.tensor(&format!("gru.bias_ih_l{number}")),
                    bias_hh: self.tensor(&format!("gru.bias_hh_l{number}")),
                })
                .collect();
            let [weight, bias] = ["head.weight", "head.bias"].map(|name| self.tensor(name));
            Recurrent::new(layers, weight, bias, 0).expect("sizes agree")
        }
    }

    /// PyTorch's own single precision is within 4e-8.
    #[test]
    fn a_gru_predicts_what_pytorch_predicts() {
        let golden = Golden::read();
        let model = golden.model();
        let mut rollouts = model.begin_rollouts().expect("it runs");
        let columns = golden.columns;
        let mut states = vec![0.0; LANES * columns];
        let mut next = vec![0.0; LANES * columns];
        for step in 0..golden.gru.predictions[0].len() {
            for (lane, sequence) in golden.states.iter().enumerate() {
                states[lane * columns..][..columns].copy_from_slice(&sequence[step]);
            }
            rollouts.step(&states, &mut next).expect("a step");
            for (lane, expected) in golden.gru.predictions.iter().enumerate() {
                for (got, expected) in next[lane * columns..].iter().zip(&expected[step]) {
                    let difference = (f64::from(*got) - expected).abs();
                    assert!(difference < 5e-7, "step {step}: {got}, expected {expected}");
                }
            }
        }
    }

    /// Returns the parts of a flat vector by PyTorch's names.
    fn named(model: &Recurrent, flat: &[f32]) -> BTreeMap<String, Vec<f32>> {
        let tensors = model.with_flat(flat).to_tensors().tensors;
        tensors.into_iter().map(|tensor| (tensor.name, tensor.values)).collect()
    }

    fn assert_close(got: &BTreeMap<String, Vec<f32>>, expected: &BTreeMap<String, Vec<f64>>) {
        assert_eq!(got.len(), expected.len());
        for (name, expected) in expected {
            for (index, (got, expected)) in got[name].iter().zip(expected).enumerate() {
                let difference = (f64::from(*got) - expected).abs();
                assert!(difference < 1e-6, "{name} {index}: {got}, expected {expected}");
            }
        }
    }

    /// Compares gradients and training of 20 updates with PyTorch: `scripts/golden/gru.py`.
    #[test]
    fn a_gru_learns_as_in_pytorch() {
        let golden = Golden::read();
        let model = golden.model();
        let shape = GruShape::of(&model);
        let count = golden.states.len();
        let length = golden.states[0].len() - 1;
        let [inputs, targets] = [0, 1].map(|offset| -> Vec<f32> {
            (offset..offset + length)
                .flat_map(|step: usize| golden.states.iter().flat_map(move |own| own[step].clone()))
                .collect()
        });
        let sequences = Sequences { inputs: &inputs, targets: &targets, length, count };
        let values = (count * length * golden.columns) as f64;
        let mut parameters = model.flat();
        let mut pass = GruPass::new(&shape);
        let rule = calib_nn::AdamRule { learning_rate: 1e-2, ..calib_nn::AdamRule::default() };
        let mut adam = calib_nn::Adam::new(rule, parameters.len());
        for step in 0..golden.steps {
            let loss = pass.squared_error(&shape, &parameters, sequences) / values;
            pass.back(&shape, &parameters, sequences, 2.0 / values as f32);
            if step == 0 {
                assert!((loss - golden.gru.loss).abs() < 1e-7, "{loss}");
                assert_close(&named(&model, &pass.gradient), &golden.gru.gradients);
            }
            adam.step(&mut parameters, &pass.gradient);
        }
        assert_close(&named(&model, &parameters), &golden.gru.tensors_after);
        let loss = pass.squared_error(&shape, &parameters, sequences) / values;
        assert!((loss - golden.gru.loss_after).abs() < 1e-6, "{loss}");
    }

    /// Returns a wave whose state shows only the height, so that prediction needs memory.
    fn wave(rows: usize) -> (States, Transitions) {
        let values = (0..rows).map(|t| (t as f32 * 0.3).sin()).collect();
        let states = States::new(values, rows, 1).expect("finite");
        let segments = Segments::from_lengths([rows / 2, rows - rows / 2]).expect("valid");
        (states, Transitions::new(segments))
    }

    fn config(epochs: usize) -> DynamicsConfig {
        DynamicsConfig {
            hidden_units: 12,
            batch_size: 130,
            epochs,
            sequence_length: 12,
            learning_rate: 5e-3,
            ..DynamicsConfig::default()
        }
    }

    #[test]
    fn what_takes_memory_is_learnt_whatever_the_threads_and_interruptions() {
        let (states, transitions) = wave(800);
        let data = Transitioning::new(&states, &transitions, 0.2).expect("enough");
        let [whole, in_parts] = [(1, false), (3, true)].map(|(threads, put_aside)| {
            let pool =
                rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            pool.install(|| {
                let config = config(25);
                let seed = Seed::new(5);
                let mut trainer = RecurrentTrainer::new(&data, &config, seed).expect("sequences");
                while !trainer.record().is_complete(&config) {
                    trainer.epoch(&Silent).expect("finite");
                    if put_aside {
                        let kept = trainer.checkpoint().expect("native");
                        let begun = RecurrentTrainer::new(&data, &config, seed);
                        trainer = begun.expect("sequences").resumed(&kept).expect("ours");
                    }
                }
                (trainer.record().clone(), trainer.weights().expect("native"))
            })
        });
        assert_eq!(in_parts, whole);
        let last = whole.0.epochs[24].validation;
        assert!(last < 0.2 * data.persistence_loss(), "{last} {}", data.persistence_loss());
    }

    #[test]
    fn a_part_without_a_sequence_is_named() {
        let (states, transitions) = wave(60);
        let data = Transitioning::new(&states, &transitions, 0.05).expect("enough");
        let refused =
            RecurrentTrainer::new(&data, &config(1), Seed::new(1)).expect_err("too short");
        assert!(refused.to_string().contains("validation"), "{refused}");
    }
}
