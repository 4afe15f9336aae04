//! The implementations for different processors. All give the same bytes.

use pulp::{Arch, Simd, WithSimd};

#[cfg(target_arch = "x86_64")]
use super::x86::Hardware;
use super::{
    kernel::{Fused, Widened},
    task::Task,
};

/// The implementation that this machine uses.
#[derive(Clone, Copy, Debug)]
pub(super) enum Processor {
    /// An instruction for two products and their sums.
    #[cfg(target_arch = "x86_64")]
    Hardware(Hardware),
    /// Fused multiply-adds of these vectors, or an equivalent.
    Portable(Arch),
}

impl Processor {
    /// Returns the fastest one of this machine.
    pub(super) fn detect() -> Self {
        #[cfg(target_arch = "x86_64")]
        if let Some(hardware) = Hardware::detect() {
            return Self::Hardware(hardware);
        }
        Self::Portable(Arch::new())
    }

    /// Returns all that this machine supports, the fastest first.
    #[cfg(test)]
    pub(super) fn all() -> Vec<Self> {
        let mut all =
            vec![Self::detect(), Self::Portable(Arch::new()), Self::Portable(Arch::Scalar)];
        #[cfg(target_arch = "x86_64")]
        all.extend(pulp::x86::V3::try_new().map(|level| Self::Portable(Arch::V3(level))));
        all
    }

    pub(super) fn run<T: Task>(self, task: T) -> T::Output {
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::Hardware(hardware) => hardware.run(task),
            Self::Portable(Arch::Scalar) => task.run(Widened),
            Self::Portable(arch) => arch.dispatch(Vectors(task)),
        }
    }
}

struct Vectors<T>(T);

impl<T: Task> WithSimd for Vectors<T> {
    type Output = T::Output;

    #[expect(
        clippy::inline_always,
        reason = "only what is inlined into the dispatch is compiled for the processor"
    )]
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> T::Output {
        self.0.run(Fused(simd))
    }
}
