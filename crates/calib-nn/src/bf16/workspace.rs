use super::{
    layout::{Fill, PANEL, Pairing, Panels, Rows},
    processor::Processor,
};
use crate::Mlp;

/// Input rows in bfloat16, which any number of networks share.
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
    /// Room for `rows` rows of `width` values, of which at most the first `learnt` are learnt from.
    pub fn new(width: usize, rows: usize, learnt: usize) -> Self {
        let rows = Rows::new(rows, width);
        let panels = Panels::new(Pairing::Neighbours, learnt, width);
        Self { processor: Processor::detect(), width, count: 0, learnt: 0, rows, panels }
    }

    /// Round these values, row after row; gradients will be those of the first `learnt` rows.
    ///
    /// # Panics
    /// If they are not whole rows, or more than there is room for.
    pub fn set(&mut self, values: &[f32], learnt: usize) {
        let count = values.len() / self.width;
        assert_eq!(values.len(), count * self.width, "values come in whole rows of {}", self.width);
        assert!(learnt <= count, "rows that are learnt from are among all rows");
        (self.count, self.learnt) = (count, learnt);
        Fill::Rows(&mut self.rows).with(self.processor, values);
        Fill::Panels(&mut self.panels, self.width)
            .with(self.processor, &values[..learnt * self.width]);
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.count
    }

    /// Whether there is no row.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Number of rows that are learnt from.
    pub fn learnt(&self) -> usize {
        self.learnt
    }
}

/// Every buffer of a forward and backward pass in bfloat16, allocated once and reused.
///
/// Networks of the same layer sizes can share one, one after the other.
#[derive(Clone, Debug)]
pub struct Bf16Workspace {
    pub(super) hidden: Vec<Buffers>,
    /// Outputs of the network.
    pub(super) values: Vec<f32>,
    /// Gradients with respect to the outputs, pair after pair and as a matrix of one column.
    pub(super) output_pairs: Vec<u32>,
    pub(super) output_rows: Rows,
    /// Gradients of the biases of one layer, whole panels.
    pub(super) bias_gradient: Vec<[f32; PANEL]>,
}

/// Of a hidden layer.
#[derive(Clone, Debug)]
pub(super) struct Buffers {
    pub(super) activations: Rows,
    /// Those of the rows that are learnt from.
    pub(super) learnt: Panels,
    pub(super) error_rows: Rows,
    pub(super) error_panels: Panels,
}

impl Bf16Workspace {
    /// Buffers for up to `rows` input rows, the first `learnt` of which may be learnt from, of networks shaped like `network`.
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

    /// The most rows of a pass.
    pub fn capacity(&self) -> usize {
        self.values.len()
    }
}
