//! The computation of distances. Strips of sixteen lanes are swept column by column, in memory that grows with
//! N + M.
//!
//! [`lanes`] and `x86` contain the registers, [`shapes`] the recursions, and [`mod@column`] one column of a
//! strip. [`dispatch`] chooses the kernels for the processor, and [`sweep`] processes the whole rectangle.

#![expect(
    clippy::inline_always,
    reason = "vector code must end up inside the function that carries the target feature"
)]

pub(crate) mod boundary;
pub(crate) mod column;
pub(crate) mod dispatch;
pub(crate) mod edit;
pub(crate) mod lanes;
pub(crate) mod shapes;
pub(crate) mod strip;
pub(crate) mod sweep;
pub(crate) mod terms;
#[cfg(target_arch = "x86_64")]
pub(crate) mod x86;
