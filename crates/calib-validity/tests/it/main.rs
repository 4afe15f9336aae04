//! Tests judgements against NumPy, and their bounds in simulations.

mod coverage;
mod golden;
