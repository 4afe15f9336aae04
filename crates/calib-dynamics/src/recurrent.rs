use calib_core::{Rng, Seed};
use calib_nn::{Matrix, multiply};

use crate::{
    Dynamics, DynamicsError, LANES, LaneRollouts,
    gates::{Activated, Products, activate},
};

/// One layer of a GRU, in PyTorch's layout. The rows are the reset, update and new gates, each with `hidden` units.
#[derive(Clone, Debug, PartialEq)]
pub struct GruLayer {
    /// Weights of the input, `[3 · hidden, inputs]`.
    pub weight_ih: Vec<f32>,
    /// Weights of the hidden state, `[3 · hidden, hidden]`.
    pub weight_hh: Vec<f32>,
    /// Biases of the input, `[3 · hidden]`.
    pub bias_ih: Vec<f32>,
    /// Biases of the hidden state, `[3 · hidden]`.
    pub bias_hh: Vec<f32>,
}

/// The GRU baseline: layers of gated recurrent units (Cho et al. 2014, as PyTorch computes them) and a linear output.
/// The output is the next state.
///
/// ```text
/// r = σ(W_ir x + b_ir + W_hr h + b_hr), z = σ(W_iz x + b_iz + W_hz h + b_hz),
/// n = tanh(W_in x + b_in + r ⊙ (W_hn h + b_hn)), h ← (1 − z) ⊙ n + z ⊙ h.
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Recurrent {
    columns: usize,
    hidden: usize,
    layers: Vec<GruLayer>,
    /// The weights of the output, `[columns, hidden]`.
    head_weight: Vec<f32>,
    head_bias: Vec<f32>,
    history: usize,
}

impl Recurrent {
    /// Creates a model with these weights. `history` recorded states before a start fill the hidden state.
    ///
    /// # Errors
    /// If the sizes do not agree.
    pub fn new(
        layers: Vec<GruLayer>,
        head_weight: Vec<f32>,
        head_bias: Vec<f32>,
        history: usize,
    ) -> Result<Self, DynamicsError> {
        let columns = head_bias.len();
        let hidden = layers.first().map_or(0, |layer| layer.bias_hh.len() / 3);
        if columns == 0 || hidden == 0 || head_weight.len() != columns * hidden {
            let reason = format!(
                "an output of {columns} values from {hidden} units has {} weights, got {}",
                columns * hidden,
                head_weight.len()
            );
            return Err(DynamicsError::Weights { reason });
        }
        for (number, layer) in layers.iter().enumerate() {
            let inputs = if number == 0 { columns } else { hidden };
            let expected = [3 * hidden * inputs, 3 * hidden * hidden, 3 * hidden, 3 * hidden];
            let got =
                [&layer.weight_ih, &layer.weight_hh, &layer.bias_ih, &layer.bias_hh].map(Vec::len);
            if got != expected {
                let reason = format!(
                    "layer {number} of {hidden} units on {inputs} values has {expected:?} weights, got {got:?}"
                );
                return Err(DynamicsError::Weights { reason });
            }
        }
        Ok(Self { columns, hidden, layers, head_weight, head_bias, history })
    }

    /// Creates a model with PyTorch's default parameters: uniform in ±1/√hidden, drawn in the order of [`Self::flat`].
    ///
    /// # Panics
    /// If a size is zero.
    pub fn random(
        columns: usize,
        hidden: usize,
        layers: usize,
        history: usize,
        seed: Seed,
    ) -> Self {
        assert!(columns > 0 && hidden > 0 && layers > 0, "every layer has units");
        let bound = 1.0 / (hidden as f64).sqrt();
        let mut rng = seed.rng();
        let layers = (0..layers)
            .map(|number: usize| {
                let inputs = if number == 0 { columns } else { hidden };
                GruLayer {
                    weight_ih: draw(&mut rng, bound, 3 * hidden * inputs),
                    weight_hh: draw(&mut rng, bound, 3 * hidden * hidden),
                    bias_ih: draw(&mut rng, bound, 3 * hidden),
                    bias_hh: draw(&mut rng, bound, 3 * hidden),
                }
            })
            .collect();
        let head_weight = draw(&mut rng, bound, columns * hidden);
        let head_bias = draw(&mut rng, bound, columns);
        Self { columns, hidden, layers, head_weight, head_bias, history }
    }

