//! A pass of a GRU over whole sequences: its outputs, and the gradient of their squared error by back-propagation through
//! time.

use std::ops::Range;

use calib_nn::{Matrix, multiply};

use crate::{
    Recurrent,
    gates::{Activated, Products, activate},
};

/// The positions of a layer's parameters in the flat vector of a model.
#[derive(Clone, Debug)]
struct LayerPlace {
    inputs: usize,
    weight_ih: Range<usize>,
    weight_hh: Range<usize>,
    bias_ih: Range<usize>,
    bias_hh: Range<usize>,
}

/// The sizes of a GRU, and the positions of its parameters in the order of [`Recurrent::flat`].
#[derive(Clone, Debug)]
pub(crate) struct GruShape {
    pub(crate) columns: usize,
    hidden: usize,
    layers: Vec<LayerPlace>,
    head_weight: Range<usize>,
    head_bias: Range<usize>,
    pub(crate) parameters: usize,
}

impl GruShape {
    pub(crate) fn of(model: &Recurrent) -> Self {
        let hidden = model.hidden();
        let columns = model.head().1.len();
        let mut end = 0;
        let layers = model
            .layers()
            .iter()
            .map(|layer| LayerPlace {
                inputs: layer.weight_ih.len() / (3 * hidden),
                weight_ih: take(&mut end, layer.weight_ih.len()),
                weight_hh: take(&mut end, layer.weight_hh.len()),
                bias_ih: take(&mut end, layer.bias_ih.len()),
                bias_hh: take(&mut end, layer.bias_hh.len()),
            })
            .collect();
        let head_weight = take(&mut end, columns * hidden);
        let head_bias = take(&mut end, columns);
        Self { columns, hidden, layers, head_weight, head_bias, parameters: end }
    }
}

/// Returns the next `count` places, from `end` on, and moves `end` behind them.
fn take(end: &mut usize, count: usize) -> Range<usize> {
    let start = *end;
    *end += count;
    start..*end
}

/// Activations of one layer over a sequence, each `[step, sequence, unit]`.
#[derive(Clone, Debug, Default)]
struct LayerPass {
    /// Products of the inputs with the three gates. Later the gradients with respect to these products.
    of_input: Vec<f32>,
    /// Gradients with respect to the products of the hidden state.
    of_hidden: Vec<f32>,
    reset: Vec<f32>,
    keep: Vec<f32>,
    new: Vec<f32>,
    /// `W_hn h + b_hn`.
    new_hidden: Vec<f32>,
    /// The hidden state after each step. It starts with zeros for the state before the first step.
    hidden: Vec<f32>,
    /// Gradient with respect to the hidden state after each step.
    d_hidden: Vec<f32>,
}

/// Buffers for a pass over some sequences, and its gradient.
#[derive(Clone, Debug)]
pub(crate) struct GruPass {
    layers: Vec<LayerPass>,
    /// Products of one step.
    step: Vec<f32>,
    outputs: Vec<f32>,
    /// The gradient, in the order of [`Recurrent::flat`].
    pub(crate) gradient: Vec<f32>,
}

/// Training sequences, `[step, sequence, column]`.
#[derive(Clone, Copy)]
pub(crate) struct Sequences<'a> {
    pub(crate) inputs: &'a [f32],
    pub(crate) targets: &'a [f32],
    pub(crate) length: usize,
    pub(crate) count: usize,
}

impl GruPass {
    pub(crate) fn new(shape: &GruShape) -> Self {
        Self {
            layers: vec![LayerPass::default(); shape.layers.len()],
            step: Vec::new(),
            outputs: Vec::new(),
            gradient: vec![0.0; shape.parameters],
        }
    }

