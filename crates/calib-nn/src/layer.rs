use std::ops::Range;

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
