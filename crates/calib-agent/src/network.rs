//! Value networks and their forward and backward passes, in either precision.

use std::ops::Range;

use calib_nn::{Bf16Batch, Bf16Network, Bf16Workspace, Mlp, Optimiser, Workspace};

use crate::Precision;

/// States on their way through networks of one shape, with all buffers. The networks use a pass one after the other.
pub(crate) struct Pass {
    rows: Vec<f32>,
    width: usize,
    products: Products,
}

enum Products {
    Single(Workspace),
    Bf16(Box<Rounded>),
}

struct Rounded {
    batch: Bf16Batch,
    /// Buffer for a single state.
    one: Bf16Batch,
    workspace: Bf16Workspace,
}

impl Pass {
    /// Returns buffers for up to `rows` states, the first `learnt` of which may be learned from, and networks shaped
    /// like `network`.
    pub(crate) fn new(precision: Precision, network: &Mlp, rows: usize, learnt: usize) -> Self {
        let width = network.inputs();
        let products = match precision {
            Precision::F32 => Products::Single(Workspace::new(network, rows)),
            Precision::Bf16 => Products::Bf16(Box::new(Rounded {
                batch: Bf16Batch::new(width, rows, learnt),
                one: Bf16Batch::new(width, 1, 0),
                workspace: Bf16Workspace::new(network, rows, learnt),
            })),
        };
        Self { rows: Vec::with_capacity(rows * width), width, products }
    }

    /// Returns the maximum number of states per pass.
    pub(crate) fn capacity(&self) -> usize {
        match &self.products {
            Products::Single(workspace) => workspace.capacity(),
            Products::Bf16(rounded) => rounded.workspace.capacity(),
        }
    }

    /// Loads these states, of which the first `learnt` will be learned from. In bfloat16, they are rounded once for all
    /// networks.
    pub(crate) fn set<'s>(&mut self, states: impl Iterator<Item = &'s [f32]>, learnt: usize) {
        self.rows.clear();
        for state in states {
            self.rows.extend_from_slice(state);
        }
        if let Products::Bf16(rounded) = &mut self.products {
            rounded.batch.set(&self.rows, learnt);
        }
    }
}

/// A value network: parameters in single precision and, if its products are in bfloat16, their rounded copies.
#[derive(Clone, Debug)]
pub(crate) struct Network {
    single: Mlp,
    rounded: Option<Bf16Network>,
}

impl Network {
    pub(crate) fn new(precision: Precision, network: Mlp) -> Self {
        let rounded = match precision {
            Precision::F32 => None,
            Precision::Bf16 => Some(Bf16Network::new(&network)),
        };
        Self { single: network, rounded }
    }

    /// Returns the number of units of the last hidden layer.
    pub(crate) fn hidden_units(&self) -> usize {
        self.single.layers().last().map_or(0, |output| output.inputs)
    }

    pub(crate) fn parameters(&self) -> &[f32] {
        self.single.parameters()
    }

    /// Replaces the parameters by as many others.
    pub(crate) fn set_parameters(&mut self, parameters: &[f32]) {
        self.single.parameters_mut().copy_from_slice(parameters);
        self.round();
    }

    /// Returns the value of one state. The states of the pass are unchanged.
    pub(crate) fn value(&self, state: &[f32], pass: &mut Pass) -> f32 {
        match (&mut pass.products, &self.rounded) {
            (Products::Bf16(pass), Some(rounded)) => {
                let Rounded { one, workspace, .. } = &mut **pass;
                one.set(state, 0);
                rounded.forward(one, 0..1, workspace)[0]
            }
            (Products::Single(workspace), _) => self.single.forward(state, workspace)[0],
            (Products::Bf16(_), None) => unreachable!("a pass is in its networks' precision"),
        }
    }

    /// Returns the values of `rows` of the pass.
    ///
    /// If they begin with the first row, the next [`Network::step`] learns from the pass.
    pub(crate) fn values<'p>(&self, rows: Range<usize>, pass: &'p mut Pass) -> &'p [f32] {
        let width = pass.width;
        match (&mut pass.products, &self.rounded) {
            (Products::Bf16(pass), Some(rounded)) => {
                rounded.forward(&pass.batch, rows, &mut pass.workspace)
            }
            (Products::Single(workspace), _) => {
                self.single.forward(&pass.rows[rows.start * width..rows.end * width], workspace)
            }
            (Products::Bf16(_), None) => unreachable!("a pass is in its networks' precision"),
        }
    }

    /// Makes one step of the optimiser, given the gradient of a loss with respect to the values that are learned from.
    pub(crate) fn step(&mut self, optimiser: &mut Optimiser, gradient: &[f32], pass: &mut Pass) {
        match (&mut pass.products, &mut self.rounded) {
            (Products::Bf16(pass), Some(rounded)) => {
                let Rounded { batch, workspace, .. } = &mut **pass;
                rounded.learn(&mut self.single, optimiser, batch, gradient, workspace);
            }
            (Products::Single(workspace), _) => {
                let gradients = self.single.backward(&pass.rows, gradient, workspace);
                optimiser.step(self.single.parameters_mut(), gradients);
            }
            (Products::Bf16(_), None) => unreachable!("a pass is in its networks' precision"),
        }
    }

    fn round(&mut self) {
        if let Some(rounded) = &mut self.rounded {
            rounded.set(&self.single);
        }
    }
}
