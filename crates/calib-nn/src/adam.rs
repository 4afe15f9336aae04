use pulp::{Scalar, Simd};

use crate::{
    aligned::{Aligned, aligned, filled},
    sink::{Sink, hand_over},
};

/// Hyperparameters of [`Adam`]. Defaults are those of the paper (Kingma & Ba 2015) and PyTorch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AdamRule {
    /// Step size α, > 0. Default 1e-3.
    pub learning_rate: f64,
    /// Decay of the mean of gradients, in [0, 1). Default 0.9.
    pub beta1: f64,
    /// Decay of the mean of squared gradients, in [0, 1). Default 0.999.
    pub beta2: f64,
    /// Added to the denominator, > 0. Default 1e-8.
    pub epsilon: f64,
    /// Decoupled weight decay λ (`AdamW`, Loshchilov & Hutter 2019), ≥ 0. Default 0.
    pub weight_decay: f64,
}

impl Default for AdamRule {
    fn default() -> Self {
        Self { learning_rate: 1e-3, beta1: 0.9, beta2: 0.999, epsilon: 1e-8, weight_decay: 0.0 }
    }
}

/// The state of [`Adam`], to be stored with a checkpoint.
#[derive(Clone, Debug, PartialEq)]
pub struct Moments {
    /// The mean of gradients, one value per parameter.
    pub mean: Vec<f32>,
    /// The mean of squared gradients, one value per parameter.
    pub square: Vec<f32>,
    /// β₁ᵗ and β₂ᵗ after t steps, which correct the bias of the means.
    pub powers: (f64, f64),
}

/// Adam with bias correction (Kingma & Ba 2015, algorithm 1, with PyTorch's place of ε):
///
/// m ← β₁m + (1−β₁)g, v ← β₂v + (1−β₂)g²,
/// θ ← (1 − αλ)θ − α/(1−β₁ᵗ) · m / (√(v/(1−β₂ᵗ)) + ε).
///
/// One fused pass over parameters, gradients and both moments. Moments below the smallest normal number become 0.
#[derive(Clone, Debug, PartialEq)]
pub struct Adam {
    rule: AdamRule,
    mean: Aligned<f32>,
    square: Aligned<f32>,
    /// β₁ᵗ and β₂ᵗ.
    powers: (f64, f64),
}

impl Adam {
    /// Creates an optimiser of `parameters` parameters with zero moments.
    pub fn new(rule: AdamRule, parameters: usize) -> Self {
        Self {
            rule,
            mean: filled(0.0, parameters),
            square: filled(0.0, parameters),
            powers: (1.0, 1.0),
        }
    }

    /// Creates an optimiser that continues from these [`moments`](Self::moments).
    ///
    /// # Panics
    /// If `mean` and `square` differ in length.
    pub fn from_moments(rule: AdamRule, Moments { mean, square, powers }: Moments) -> Self {
        assert_eq!(mean.len(), square.len(), "both moments of every parameter");
        Self { rule, mean: aligned(&mean), square: aligned(&square), powers }
    }

    /// Returns the state. With the parameters, this is all that a checkpoint needs.
    pub fn moments(&self) -> Moments {
        Moments { mean: self.mean.to_vec(), square: self.square.to_vec(), powers: self.powers }
    }

    /// Sets another step size for the next steps.
    pub fn set_learning_rate(&mut self, learning_rate: f64) {
        self.rule.learning_rate = learning_rate;
    }

    /// Returns the hyperparameters.
    pub fn rule(&self) -> AdamRule {
        self.rule
    }

    /// Sets another rule (a new learning rate) and keeps the moments.
    pub fn set_rule(&mut self, rule: AdamRule) {
        self.rule = rule;
    }

    /// Updates `parameters` by one step against `gradients`.
    ///
    /// # Panics
    /// If the number of parameters or gradients is not that of the moments.
    pub fn step(&mut self, parameters: &mut [f32], gradients: &[f32]) {
        assert_eq!(gradients.len(), self.mean.len(), "one gradient a parameter");
        hand_over(self.begin(parameters), gradients);
    }

