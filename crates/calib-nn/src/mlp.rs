use std::ops::Range;

use calib_core::Seed;
use pulp::Arch;

use crate::{
    Adam, Matrix, Workspace,
    aligned::{Aligned, aligned},
    kernels::{add_bias, add_bias_and_rectify, mask_and_sum_rows, sum_rows},
    narrow::{Backward, Forward},
    product::multiply,
    sink::Kept,
};

/// The position of one layer's parameters in the flat vector.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Layer {
    /// Number of input values.
    pub inputs: usize,
    /// Number of output values.
    pub outputs: usize,
    /// Weights `[inputs, outputs]`, row after row (the transpose of PyTorch's `Linear.weight`).
    pub weights: Range<usize>,
    /// Biases `[outputs]`.
    pub bias: Range<usize>,
}

/// The number of parameters does not fit a network.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
#[error("a network of layer sizes {sizes:?} has {expected} parameters, got {got}")]
pub struct ParameterCountError {
    /// Layer sizes, input first.
    pub sizes: Vec<usize>,
    /// Number of parameters of such a network.
    pub expected: usize,
    /// Number of parameters that was given.
    pub got: usize,
}

/// A multilayer perceptron: h₀ = x, hₗ = max(hₗ₋₁ Wₗ + bₗ, 0), and output = h W + b without `ReLU`.
///
/// Arithmetic is f32. The same parameters, input and number of rows give the same bytes.
#[derive(Clone, Debug, PartialEq)]
pub struct Mlp {
    layers: Vec<Layer>,
    parameters: Aligned<f32>,
}

impl Mlp {
    /// Creates a network of the given layer sizes, input first, output last.
    ///
    /// Weights and biases of a layer with n inputs are uniform in ±1/√n, PyTorch's default for `Linear`. They are drawn
    /// from `seed` in the order of the flat vector.
    ///
    /// # Panics
    /// If there are fewer than two sizes or one is zero.
    pub fn new(sizes: &[usize], seed: Seed) -> Self {
        let layers = layout(sizes);
        let mut rng = seed.rng();
        let mut parameters = Vec::with_capacity(count_of(&layers));
        for layer in &layers {
            let bound = 1.0 / (layer.inputs as f64).sqrt();
            let count = layer.weights.len() + layer.bias.len();
            parameters.extend((0..count).map(|_| rng.uniform(-bound, bound) as f32));
        }
        Self { layers, parameters: aligned(&parameters) }
    }

    /// Creates a network with known parameters, in the order of [`Mlp::layers`].
    ///
    /// # Errors
    /// If the number of parameters does not fit the sizes.
    ///
    /// # Panics
    /// If there are fewer than two sizes or one is zero.
    pub fn from_parameters(
        sizes: &[usize],
        parameters: &[f32],
    ) -> Result<Self, ParameterCountError> {
        let layers = layout(sizes);
        let expected = count_of(&layers);
        if parameters.len() == expected {
            Ok(Self { layers, parameters: aligned(parameters) })
        } else {
            Err(ParameterCountError { sizes: sizes.to_vec(), expected, got: parameters.len() })
        }
    }

    /// Returns the layers from input to output.
    pub fn layers(&self) -> &[Layer] {
        &self.layers
    }

    /// Returns the layer sizes, input first, output last.
    pub fn sizes(&self) -> Vec<usize> {
        let outputs = self.layers.iter().map(|layer| layer.outputs);
        std::iter::once(self.inputs()).chain(outputs).collect()
    }

    /// Returns the number of values in an input row.
    pub fn inputs(&self) -> usize {
        self.layers[0].inputs
    }

    /// Returns the number of values in an output row.
    pub fn outputs(&self) -> usize {
        self.layers[self.layers.len() - 1].outputs
    }

    /// Returns the number of parameters.
    pub fn parameter_count(&self) -> usize {
        self.parameters.len()
    }

    /// Returns all parameters.
    pub fn parameters(&self) -> &[f32] {
        &self.parameters
    }

    /// Returns all parameters, for an optimiser or a copy.
    pub fn parameters_mut(&mut self) -> &mut [f32] {
        &mut self.parameters
    }

