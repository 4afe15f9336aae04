//! Where gradients go.

use pulp::Simd;

use super::kernel::Kernel;
use crate::{adam::AdamStep, sgd::SgdStep};

/// Takes the gradients of all parameters, each of them once, in any order.
pub(super) trait Sink {
    /// Soon, those of `count` parameters from `at` on will be taken.
    fn prepare<K: Kernel>(&self, _kernel: K, _at: usize, _count: usize) {}

    /// Take those of parameters from `at` on.
    fn take<S: Simd>(&mut self, simd: S, at: usize, gradients: &[f32]);
}

/// Gradients that are kept.
pub(super) struct Kept<'a>(pub(super) &'a mut [f32]);

impl Sink for Kept<'_> {
    #[expect(clippy::inline_always, reason = "as the product that calls it")]
    #[inline(always)]
    fn take<S: Simd>(&mut self, _simd: S, at: usize, gradients: &[f32]) {
        self.0[at..][..gradients.len()].copy_from_slice(gradients);
    }
}

impl Sink for AdamStep<'_> {
    #[expect(clippy::inline_always, reason = "as the product that calls it")]
    #[inline(always)]
    fn prepare<K: Kernel>(&self, kernel: K, at: usize, count: usize) {
        for values in self.touched(at, count) {
            kernel.prefetch(values);
        }
    }

    #[expect(clippy::inline_always, reason = "as the product that calls it")]
    #[inline(always)]
    fn take<S: Simd>(&mut self, simd: S, at: usize, gradients: &[f32]) {
        AdamStep::take(self, simd, at, gradients);
    }
}

impl Sink for SgdStep<'_> {
    #[expect(clippy::inline_always, reason = "as the product that calls it")]
    #[inline(always)]
    fn prepare<K: Kernel>(&self, kernel: K, at: usize, count: usize) {
        kernel.prefetch(self.touched(at, count));
    }

    #[expect(clippy::inline_always, reason = "as the product that calls it")]
    #[inline(always)]
    fn take<S: Simd>(&mut self, simd: S, at: usize, gradients: &[f32]) {
        SgdStep::take(self, simd, at, gradients);
    }
}
