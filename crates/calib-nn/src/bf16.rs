//! Networks whose matrix products use bfloat16 numbers, with sums in single precision.
//!
//! Operands are rounded to nearest, ties to even, when they are created: weights once per update, activations and errors as
//! soon as a product is finished. Sums, biases, losses, gradients, moments and the parameters themselves stay in single
//! precision.
//!
//! A sum visits its inner index in pairs: `s ← s + a₁b₁`, then `s ← s + a₀b₀`, each a fused multiply-add. This is what the
//! instruction `vdpbf16ps` computes. A processor without it executes the same operations one by one. So all processors give
//! the same bytes, and the number of rows makes no difference.

mod kernel;
mod layout;
mod network;
mod number;
mod panel;
mod processor;
mod product;
mod steps;
mod task;
mod workspace;
#[cfg(target_arch = "x86_64")]
mod x86;

pub use network::Bf16Network;
pub use workspace::{Bf16Batch, Bf16Workspace};
