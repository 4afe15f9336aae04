//! Tests whole sweeps, and verdicts against NumPy.

mod golden;
mod sweep;