    /// Returns all parameters in one vector: `weight_ih`, `weight_hh`, `bias_ih` and `bias_hh` of each layer, then
    /// weights and biases of the output.
    pub fn flat(&self) -> Vec<f32> {
        let layers = self.layers.iter();
        let layers = layers
            .flat_map(|layer| [&layer.weight_ih, &layer.weight_hh, &layer.bias_ih, &layer.bias_hh]);
        layers.chain([&self.head_weight, &self.head_bias]).flatten().copied().collect()
    }

    /// Returns the same model with other parameters, in the order of [`Self::flat`].
    ///
    /// # Panics
    /// If the number of parameters differs.
    #[must_use]
    pub fn with_flat(&self, flat: &[f32]) -> Self {
        let mut model = self.clone();
        let mut rest = flat;
        let layers = model.layers.iter_mut().flat_map(|layer| {
            [&mut layer.weight_ih, &mut layer.weight_hh, &mut layer.bias_ih, &mut layer.bias_hh]
        });
        for values in layers.chain([&mut model.head_weight, &mut model.head_bias]) {
            let (own, others) = rest.split_at(values.len());
            values.copy_from_slice(own);
            rest = others;
        }
        assert!(rest.is_empty(), "as many parameters");
        model
    }

    /// Returns the layers, input first.
    pub fn layers(&self) -> &[GruLayer] {
        &self.layers
    }

    /// Returns the number of units per layer.
    pub fn hidden(&self) -> usize {
        self.hidden
    }

    /// Returns the weights `[columns, hidden]` and biases `[columns]` of the output.
    pub fn head(&self) -> (&[f32], &[f32]) {
        (&self.head_weight, &self.head_bias)
    }
}

/// Draws `count` numbers that are uniform in ±`bound`.
fn draw(rng: &mut Rng, bound: f64, count: usize) -> Vec<f32> {
    (0..count).map(|_| rng.uniform(-bound, bound) as f32).collect()
}

impl Dynamics for Recurrent {
    fn columns(&self) -> usize {
        self.columns
    }

    fn history(&self) -> usize {
        self.history
    }

    fn begin_rollouts(&self) -> Result<Box<dyn LaneRollouts + '_>, DynamicsError> {
        Ok(Box::new(RecurrentRollouts {
            model: self,
            hidden: vec![vec![0.0; LANES * self.hidden]; self.layers.len()],
            of_input: vec![0.0; LANES * 3 * self.hidden],
            of_hidden: vec![0.0; LANES * 3 * self.hidden],
            gates: std::array::from_fn(|_| vec![0.0; self.hidden]),
        }))
    }
}

struct RecurrentRollouts<'a> {
    model: &'a Recurrent,
    /// Hidden state of each layer, `[LANES, hidden]`.
    hidden: Vec<Vec<f32>>,
    of_input: Vec<f32>,
    of_hidden: Vec<f32>,
    /// Buffers of one lane: the gates, the hidden part of the new gate, and the previous hidden state.
    gates: [Vec<f32>; 5],
}

