//! The consumers of gradients.

use pulp::{Arch, Simd, WithSimd};

/// A consumer of the gradients of all parameters. It receives each of them once, in any order.
pub(crate) trait Sink {
    /// Returns the values that the gradients of `count` parameters from `at` on change.
    fn touched(&self, at: usize, count: usize) -> impl Iterator<Item = &[f32]>;

    /// Consumes the gradients of parameters from `at` on. Implementations must be inlined always; only then are they compiled
    /// for the processor.
    fn take<S: Simd>(&mut self, simd: S, at: usize, gradients: &[f32]);
}

/// Passes all gradients at once.
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

/// A consumer that stores the gradients.
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
