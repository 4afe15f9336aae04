//! Multilayer perceptrons on a GEMM library: forward, backward, Adam, SGD.
//!
//! - [`Mlp`]: any depth and width, `ReLU` between layers, linear output, biases. All parameters are in one flat vector, and [`Layer`] has
//!   their positions. So optimisers, copies and checkpoints take one pass.
//! - [`Workspace`]: every buffer of a training step, allocated once. Small batches of narrow networks have separate passes that do not pack
//!   operands.
//! - [`Naming`], [`Mlp::to_tensors`]: parameters with the names and layouts of other frameworks.
//! - [`Matrix`], [`multiply`]: the matrix product, also for losses that need one.
//! - [`Optimiser`]: [`Adam`] (optionally with decoupled weight decay) or [`Sgd`].
//!
//! The loss is outside this crate. The caller passes its gradient with respect to the output to [`Mlp::backward`].
//!
//! ```
//! use calib_core::Seed;
//! use calib_nn::{Adam, AdamRule, Mlp, Workspace};
//!
//! let mut network = Mlp::new(&[1, 16, 1], Seed::new(3));
//! let mut workspace = Workspace::new(&network, 4);
//! let mut adam = Adam::new(AdamRule { learning_rate: 1e-2, ..AdamRule::default() }, network.parameter_count());
//! let (inputs, targets) = ([0.0, 1.0, 2.0, 3.0], [0.0, 1.0, 4.0, 9.0]);
//! for _ in 0..2_000 {
//!     let outputs = network.forward(&inputs, &mut workspace);
//!     let mut loss_gradient = [0.0; 4]; // of the mean of half the squared error
//!     for (gradient, (output, target)) in loss_gradient.iter_mut().zip(outputs.iter().zip(targets)) {
//!         *gradient = (output - target) / 4.0;
//!     }
//!     let gradients = network.backward(&inputs, &loss_gradient, &mut workspace);
//!     adam.step(network.parameters_mut(), gradients);
//! }
//! let outputs = network.forward(&inputs, &mut workspace);
//! assert!((outputs[2] - 4.0).abs() < 0.1);
//! ```

mod adam;
mod aligned;
mod bf16;
mod kernels;
mod layer;
mod layout;
mod matrix;
mod memory;
mod mlp;
mod narrow;
mod optimiser;
mod product;
mod sgd;
mod sink;
#[cfg(target_arch = "x86_64")]
mod square;
mod workspace;

pub use adam::{Adam, AdamRule, Moments};
pub use bf16::{Bf16Batch, Bf16Network, Bf16Workspace};
pub use layer::Layer;
pub use layout::{LayoutError, Naming};
pub use matrix::Matrix;
pub use memory::training_bytes;
pub use mlp::{Mlp, ParameterCountError};
pub use optimiser::Optimiser;
pub use product::multiply;
pub use sgd::{Sgd, SgdRule};
pub use workspace::Workspace;
