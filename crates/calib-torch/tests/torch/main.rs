//! Tests training and prediction through libtorch.
//!
//! The gate compiles this program by its name, so no other package has one of the same name.
#![cfg(feature = "libtorch")]

mod device;
mod parity;
mod populations;
mod script;
mod sweeps;
