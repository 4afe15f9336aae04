//! Tests the public interface against PyTorch and against the theory.

mod golden;
mod theory;
