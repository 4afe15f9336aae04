//! Networks whose products are of bfloat16 numbers, with sums in single precision.
//!
//! An operand is rounded to nearest, ties to even, when it is made: weights once an update, activations and errors as
//! they come out of a product. Sums, biases, losses, gradients, moments and the parameters themselves stay in single
//! precision.
//!
//! A sum goes through its inner index in pairs: `s ← s + a₁b₁`, then `s ← s + a₀b₀`, each a fused multiply-add. That is what
//! the instruction `vdpbf16ps` computes. Where a processor lacks it, the same operations are made one by one, so that all
//! processors give the same bytes, and so do all numbers of rows.

mod kernel;
mod layout;
mod network;
mod number;
mod processor;
mod product;
mod steps;
mod workspace;
#[cfg(target_arch = "x86_64")]
mod x86;

pub use network::Bf16Network;
pub use workspace::{Bf16Batch, Bf16Workspace};
