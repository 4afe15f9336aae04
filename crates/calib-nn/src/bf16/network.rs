use std::ops::Range;

use pulp::Scalar;

use super::{
    layout::{Fill, Pairing, Panels, Rows},
    number::{bias, join, without_small},
    panel::{HALF, PANEL},
    processor::Processor,
    product::{Dot, LeftOperand, Product},
    steps::{Activations, Errors, Gradient, Operands},
    workspace::{Bf16Batch, Bf16Workspace, Buffers},
};
use crate::{
    Layer, Mlp, Optimiser,
    sink::{Kept, Sink},
};

/// The weights of an [`Mlp`] with hidden layers and one output, rounded to bfloat16 and laid out for its products.
///
/// The network itself keeps its parameters in single precision. After each change, [`Bf16Network::set`] rounds them again. Outputs and
/// gradients are in single precision. The output of a row does not depend on other rows. The gradient of a batch depends only on the
/// rows that it covers.
#[derive(Clone, Debug)]
pub struct Bf16Network {
    processor: Processor,
    hidden: Vec<HiddenLayer>,
    output: OutputLayer,
}

#[derive(Clone, Debug)]
struct HiddenLayer {
    inputs: usize,
    outputs: usize,
    weights: Panels,
    /// The transpose. It is empty for the first layer, whose inputs need no errors.
    transposed: Panels,
    /// The bias, padded with zeros to whole panels.
    bias: Vec<[f32; PANEL]>,
    /// The positions of the gradients.
    places: Layer,
}

#[derive(Clone, Debug)]
struct OutputLayer {
    /// The weights, one row.
    weights: Rows,
    /// The transpose, with one column.
    transposed: Panels,
    bias: f32,
    places: Layer,
}

impl Bf16Network {
    /// Rounds the weights of `network`.
    ///
    /// # Panics
    /// If it has no hidden layer, or more than one output.
    pub fn new(network: &Mlp) -> Self {
        Self::on(Processor::detect(), network)
    }

    /// Rounds the weights, but multiplies as a processor without the special instructions: slower, with the same bytes.
    ///
    /// # Panics
    /// As [`Bf16Network::new`].
    pub fn portable(network: &Mlp) -> Self {
        Self::on(Processor::Portable(pulp::Arch::new()), network)
    }

    pub(super) fn on(processor: Processor, network: &Mlp) -> Self {
        let Some((output, hidden)) = network.layers().split_last() else {
            unreachable!("a network has layers");
        };
        assert!(!hidden.is_empty() && output.outputs == 1, "hidden layers, and one output");
        let mut rounded = Self {
            processor,
            hidden: hidden
                .iter()
                .enumerate()
                .map(|(number, layer)| HiddenLayer {
                    inputs: layer.inputs,
                    outputs: layer.outputs,
                    weights: Panels::new(Pairing::Features, layer.inputs, layer.outputs),
                    transposed: match number {
                        0 => Panels::new(Pairing::Features, 0, 0),
                        _ => Panels::new(Pairing::Features, layer.outputs, layer.inputs),
                    },
                    bias: vec![[0.0; PANEL]; layer.outputs.div_ceil(PANEL)],
                    places: layer.clone(),
                })
                .collect(),
            output: OutputLayer {
                weights: Rows::new(1, output.inputs),
                transposed: Panels::new(Pairing::Features, 1, output.inputs),
                bias: 0.0,
                places: output.clone(),
            },
        };
        rounded.set(network);
        rounded
    }

    /// Rounds the parameters of `network`, which must have the shape of the first one.
    pub fn set(&mut self, network: &Mlp) {
        let parameters = network.parameters();
        for (number, layer) in self.hidden.iter_mut().enumerate() {
            let weights = &parameters[layer.places.weights.clone()];
            Fill::Panels(&mut layer.weights, layer.outputs).with(self.processor, weights);
            if number > 0 {
                Fill::Transposed(&mut layer.transposed, layer.outputs)
                    .with(self.processor, weights);
            }
            let values = &parameters[layer.places.bias.clone()];
            for (to, &value) in layer.bias.as_flattened_mut().iter_mut().zip(values) {
                *to = bias(value);
            }
        }
        let OutputLayer { weights, transposed, bias: of_output, places } = &mut self.output;
        let values = &parameters[places.weights.clone()];
        Fill::Rows(weights).with(self.processor, values);
        Fill::Panels(transposed, values.len()).with(self.processor, values);
        *of_output = bias(parameters[places.bias.start]);
    }

