//! The passes through a network, which need a workspace.

use pulp::Arch;

use super::Mlp;
use crate::{
    Adam, Layer, Matrix, Workspace,
    kernels::{add_bias, add_bias_and_rectify, mask_and_sum_rows, sum_rows},
    narrow::{Backward, Forward},
    product::multiply,
    sink::Kept,
};

impl Mlp {
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

fn rows_of(values: &[f32], width: usize, capacity: usize) -> usize {
    let rows = values.len() / width;
    assert_eq!(values.len(), rows * width, "values come in whole rows of {width}");
    assert!(rows <= capacity, "the workspace holds {capacity} rows, got {rows}");
    rows
}