    /// Begins a step that takes its gradients in pieces.
    ///
    /// # Panics
    /// If the number of parameters is not that of the moments.
    pub(crate) fn begin<'a>(&'a mut self, parameters: &'a mut [f32]) -> AdamStep<'a> {
        assert_eq!(parameters.len(), self.mean.len(), "one moment a parameter");
        let rule = self.rule;
        self.powers.0 *= rule.beta1;
        self.powers.1 *= rule.beta2;
        AdamStep {
            parameters,
            mean: &mut self.mean,
            square: &mut self.square,
            rates: Rates {
                keep: (1.0 - rule.learning_rate * rule.weight_decay) as f32,
                beta1: rule.beta1 as f32,
                beta2: rule.beta2 as f32,
                one_minus_beta1: (1.0 - rule.beta1) as f32,
                one_minus_beta2: (1.0 - rule.beta2) as f32,
                scaled_rate: (rule.learning_rate / (1.0 - self.powers.0)) as f32,
                correction: (1.0 / (1.0 - self.powers.1).sqrt()) as f32,
                epsilon: rule.epsilon as f32,
            },
        }
    }
}

/// A step of [`Adam`] in progress.
pub(crate) struct AdamStep<'a> {
    parameters: &'a mut [f32],
    mean: &'a mut [f32],
    square: &'a mut [f32],
    rates: Rates,
}

impl Sink for AdamStep<'_> {
    fn touched(&self, at: usize, count: usize) -> impl Iterator<Item = &[f32]> {
        let all: [&[f32]; 3] = [self.parameters, self.mean, self.square];
        all.into_iter().map(move |values| &values[at..][..count])
    }

    #[expect(
        clippy::inline_always,
        reason = "only what is inlined into the dispatch is compiled for the processor"
    )]
    #[inline(always)]
    fn take<S: Simd>(&mut self, simd: S, at: usize, gradients: &[f32]) {
        let places = at..at + gradients.len();
        let parameters = S::as_mut_simd_f32s(&mut self.parameters[places.clone()]);
        let mean = S::as_mut_simd_f32s(&mut self.mean[places.clone()]);
        let square = S::as_mut_simd_f32s(&mut self.square[places]);
        let gradients = S::as_simd_f32s(gradients);
        self.rates.follow(simd, gradients.0, parameters.0, mean.0, square.0);
        self.rates.follow(Scalar, gradients.1, parameters.1, mean.1, square.1);
    }
}

/// The factors of a step.
#[derive(Clone, Copy)]
struct Rates {
    keep: f32,
    beta1: f32,
    beta2: f32,
    one_minus_beta1: f32,
    one_minus_beta2: f32,
    scaled_rate: f32,
    correction: f32,
    epsilon: f32,
}

impl Rates {
    #[expect(clippy::inline_always, reason = "as the step")]
    #[inline(always)]
    fn follow<S: Simd>(
        self,
        simd: S,
        gradients: &[S::f32s],
        parameters: &mut [S::f32s],
        mean: &mut [S::f32s],
        square: &mut [S::f32s],
    ) {
        let moments = mean.iter_mut().zip(square);
        for ((parameter, &gradient), (mean, square)) in
            parameters.iter_mut().zip(gradients).zip(moments)
        {
            let squared = simd.mul_f32s(gradient, gradient);
            let moved = simd.add_f32s(
                times(simd, self.beta1, *mean),
                times(simd, self.one_minus_beta1, gradient),
            );
            *mean = without_subnormal(simd, moved);
            let moved = simd.add_f32s(
                times(simd, self.beta2, *square),
                times(simd, self.one_minus_beta2, squared),
            );
            *square = without_subnormal(simd, moved);
            let root = times(simd, self.correction, simd.sqrt_f32s(*square));
            let scale = simd.add_f32s(root, simd.splat_f32s(self.epsilon));
            let change = times(simd, self.scaled_rate, simd.div_f32s(*mean, scale));
            *parameter = simd.sub_f32s(times(simd, self.keep, *parameter), change);
        }
    }
}

