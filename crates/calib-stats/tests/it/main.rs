//! Tests the public interface against `SciPy` and NumPy, and in simulations.

mod choosing;
mod clusters;
mod coverage;
mod golden;
mod random;
