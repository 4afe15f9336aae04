use crate::Mlp;

/// Every buffer of a forward and backward pass, allocated once and reused.
///
/// Networks of the same layer sizes can share one, one after the other.
#[derive(Clone, Debug)]
pub struct Workspace {
    capacity: usize,
    /// Outputs of each layer, `[capacity, outputs]`.
    pub(crate) activations: Vec<Vec<f32>>,
    /// Gradients with respect to the outputs of the present and the previous layer.
    pub(crate) deltas: [Vec<f32>; 2],
    /// Gradients of all parameters, in their order.
    pub(crate) gradients: Vec<f32>,
}

impl Workspace {
    /// Buffers for up to `rows` input rows of networks shaped like `network`.
    pub fn new(network: &Mlp, rows: usize) -> Self {
        let layers = network.layers();
        let widest = layers.iter().map(|layer| layer.outputs).max().unwrap_or(0);
        Self {
            capacity: rows,
            activations: layers.iter().map(|layer| vec![0.0; rows * layer.outputs]).collect(),
            deltas: [vec![0.0; rows * widest], vec![0.0; rows * widest]],
            gradients: vec![0.0; network.parameter_count()],
        }
    }

    /// The gradients of the latest [`Mlp::backward`], which losses over several workspaces may add up.
    pub fn gradients_mut(&mut self) -> &mut [f32] {
        &mut self.gradients
    }

    /// The most rows of a pass.
    pub fn capacity(&self) -> usize {
        self.capacity
    }
}