/// Returns `values`, each multiplied by `rate`.
#[expect(clippy::inline_always, reason = "as the step")]
#[inline(always)]
fn times<S: Simd>(simd: S, rate: f32, values: S::f32s) -> S::f32s {
    simd.mul_f32s(simd.splat_f32s(rate), values)
}

/// Replaces subnormal values by zero. The moments of a parameter without gradients would stay subnormal, where processors
/// are many times as slow. The change is far below ε, so it does not affect parameters.
#[expect(clippy::inline_always, reason = "as the step")]
#[inline(always)]
fn without_subnormal<S: Simd>(simd: S, values: S::f32s) -> S::f32s {
    let small = simd.less_than_f32s(simd.abs_f32s(values), simd.splat_f32s(f32::MIN_POSITIVE));
    simd.select_f32s(small, simd.splat_f32s(0.0), values)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Parameters after each step, computed by `scripts/golden/nn_adam.py` in double precision.
    const GOLDEN: &str = include_str!("../tests/golden/adam.txt");

    #[test]
    fn follows_the_algorithm() {
        let rule = AdamRule { learning_rate: 0.05, weight_decay: 0.1, ..AdamRule::default() };
        let mut adam = Adam::new(rule, 3);
        let mut parameters = [1.0_f32, -2.0, 0.5];
        for (t, expected) in GOLDEN.lines().enumerate() {
            let gradients: Vec<f32> = parameters
                .iter()
                .enumerate()
                .map(|(i, p)| p * (i + 1) as f32 + (t as f32 - 2.0) * 0.25)
                .collect();
            adam.step(&mut parameters, &gradients);
            for (got, expected) in parameters.iter().zip(expected.split(' ')) {
                let expected: f64 = expected.parse().expect("a number");
                assert!((f64::from(*got) - expected).abs() < 2e-6, "step {t}: {parameters:?}");
            }
        }
    }

    #[test]
    fn goes_on_from_its_moments() {
        let mut whole = Adam::new(AdamRule::default(), 2);
        let mut expected = [1.0, -1.0];
        let mut got = [1.0, -1.0];
        whole.step(&mut expected, &[0.3, -2.0]);
        whole.step(&mut got.clone(), &[0.0, 0.0]);
        let mut first = Adam::new(AdamRule::default(), 2);
        first.step(&mut got, &[0.3, -2.0]);
        first.step(&mut [0.0, 0.0], &[0.0, 0.0]);
        let mut rest = Adam::from_moments(AdamRule::default(), first.moments());
        assert_eq!(rest, whole);
        whole.step(&mut expected, &[0.1, 0.2]);
        rest.step(&mut got, &[0.1, 0.2]);
        assert_eq!(got, expected);
    }

    #[test]
    fn moments_without_gradients_end_at_zero() {
        let rule = AdamRule { beta2: 0.9, ..AdamRule::default() };
        let mut adam = Adam::new(rule, 20);
        let mut parameters = [1.0; 20];
        adam.step(&mut parameters, &[1.0; 20]);
        for _ in 0..1_000 {
            adam.step(&mut parameters, &[0.0; 20]);
        }
        let moments = adam.moments();
        assert_eq!(moments.mean, [0.0; 20]);
        assert_eq!(moments.square, [0.0; 20]);
    }

    #[test]
    fn the_first_step_has_the_size_of_the_learning_rate() {
        let mut adam = Adam::new(AdamRule::default(), 2);
        let mut parameters = [0.0, 0.0];
        adam.step(&mut parameters, &[1e-3, -1e3]);
        assert!((parameters[0] + 1e-3).abs() < 1e-7, "{parameters:?}");
        assert!((parameters[1] - 1e-3).abs() < 1e-7, "{parameters:?}");
    }
}