    /// Returns the outputs for `rows` of a batch, in single precision.
    ///
    /// If `rows` starts at the first row, the next [`Bf16Network::backward`] can use this pass.
    ///
    /// # Panics
    /// If the batch has fewer rows, or `rows` exceeds the workspace's capacity.
    pub fn forward<'w>(
        &self,
        batch: &Bf16Batch,
        rows: Range<usize>,
        workspace: &'w mut Bf16Workspace,
    ) -> &'w [f32] {
        let count = rows.len();
        let capacity = workspace.capacity();
        assert!(rows.end <= batch.len(), "a batch of {} rows has rows {rows:?}", batch.len());
        assert!(count <= capacity, "the workspace holds {capacity} rows, got {count}");
        let learnt = if rows.start == 0 { batch.learnt().min(count) } else { 0 };
        let Bf16Workspace { hidden, values, .. } = workspace;
        for (number, layer) in self.hidden.iter().enumerate() {
            let (before, after) = hidden.split_at_mut(number);
            let left = match before.last() {
                None => LeftOperand::Rows(&batch.rows, rows.start),
                Some(before) => LeftOperand::Rows(&before.activations, 0),
            };
            let Buffers { activations, learnt: panels, .. } = &mut after[0];
            panels.set_rows(learnt);
            let to = Operands { rows: activations, panels, learnt };
            let finish = &mut Activations { bias: &layer.bias, to };
            let right = &layer.weights;
            let columns = layer.outputs;
            self.processor.run(Product { left, rows: count, right, columns, finish });
        }
        let activations = &hidden[hidden.len() - 1].activations;
        let weights = row_of(&self.output.weights, 0);
        for (row, value) in values[..count].iter_mut().enumerate() {
            let sum = self.processor.run(Dot { a: row_of(activations, row), b: weights });
            *value = sum + self.output.bias;
        }
        &values[..count]
    }

    /// Writes the gradients of all parameters, in their order, to `gradients`. The input is the gradient of a loss with respect to the
    /// outputs of the training rows in the latest [`Bf16Network::forward`] with this workspace.
    ///
    /// The gradients of biases are sums of errors before rounding.
    ///
    /// # Panics
    /// If there is not one value for each training row, or not one gradient per parameter.
    pub fn backward(
        &self,
        batch: &Bf16Batch,
        output_gradient: &[f32],
        workspace: &mut Bf16Workspace,
        gradients: &mut [f32],
    ) {
        let parameters = self.output.places.bias.end;
        assert_eq!(gradients.len(), parameters, "one gradient a parameter");
        self.descend(batch, output_gradient, workspace, &mut Kept(gradients));
    }

    /// Takes one step of `optimiser` for `network`, against the gradients of [`Bf16Network::backward`], and then rounds its new
    /// parameters. `self` must contain the rounded parameters of `network`.
    ///
    /// The result is the same as computing the gradients, passing them to [`Optimiser::step`], and calling [`Bf16Network::set`]. This
    /// method avoids a pass over all gradients and moments: it updates each tile as soon as the products provide its gradients.
    ///
    /// # Panics
    /// If there is not one value for each training row, or not one moment per parameter.
    pub fn learn(
        &mut self,
        network: &mut Mlp,
        optimiser: &mut Optimiser,
        batch: &Bf16Batch,
        output_gradient: &[f32],
        workspace: &mut Bf16Workspace,
    ) {
        let parameters = network.parameters_mut();
        match optimiser {
            Optimiser::Adam(adam) => {
                self.descend(batch, output_gradient, workspace, &mut adam.begin(parameters));
            }
            Optimiser::Sgd(sgd) => {
                self.descend(batch, output_gradient, workspace, &mut sgd.begin(parameters));
            }
        }
        self.set(network);
    }

    /// Passes the gradients of all parameters to a sink.
    fn descend<S: Sink>(
        &self,
        batch: &Bf16Batch,
        output_gradient: &[f32],
        workspace: &mut Bf16Workspace,
        sink: &mut S,
    ) {
        let count = output_gradient.len();
        assert_eq!(count, batch.learnt(), "a gradient for each row that is learnt from");
        let Bf16Workspace { hidden, output_pairs, output_rows, bias_gradient, .. } = workspace;
        for (to, two) in output_pairs.iter_mut().zip(output_gradient.chunks(2)) {
            let second = two.get(1).map_or(0.0, |&second| without_small(Scalar, second));
            *to = join(Scalar, without_small(Scalar, two[0]), second);
        }
        Fill::Rows(output_rows).with(self.processor, output_gradient);
        let OutputLayer { transposed, places, .. } = &self.output;
        sink.take(Scalar, places.bias.start, &[output_gradient.iter().sum()]);
        let last = &hidden[hidden.len() - 1];
        self.processor.run(Product {
            left: LeftOperand::Row(output_pairs),
            rows: 1,
            right: &last.learnt,
            columns: places.inputs,
            finish: &mut Gradient { sink, start: places.weights.start, columns: places.inputs },
        });
        let mut left = LeftOperand::Rows(output_rows, 0);
        let mut right = transposed;
        let mut buffers = &mut hidden[..];
        for layer in self.hidden.iter().rev() {
            let Some((own, before)) = buffers.split_last_mut() else {
                unreachable!("buffers of every hidden layer");
            };
            let Buffers { activations, error_rows, error_panels, .. } = own;
            error_panels.set_rows(count);
            let to = Operands { rows: error_rows, panels: error_panels, learnt: count };
            let finish = &mut Errors { activations, bias_gradient, to };
            self.processor.run(Product {
                left,
                rows: count,
                right,
                columns: layer.outputs,
                finish,
            });
            let bias_gradient = &bias_gradient.as_flattened()[..layer.outputs];
            sink.take(Scalar, layer.places.bias.start, bias_gradient);
            let inputs = before.last().map_or(&batch.panels, |before| &before.learnt);
            let start = layer.places.weights.start;
            let columns = layer.outputs;
            self.processor.run(Product {
                left: LeftOperand::Columns(inputs),
                rows: layer.inputs,
                right: error_panels,
                columns,
                finish: &mut Gradient { sink, start, columns },
            });
            (left, right) = (LeftOperand::Rows(error_rows, 0), &layer.transposed);
            buffers = before;
        }
    }
}

/// Returns all pairs of one row.
fn row_of(rows: &Rows, row: usize) -> &[[u32; HALF]] {
    &rows.from(row)[..rows.stride()]
}

#[cfg(test)]
mod tests;
