//! Where gradients go.

use pulp::{Arch, Simd, WithSimd};

/// Takes the gradients of all parameters, each of them once, in any order.
pub(crate) trait Sink {
    /// What those of `count` parameters from `at` on change.
    fn touched(&self, at: usize, count: usize) -> impl Iterator<Item = &[f32]>;

    /// Take those of parameters from `at` on. Implementations are inlined always: only then are they compiled for the processor.
    fn take<S: Simd>(&mut self, simd: S, at: usize, gradients: &[f32]);
}

/// Hand over all gradients at once.
pub(crate) fn hand_over(to: impl Sink, gradients: &[f32]) {
    Arch::new().dispatch(All { to, gradients });
}

struct All<'a, T> {
    to: T,
    gradients: &'a [f32],
}

impl<T: Sink> WithSimd for All<'_, T> {
    type Output = ();

    #[expect(clippy::inline_always, reason = "as what it calls")]
    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        self.to.take(simd, 0, self.gradients);
    }
}

/// Gradients that are kept.
pub(crate) struct Kept<'a>(pub(crate) &'a mut [f32]);

impl Sink for Kept<'_> {
    fn touched(&self, _at: usize, _count: usize) -> impl Iterator<Item = &[f32]> {
        std::iter::empty()
    }

    #[expect(clippy::inline_always, reason = "as the product that calls it")]
    #[inline(always)]
    fn take<S: Simd>(&mut self, _simd: S, at: usize, gradients: &[f32]) {
        self.0[at..][..gradients.len()].copy_from_slice(gradients);
    }
}
