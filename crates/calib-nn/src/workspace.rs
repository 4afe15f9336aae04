use crate::{
    Layer, Mlp,
    aligned::{Aligned, filled},
    narrow::{Narrow, NarrowBuffers},
};

/// Every buffer of a forward and backward pass, allocated once and reused.
///
/// Networks of the same layer sizes can use it in turn.
#[derive(Clone, Debug)]
pub struct Workspace {
    capacity: usize,
    /// Outputs of each layer, `[capacity, outputs]`.
    pub(crate) activations: Vec<Aligned<f32>>,
    /// Gradients with respect to the outputs of the current and the previous layer.
    pub(crate) deltas: [Aligned<f32>; 2],
    /// Gradients of all parameters, in their order.
    pub(crate) gradients: Aligned<f32>,
    /// Additional buffers of a narrow network.
    pub(crate) narrow: Option<Box<Narrow>>,
}

impl Workspace {
    /// Creates buffers for up to `rows` input rows of networks shaped like `network`.
    pub fn new(network: &Mlp, rows: usize) -> Self {
        let layers = network.layers();
        let widest = layers.iter().map(|layer| layer.outputs).max().unwrap_or(0);
        Self {
            capacity: rows,
            activations: layers.iter().map(|layer| filled(0.0, rows * layer.outputs)).collect(),
            deltas: [filled(0.0, rows * widest), filled(0.0, rows * widest)],
            gradients: filled(0.0, network.parameter_count()),
            narrow: Narrow::new(layers, rows).map(Box::new),
        }
    }

    /// Returns the gradients of the latest [`Mlp::backward`]. Losses over several workspaces may add them up.
    pub fn gradients_mut(&mut self) -> &mut [f32] {
        &mut self.gradients
    }

    /// Returns the buffers of a backward pass through a narrow network, and the place for its gradients. Returns `None` if a network
    /// of these layers does not use that pass for this many rows.
    pub(crate) fn narrow_buffers(
        &mut self,
        layers: &[Layer],
        rows: usize,
    ) -> Option<(NarrowBuffers<'_>, &mut [f32])> {
        let Self { activations, deltas, gradients, narrow, .. } = self;
        let narrow = narrow.as_deref_mut().filter(|_| Narrow::learns_from(layers, rows))?;
        Some((NarrowBuffers { activations, deltas, narrow }, gradients))
    }

    /// Returns the maximum number of rows per pass.
    pub fn capacity(&self) -> usize {
        self.capacity
    }
}