    /// Returns the sum of squared errors of all outputs. Each sequence starts with an empty hidden state.
    pub(crate) fn squared_error(
        &mut self,
        shape: &GruShape,
        parameters: &[f32],
        sequences: Sequences<'_>,
    ) -> f64 {
        let Sequences { inputs, targets, length, count } = sequences;
        let (units, rows) = (shape.hidden, length * count);
        let gates = 3 * units;
        self.step.resize(count * gates, 0.0);
        for (number, place) in shape.layers.iter().enumerate() {
            let (before, from) = self.layers.split_at_mut(number);
            let layer = &mut from[0];
            let input = before.last().map_or(inputs, |below| &below.hidden[count * units..]);
            layer.resize(rows, count, units);
            multiply(
                &mut layer.of_input,
                Matrix::new(input, rows, place.inputs),
                Matrix::new(&parameters[place.weight_ih.clone()], gates, place.inputs).transposed(),
            );
            let weight_hh = Matrix::new(&parameters[place.weight_hh.clone()], gates, units);
            let bias_ih = &parameters[place.bias_ih.clone()];
            let bias_hh = &parameters[place.bias_hh.clone()];
            layer.hidden[..count * units].fill(0.0);
            for step in 0..length {
                let (past, hidden) = layer.hidden.split_at_mut((step + 1) * count * units);
                let past = &past[step * count * units..];
                if step == 0 {
                    self.step.fill(0.0);
                } else {
                    multiply(
                        &mut self.step,
                        Matrix::new(past, count, units),
                        weight_hh.transposed(),
                    );
                }
                for sequence in 0..count {
                    let row = step * count + sequence;
                    let own = row * units..(row + 1) * units;
                    activate(
                        Products {
                            of_input: &layer.of_input[row * gates..][..gates],
                            of_hidden: &self.step[sequence * gates..][..gates],
                            bias_ih,
                            bias_hh,
                        },
                        &past[sequence * units..][..units],
                        Activated {
                            reset: &mut layer.reset[own.clone()],
                            keep: &mut layer.keep[own.clone()],
                            new: &mut layer.new[own.clone()],
                            new_hidden: &mut layer.new_hidden[own],
                            hidden: &mut hidden[sequence * units..][..units],
                        },
                    );
                }
            }
        }
        let last = &self.layers[self.layers.len() - 1].hidden[count * units..];
        let columns = shape.columns;
        self.outputs.resize(rows * columns, 0.0);
        multiply(
            &mut self.outputs,
            Matrix::new(last, rows, units),
            Matrix::new(&parameters[shape.head_weight.clone()], columns, units).transposed(),
        );
        let bias = &parameters[shape.head_bias.clone()];
        let mut squares = 0.0;
        let both = self.outputs.chunks_exact_mut(columns).zip(targets.chunks_exact(columns));
        for (outputs, targets) in both {
            for ((output, bias), target) in outputs.iter_mut().zip(bias).zip(targets) {
                *output += bias - target;
                squares += f64::from(*output).powi(2);
            }
        }
        squares
    }

