use super::{
    layout::{Fill, Pairing, Panels, Rows},
    panel::PANEL,
    processor::Processor,
};
use crate::Mlp;

/// Input rows in bfloat16, which any number of networks can share.
#[derive(Clone, Debug)]
pub struct Bf16Batch {
    processor: Processor,
    width: usize,
    count: usize,
    learnt: usize,
    pub(super) rows: Rows,
    pub(super) panels: Panels,
}

impl Bf16Batch {
    /// Creates a batch with capacity for `rows` rows of `width` values. At most the first `learnt` rows are training rows.
    pub fn new(width: usize, rows: usize, learnt: usize) -> Self {
        let rows = Rows::new(rows, width);
        let panels = Panels::new(Pairing::Neighbours, learnt, width);
        Self { processor: Processor::detect(), width, count: 0, learnt: 0, rows, panels }
    }

    /// Rounds these values, row after row. Gradients will cover the first `learnt` rows.
    ///
    /// # Panics
    /// If the values are not whole rows, or exceed the capacity.
    pub fn set(&mut self, values: &[f32], learnt: usize) {
        let count = values.len() / self.width;
        assert_eq!(values.len(), count * self.width, "values come in whole rows of {}", self.width);
        assert!(learnt <= count, "rows that are learnt from are among all rows");
        (self.count, self.learnt) = (count, learnt);
        Fill::Rows(&mut self.rows).with(self.processor, values);
        Fill::Panels(&mut self.panels, self.width)
            .with(self.processor, &values[..learnt * self.width]);
    }

    /// Returns the number of rows.
    pub fn len(&self) -> usize {
        self.count
    }

    /// Whether there is no row.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Returns the number of training rows.
    pub fn learnt(&self) -> usize {
        self.learnt
    }
}

/// Every buffer of a forward and backward pass in bfloat16, allocated once and reused.
///
/// Networks of the same layer sizes can use it in turn.
#[derive(Clone, Debug)]
pub struct Bf16Workspace {
    pub(super) hidden: Vec<Buffers>,
    /// Outputs of the network.
    pub(super) values: Vec<f32>,
    /// Gradients with respect to the outputs: as pairs, and as a matrix of one column.
    pub(super) output_pairs: Vec<u32>,
    pub(super) output_rows: Rows,
    /// Gradients of the biases of one layer, in whole panels.
    pub(super) bias_gradient: Vec<[f32; PANEL]>,
}

/// The buffers of a hidden layer.
#[derive(Clone, Debug)]
pub(super) struct Buffers {
    pub(super) activations: Rows,
    /// The activations of the training rows.
    pub(super) learnt: Panels,
    pub(super) error_rows: Rows,
    pub(super) error_panels: Panels,
}

impl Bf16Workspace {
    /// Creates buffers for up to `rows` input rows of networks shaped like `network`. The first `learnt` rows may be training
    /// rows.
    pub fn new(network: &Mlp, rows: usize, learnt: usize) -> Self {
        let layers = network.layers();
        let hidden = layers[..layers.len() - 1].iter().map(|layer| Buffers {
            activations: Rows::new(rows, layer.outputs),
            learnt: Panels::new(Pairing::Neighbours, learnt, layer.outputs),
            error_rows: Rows::new(learnt, layer.outputs),
            error_panels: Panels::new(Pairing::Neighbours, learnt, layer.outputs),
        });
        let widest = layers.iter().map(|layer| layer.outputs).max().unwrap_or(0);
        Self {
            hidden: hidden.collect(),
            values: vec![0.0; rows],
            output_pairs: vec![0; learnt.div_ceil(2)],
            output_rows: Rows::new(learnt, 1),
            bias_gradient: vec![[0.0; PANEL]; widest.div_ceil(PANEL)],
        }
    }

    /// Returns the maximum number of rows per pass.
    pub fn capacity(&self) -> usize {
        self.values.len()
    }
}