impl LaneRollouts for RecurrentRollouts<'_> {
    fn step(&mut self, states: &[f32], next: &mut [f32]) -> Result<(), DynamicsError> {
        let units = self.model.hidden;
        for (number, layer) in self.model.layers.iter().enumerate() {
            let (before, from) = self.hidden.split_at_mut(number);
            let input = before.last().map_or(states, Vec::as_slice);
            let inputs = input.len() / LANES;
            let hidden = &mut from[0];
            multiply(
                &mut self.of_input,
                Matrix::new(input, LANES, inputs),
                Matrix::new(&layer.weight_ih, 3 * units, inputs).transposed(),
            );
            multiply(
                &mut self.of_hidden,
                Matrix::new(hidden, LANES, units),
                Matrix::new(&layer.weight_hh, 3 * units, units).transposed(),
            );
            let lanes = self.of_input.chunks_exact(3 * units);
            let lanes = lanes.zip(self.of_hidden.chunks_exact(3 * units));
            let [reset, keep, new, new_hidden, past] = &mut self.gates;
            for ((of_input, of_hidden), hidden) in lanes.zip(hidden.chunks_exact_mut(units)) {
                past.copy_from_slice(hidden);
                let bias_ih = &layer.bias_ih;
                let bias_hh = &layer.bias_hh;
                let products = Products { of_input, of_hidden, bias_ih, bias_hh };
                activate(products, past, Activated { reset, keep, new, new_hidden, hidden });
            }
        }
        let last = &self.hidden[self.model.layers.len() - 1];
        multiply(
            next,
            Matrix::new(last, LANES, units),
            Matrix::new(&self.model.head_weight, self.model.columns, units).transposed(),
        );
        for row in next.chunks_exact_mut(self.model.columns) {
            for (value, bias) in row.iter_mut().zip(&self.model.head_bias) {
                *value += bias;
            }
        }
        Ok(())
    }

    fn forget(&mut self, lane: usize) {
        let units = self.model.hidden;
        for hidden in &mut self.hidden {
            hidden[lane * units..(lane + 1) * units].fill(0.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns σ by its definition.
    fn logistic(x: f64) -> f64 {
        1.0 / (1.0 + (-x).exp())
    }

    #[test]
    fn one_unit_follows_the_formula() {
        let layer = GruLayer {
            weight_ih: vec![0.5, -0.25, 1.0],
            weight_hh: vec![0.1, 0.2, -0.3],
            bias_ih: vec![0.01, 0.02, 0.03],
            bias_hh: vec![-0.01, 0.04, 0.05],
        };
        let model = Recurrent::new(vec![layer], vec![2.0], vec![0.5], 0).expect("valid");
        let mut rollouts = model.begin_rollouts().expect("it runs");
        let mut next = vec![0.0; LANES];
        let mut h = 0.0_f64;
        for x in [0.7_f64, -1.2, 0.3] {
            rollouts.step(&[x as f32; LANES], &mut next).expect("a step");
            let r = logistic(0.5 * x + 0.01 + 0.1 * h - 0.01);
            let z = logistic(-0.25 * x + 0.02 + 0.2 * h + 0.04);
            let n = (x + 0.03 + r * (-0.3 * h + 0.05)).tanh();
            h = (1.0 - z) * n + z * h;
            for &value in &next {
                assert!((f64::from(value) - (2.0 * h + 0.5)).abs() < 1e-6, "{value} {h}");
            }
        }
        rollouts.forget(3);
        rollouts.step(&[0.0; LANES], &mut next).expect("a step");
        assert!(next[3] != next[2] && next[2] == next[4], "only one lane forgets");
    }

    #[test]
    fn a_flat_vector_holds_all_parameters() {
        let model = Recurrent::random(3, 5, 2, 19, Seed::new(4));
        let flat = model.flat();
        assert_eq!(flat.len(), 15 * (3 + 5 + 2) + 15 * (5 + 5 + 2) + 3 * 5 + 3);
        assert!(flat.iter().all(|value| value.abs() < 1.0 / 5.0_f32.sqrt()));
        let other = Recurrent::random(3, 5, 2, 19, Seed::new(5));
        assert!(other != model);
        assert_eq!(other.with_flat(&flat), model);
    }

    #[test]
    fn sizes_must_agree() {
        let layer = GruLayer {
            weight_ih: vec![0.0; 6],
            weight_hh: vec![0.0; 3],
            bias_ih: vec![0.0; 3],
            bias_hh: vec![0.0; 3],
        };
        let error = Recurrent::new(vec![layer], vec![0.0], vec![0.0], 0).expect_err("two inputs");
        assert!(error.to_string().contains("layer 0"), "{error}");
    }
}