    /// Returns outputs `[rows, outputs]` for inputs `[rows, inputs]`, both row after row.
    ///
    /// # Panics
    /// If `input` is not whole rows, or more rows than the workspace was made for.
    pub fn forward<'w>(&self, input: &[f32], workspace: &'w mut Workspace) -> &'w [f32] {
        let rows = rows_of(input, self.inputs(), workspace.capacity());
        let last = self.layers.len() - 1;
        let Workspace { activations, narrow, .. } = &mut *workspace;
        if let Some(narrow) = narrow {
            let Self { layers, parameters } = self;
            Arch::new().dispatch(Forward { layers, parameters, input, rows, activations, narrow });
            return &workspace.activations[last][..rows * self.outputs()];
        }
        for (index, layer) in self.layers.iter().enumerate() {
            let (before, after) = workspace.activations.split_at_mut(index);
            let input = before.last().map_or(input, |values| &values[..rows * layer.inputs]);
            let output = &mut after[0][..rows * layer.outputs];
            multiply(output, Matrix::new(input, rows, layer.inputs), self.weights(layer));
            let bias = &self.parameters[layer.bias.clone()];
            if index == last {
                add_bias(output, bias);
            } else {
                add_bias_and_rectify(output, bias);
            }
        }
        &workspace.activations[last][..rows * self.outputs()]
    }

    /// Returns the gradients of all parameters, in their order. The input is the gradient of a loss with respect to the
    /// output `[rows, outputs]` of the latest [`Mlp::forward`] with this workspace.
    ///
    /// The gradient may cover only the first `rows` of that forward pass. Further rows (targets, predictions) then cost
    /// nothing here. `input` is the input of that pass. The gradient with respect to it is not computed.
    ///
    /// # Panics
    /// If `output_gradient` is not whole rows, or more rows than `input` has.
    pub fn backward<'w>(
        &self,
        input: &[f32],
        output_gradient: &[f32],
        workspace: &'w mut Workspace,
    ) -> &'w [f32] {
        let rows = self.gradient_rows(input, output_gradient, workspace);
        let Self { layers, parameters } = self;
        if let Some((mut buffers, gradients)) = workspace.narrow_buffers(layers, rows) {
            buffers.set_weights(layers, parameters);
            let sink = Kept(gradients);
            Arch::new().dispatch(Backward { layers, input, output_gradient, rows, buffers, sink });
            return &workspace.gradients;
        }
        let Workspace { activations, deltas: [delta, previous], gradients, .. } = workspace;
        delta[..output_gradient.len()].copy_from_slice(output_gradient);
        for (index, layer) in self.layers.iter().enumerate().rev() {
            let layer_delta = &mut delta[..rows * layer.outputs];
            let bias_gradient = &mut gradients[layer.bias.clone()];
            match activations.get(index) {
                Some(activation) if index + 1 < self.layers.len() => {
                    let activation = &activation[..rows * layer.outputs];
                    mask_and_sum_rows(layer_delta, activation, bias_gradient);
                }
                _ => sum_rows(layer_delta, bias_gradient),
            }
            let layer_delta = Matrix::new(layer_delta, rows, layer.outputs);
            let layer_input = match index {
                0 => &input[..rows * layer.inputs],
                _ => &activations[index - 1][..rows * layer.inputs],
            };
            multiply(
                &mut gradients[layer.weights.clone()],
                Matrix::new(layer_input, rows, layer.inputs).transposed(),
                layer_delta,
            );
            if index > 0 {
                let previous = &mut previous[..rows * layer.inputs];
                multiply(previous, layer_delta, self.weights(layer).transposed());
            }
            std::mem::swap(delta, previous);
        }
        gradients
    }

    /// Takes a step of `adam` against the gradients of [`Mlp::backward`], with the same bytes. The workspace may not
    /// contain the gradients afterwards.
    ///
    /// # Panics
    /// As [`Mlp::backward`], or if `adam` has not as many moments as there are parameters.
    pub fn learn(
        &mut self,
        input: &[f32],
        output_gradient: &[f32],
        workspace: &mut Workspace,
        adam: &mut Adam,
    ) {
        let rows = self.gradient_rows(input, output_gradient, workspace);
        let Self { layers, parameters } = &mut *self;
        if let Some((mut buffers, _)) = workspace.narrow_buffers(layers, rows) {
            buffers.set_weights(layers, parameters);
            let sink = adam.begin(parameters);
            Arch::new().dispatch(Backward { layers, input, output_gradient, rows, buffers, sink });
        } else {
            let gradients = self.backward(input, output_gradient, workspace);
            adam.step(&mut self.parameters, gradients);
        }
    }

    /// Returns the number of rows that a gradient covers.
    fn gradient_rows(&self, input: &[f32], gradient: &[f32], workspace: &Workspace) -> usize {
        let rows = rows_of(gradient, self.outputs(), workspace.capacity());
        assert!(
            input.len() >= rows * self.inputs(),
            "a gradient covers at most the rows of its forward pass"
        );
        rows
    }

    fn weights(&self, layer: &Layer) -> Matrix<'_> {
        Matrix::new(&self.parameters[layer.weights.clone()], layer.inputs, layer.outputs)
    }
}

fn layout(sizes: &[usize]) -> Vec<Layer> {
    assert!(sizes.len() >= 2, "a network has an input and an output");
    assert!(sizes.iter().all(|&size| size > 0), "a layer has at least one unit");
    let mut start = 0;
    sizes
        .windows(2)
        .map(|pair| {
            let inputs = pair[0];
            let outputs = pair[1];
            let middle = start + inputs * outputs;
            let layer =
                Layer { inputs, outputs, weights: start..middle, bias: middle..middle + outputs };
            start = layer.bias.end;
            layer
        })
        .collect()
}

fn count_of(layers: &[Layer]) -> usize {
    layers.last().map_or(0, |layer| layer.bias.end)
}

fn rows_of(values: &[f32], width: usize, capacity: usize) -> usize {
    let rows = values.len() / width;
    assert_eq!(values.len(), rows * width, "values come in whole rows of {width}");
    assert!(rows <= capacity, "the workspace holds {capacity} rows, got {rows}");
    rows
}

#[cfg(test)]
mod tests;