    /// Computes the gradient of `scale` times half the squared error of the preceding call of
    /// [`squared_error`](Self::squared_error).
    pub(crate) fn back(
        &mut self,
        shape: &GruShape,
        parameters: &[f32],
        sequences: Sequences<'_>,
        scale: f32,
    ) {
        let Sequences { inputs, length, count, .. } = sequences;
        let units = shape.hidden;
        let rows = length * count;
        let columns = shape.columns;
        let gates = 3 * units;
        for error in &mut self.outputs {
            *error *= scale;
        }
        let top = self.layers.len() - 1;
        let gradient = &mut self.gradient;
        {
            let errors = Matrix::new(&self.outputs, rows, columns);
            let layer = &mut self.layers[top];
            let hidden = Matrix::new(&layer.hidden[count * units..], rows, units);
            multiply(&mut gradient[shape.head_weight.clone()], errors.transposed(), hidden);
            sum_rows(&self.outputs, &mut gradient[shape.head_bias.clone()]);
            let weight = Matrix::new(&parameters[shape.head_weight.clone()], columns, units);
            multiply(&mut layer.d_hidden, errors, weight);
        }
        let mut carry = vec![0.0; count * units];
        let mut through = vec![0.0; count * units];
        for number in (0..=top).rev() {
            let place = &shape.layers[number];
            let (below, from) = self.layers.split_at_mut(number);
            let layer = &mut from[0];
            let weight_hh = Matrix::new(&parameters[place.weight_hh.clone()], gates, units);
            carry.fill(0.0);
            for step in (0..length).rev() {
                for sequence in 0..count {
                    let row = step * count + sequence;
                    let own = row * units..(row + 1) * units;
                    let carry = &mut carry[sequence * units..][..units];
                    for (sum, d_hidden) in carry.iter_mut().zip(&layer.d_hidden[own.clone()]) {
                        *sum += d_hidden;
                    }
                    differentiate(
                        carry,
                        Past {
                            reset: &layer.reset[own.clone()],
                            keep: &layer.keep[own.clone()],
                            new: &layer.new[own.clone()],
                            new_hidden: &layer.new_hidden[own.clone()],
                            hidden: &layer.hidden[own],
                        },
                        &mut layer.of_input[row * gates..][..gates],
                        &mut layer.of_hidden[row * gates..][..gates],
                    );
                }
                if step > 0 {
                    let own = step * count * gates..(step + 1) * count * gates;
                    let gradients = Matrix::new(&layer.of_hidden[own], count, gates);
                    multiply(&mut through, gradients, weight_hh);
                    for (sum, through) in carry.iter_mut().zip(&through) {
                        *sum += through;
                    }
                }
            }
            let of_input = Matrix::new(&layer.of_input, rows, gates);
            let of_hidden = Matrix::new(&layer.of_hidden, rows, gates);
            let input = below.last().map_or(inputs, |below| &below.hidden[count * units..]);
            let input = Matrix::new(input, rows, place.inputs);
            multiply(&mut gradient[place.weight_ih.clone()], of_input.transposed(), input);
            let past = Matrix::new(&layer.hidden[..rows * units], rows, units);
            multiply(&mut gradient[place.weight_hh.clone()], of_hidden.transposed(), past);
            sum_rows(&layer.of_input, &mut gradient[place.bias_ih.clone()]);
            sum_rows(&layer.of_hidden, &mut gradient[place.bias_hh.clone()]);
            if let Some(below) = below.last_mut() {
                let weight = Matrix::new(&parameters[place.weight_ih.clone()], gates, place.inputs);
                multiply(&mut below.d_hidden, of_input, weight);
            }
        }
    }
}

impl LayerPass {
    fn resize(&mut self, rows: usize, count: usize, units: usize) {
        for gates in [&mut self.of_input, &mut self.of_hidden] {
            gates.resize(rows * 3 * units, 0.0);
        }
        let Self { reset, keep, new, new_hidden, d_hidden, .. } = self;
        for values in [reset, keep, new, new_hidden, d_hidden] {
            values.resize(rows * units, 0.0);
        }
        self.hidden.resize((rows + count) * units, 0.0);
    }
}

/// The activations of one row, and the hidden state before them.
#[derive(Clone, Copy)]
struct Past<'a> {
    reset: &'a [f32],
    keep: &'a [f32],
    new: &'a [f32],
    new_hidden: &'a [f32],
    hidden: &'a [f32],
}

/// Computes the gradients with respect to the products of the gates, from the gradient of the hidden state. Replaces the
/// latter by the direct gradient of the previous hidden state.
fn differentiate(
    d_hidden: &mut [f32],
    past: Past<'_>,
    of_input: &mut [f32],
    of_hidden: &mut [f32],
) {
    let units = d_hidden.len();
    for unit in 0..units {
        let reset = past.reset[unit];
        let keep = past.keep[unit];
        let new = past.new[unit];
        let d = d_hidden[unit];
        let d_new = d * (1.0 - keep) * (1.0 - new * new);
        let d_keep = d * (past.hidden[unit] - new) * keep * (1.0 - keep);
        let d_reset = d_new * past.new_hidden[unit] * reset * (1.0 - reset);
        of_input[unit] = d_reset;
        of_input[units + unit] = d_keep;
        of_input[2 * units + unit] = d_new;
        of_hidden[unit] = d_reset;
        of_hidden[units + unit] = d_keep;
        of_hidden[2 * units + unit] = d_new * reset;
        d_hidden[unit] = d * keep;
    }
}

/// Computes the sum of each column over the rows.
fn sum_rows(rows: &[f32], sums: &mut [f32]) {
    sums.fill(0.0);
    for row in rows.chunks_exact(sums.len()) {
        for (sum, value) in sums.iter_mut().zip(row) {
            *sum += value;
        }
    }
}
