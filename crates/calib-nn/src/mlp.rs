use calib_core::Seed;

use crate::{
    Layer,
    aligned::{Aligned, aligned},
};

mod passes;

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

#[cfg(test)]
mod tests;
