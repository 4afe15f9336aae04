//! How distances are computed: strips of sixteen lanes swept column by column, in memory that
//! grows with N + M.
//!
//! [`lanes`] (and `x86`) holds the registers, [`shapes`] the recursions, [`mod@column`] one column of a strip,
//! [`dispatch`] picks what the processor has, [`sweep`] goes over the whole rectangle.

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
#[cfg(target_arch = "x86_64")]
pub(crate) mod x86;
