use pulp::{Arch, NullaryFnOnce};

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
    /// An optimiser for any number of parameters.
    pub fn new(rule: SgdRule) -> Self {
        Self { rule }
    }

    /// One step against `gradients`.
    ///
    /// # Panics
    /// If there is not one gradient a parameter.
    pub fn step(&self, parameters: &mut [f32], gradients: &[f32]) {
        assert_eq!(parameters.len(), gradients.len(), "one gradient a parameter");
        Arch::new().dispatch(Step {
            parameters,
            gradients,
            keep: (1.0 - self.rule.learning_rate * self.rule.weight_decay) as f32,
            learning_rate: self.rule.learning_rate as f32,
        });
    }
}

struct Step<'a> {
    parameters: &'a mut [f32],
    gradients: &'a [f32],
    keep: f32,
    learning_rate: f32,
}

impl NullaryFnOnce for Step<'_> {
    type Output = ();

    #[expect(
        clippy::inline_always,
        reason = "only what is inlined into the dispatch is compiled for the processor"
    )]
    #[inline(always)]
    fn call(self) {
        for (parameter, gradient) in self.parameters.iter_mut().zip(self.gradients) {
            *parameter = self.keep * *parameter - self.learning_rate * gradient;
        }
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
