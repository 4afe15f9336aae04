//! Passes for small batches through narrow networks.
//!
//! Their weights stay in the processor's nearest cache, and packing them takes as long as the products. So rows of weights are read in
//! place. Every sum has the order of [`multiply`](crate::multiply), one multiply-add after another, but skips the products of units that
//! `ReLU` has set to zero. This changes no finite sum, on any processor.

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

/// Maximum number of units in a hidden layer.
const UNITS: usize = 128;

/// Maximum number of inputs and outputs of a network, few of which are zero.
const INPUTS: usize = 32;
const OUTPUTS: usize = 8;

/// Maximum number of rows in a batch. Above it packing pays, and a column needs more than one word of bits.
const ROWS: usize = WORD;

/// Buffers of passes through a narrow network.
#[derive(Clone, Debug)]
pub(crate) struct Narrow {
    /// The mask of the network's inputs: all are used.
    all: Vec<u64>,
    /// The units of each hidden layer that are not zero, as bits `[rows, words]`.
    active: Vec<Vec<u64>>,
    /// Weights of the last layer, with padded rows.
    output_weights: Aligned<f32>,
    /// Weights of the layers after the first, transposed.
    transposed: Vec<Aligned<f32>>,
    /// The errors that are not zero, as bits `[rows, words]`, of a layer and of the previous one.
    errors: [Vec<u64>; 2],
    /// The rows in which each input of a layer is not zero: one word of bits per input.
    columns: Vec<u64>,
    bias_gradient: Aligned<f32>,
    /// The gradient of the last layer's weights, transposed, and in the layout of the weights.
    output_gradient: [Aligned<f32>; 2],
}

impl Narrow {
    /// Creates buffers for batches of this many rows, if a network of these layers is narrow.
    pub(crate) fn new(layers: &[Layer], rows: usize) -> Option<Self> {
        let (output, hidden) = layers.split_last()?;
        let inputs = hidden.first()?.inputs;
        let outputs = output.outputs;
        // A single output is a dot product, whose sums have another order.
        let is_narrow = rows <= ROWS
            && inputs <= INPUTS
            && (2..=OUTPUTS).contains(&outputs)
            && hidden
                .iter()
                .all(|layer| layer.outputs.is_multiple_of(GROUP) && layer.outputs <= UNITS);
        if !is_narrow {
            return None;
        }
        Some(Self {
            all: vec![u64::MAX >> (WORD - inputs)],
            active: hidden.iter().map(|layer| vec![0; rows * words_of(layer.outputs)]).collect(),
            output_weights: filled(0.0, output.inputs * GROUP),
            transposed: layers[1..].iter().map(|layer| filled(0.0, layer.weights.len())).collect(),
            errors: std::array::from_fn(|_| vec![0; rows * words_of(UNITS)]),
            columns: vec![0; UNITS],
            bias_gradient: filled(0.0, UNITS),
            output_gradient: [filled(0.0, output.weights.len()), filled(0.0, output.weights.len())],
        })
    }

    /// Whether gradients over this many rows have the same order of sums in these passes.
    pub(crate) fn learns_from(layers: &[Layer], rows: usize) -> bool {
        rows > 1 && layers[1..].iter().all(|layer| rows * layer.inputs > FEW)
    }
}

/// Returns the number of words with one bit for each of `count` units.
fn words_of(count: usize) -> usize {
    count.div_ceil(WORD)
}

#[cfg(test)]
mod tests;
