use pulp::{Scalar, Simd};

use crate::sink::{Sink, hand_over};

/// Hyperparameters of [`Sgd`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SgdRule {
    /// Step size α, > 0.
    pub learning_rate: f64,
    /// Decoupled weight decay λ, ≥ 0.
    pub weight_decay: f64,
}

/// Gradient descent without momentum: θ ← (1 − αλ)θ − αg. It has no state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sgd {
    rule: SgdRule,
}

impl Sgd {
    /// Creates an optimiser for any number of parameters.
    pub fn new(rule: SgdRule) -> Self {
        Self { rule }
    }

    /// Sets another step size for the next steps.
    pub fn set_learning_rate(&mut self, learning_rate: f64) {
        self.rule.learning_rate = learning_rate;
    }

    /// Updates `parameters` by one step against `gradients`.
    ///
    /// # Panics
    /// If there is not one gradient per parameter.
    pub fn step(&self, parameters: &mut [f32], gradients: &[f32]) {
        assert_eq!(parameters.len(), gradients.len(), "one gradient a parameter");
        hand_over(self.begin(parameters), gradients);
    }

    /// Begins a step that takes its gradients in pieces.
    pub(crate) fn begin<'a>(&self, parameters: &'a mut [f32]) -> SgdStep<'a> {
        SgdStep {
            parameters,
            keep: (1.0 - self.rule.learning_rate * self.rule.weight_decay) as f32,
            learning_rate: self.rule.learning_rate as f32,
        }
    }
}

/// A step of [`Sgd`] in progress.
pub(crate) struct SgdStep<'a> {
    parameters: &'a mut [f32],
    keep: f32,
    learning_rate: f32,
}

impl Sink for SgdStep<'_> {
    fn touched(&self, at: usize, count: usize) -> impl Iterator<Item = &[f32]> {
        std::iter::once(&self.parameters[at..][..count])
    }

    #[expect(
        clippy::inline_always,
        reason = "only what is inlined into the dispatch is compiled for the processor"
    )]
    #[inline(always)]
    fn take<S: Simd>(&mut self, simd: S, at: usize, gradients: &[f32]) {
        let parameters = S::as_mut_simd_f32s(&mut self.parameters[at..][..gradients.len()]);
        let gradients = S::as_simd_f32s(gradients);
        follow(simd, self.keep, self.learning_rate, gradients.0, parameters.0);
        follow(Scalar, self.keep, self.learning_rate, gradients.1, parameters.1);
    }
}

#[expect(clippy::inline_always, reason = "as the step")]
#[inline(always)]
fn follow<S: Simd>(
    simd: S,
    keep: f32,
    rate: f32,
    gradients: &[S::f32s],
    parameters: &mut [S::f32s],
) {
    for (parameter, &gradient) in parameters.iter_mut().zip(gradients) {
        let kept = simd.mul_f32s(simd.splat_f32s(keep), *parameter);
        *parameter = simd.sub_f32s(kept, simd.mul_f32s(simd.splat_f32s(rate), gradient));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_against_the_gradient_and_decays() {
        let mut parameters = [1.0, -2.0];
        Sgd::new(SgdRule { learning_rate: 0.5, weight_decay: 0.1 })
            .step(&mut parameters, &[0.5, 1.0]);
        assert_eq!(parameters, [0.95 - 0.25, -1.9 - 0.5]);
    }
}
