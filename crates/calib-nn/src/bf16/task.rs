use super::kernel::Kernel;

/// A computation that is compiled for each processor.
pub(super) trait Task {
    type Output;

    /// Runs the computation. Implementations must be inlined always; only then are they compiled for
    /// the processor.
    fn run<K: Kernel>(self, kernel: K) -> Self::Output;
}
