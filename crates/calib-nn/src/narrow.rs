//! Passes of small batches through narrow networks.
//!
//! Their weights stay in the processor's nearest cache, and packing them takes as long as the products. So rows of weights are read
//! where they lie. Every sum has the order of [`multiply`](crate::multiply), one multiply-add after another, without the products of what `ReLU`
//! has set to zero. That changes no finite sum, on no processor.

mod backward;
mod forward;
mod products;
mod transpose;

use crate::{
    Layer,
    aligned::{Aligned, filled},
    product::FEW,
};

pub(crate) use backward::{Backward, NarrowBuffers};
pub(crate) use forward::Forward;
use products::{GROUP, WORD};

/// Most units of a hidden layer.
const UNITS: usize = 128;

/// Most inputs and outputs of a network, few of which are zero.
const INPUTS: usize = 32;
const OUTPUTS: usize = 8;

/// Most rows of a batch; beyond that packing pays, and a column has more than one word of bits.
const ROWS: usize = WORD;

/// Buffers of passes through a narrow network.
#[derive(Clone, Debug)]
pub(crate) struct Narrow {
    /// Which inputs of the network count: all.
    all: Vec<u64>,
    /// Which units of each hidden layer are not zero, `[rows, words]`.
    active: Vec<Vec<u64>>,
    /// Weights of the last layer, their rows filled up.
    output_weights: Aligned<f32>,
    /// Weights of the layers after the first, transposed.
    transposed: Vec<Aligned<f32>>,
    /// Which errors of a layer are not zero, `[rows, words]`, and of the layer before.
    errors: [Vec<u64>; 2],
    /// In which rows an input of a layer is not zero, a word for each input.
    columns: Vec<u64>,
    bias_gradient: Aligned<f32>,
    /// The gradient of the last layer's weights, transposed, and as the weights lie.
    output_gradient: [Aligned<f32>; 2],
}

impl Narrow {
    /// Buffers for batches of so many rows, if a network of these layers is narrow.
    pub(crate) fn new(layers: &[Layer], rows: usize) -> Option<Self> {
        let (output, hidden) = layers.split_last()?;
        let inputs = hidden.first()?.inputs;
        let outputs = output.outputs;
        let whole = |layer: &Layer| layer.outputs.is_multiple_of(GROUP) && layer.outputs <= UNITS;
        // A single output is a dot product, whose sums have another order.
        let is_narrow = rows <= ROWS
            && inputs <= INPUTS
            && (2..=OUTPUTS).contains(&outputs)
            && hidden.iter().all(whole);
        if !is_narrow {
            return None;
        }
        let bits = |units: usize| vec![0; rows * words_of(units)];
        Some(Self {
            all: vec![u64::MAX >> (WORD - inputs)],
            active: hidden.iter().map(|layer| bits(layer.outputs)).collect(),
            output_weights: filled(0.0, output.inputs * GROUP),
            transposed: layers[1..].iter().map(|layer| filled(0.0, layer.weights.len())).collect(),
            errors: [bits(UNITS), bits(UNITS)],
            columns: vec![0; UNITS],
            bias_gradient: filled(0.0, UNITS),
            output_gradient: [filled(0.0, output.weights.len()), filled(0.0, output.weights.len())],
        })
    }

    /// Whether gradients over so many rows have the order of sums that these passes have.
    pub(crate) fn learns_from(layers: &[Layer], rows: usize) -> bool {
        rows > 1 && layers[1..].iter().all(|layer| rows * layer.inputs > FEW)
    }
}

/// Words with a bit for each of so many units.
fn words_of(count: usize) -> usize {
    count.div_ceil(WORD)
}

#[cfg(test)]
mod tests;
