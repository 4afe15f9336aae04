use crate::{Adam, AdamRule, Sgd, SgdRule};

/// How parameters follow gradients.
#[derive(Clone, Debug, PartialEq)]
pub enum Optimiser {
    /// Adam, with its moments.
    Adam(Adam),
    /// Gradient descent.
    Sgd(Sgd),
}

impl Optimiser {
    /// Adam for `parameters` parameters, with zero moments.
    pub fn adam(rule: AdamRule, parameters: usize) -> Self {
        Self::Adam(Adam::new(rule, parameters))
    }

    /// Gradient descent.
    pub fn sgd(rule: SgdRule) -> Self {
        Self::Sgd(Sgd::new(rule))
    }

    /// One step of `parameters` against `gradients`. Allocates nothing.
    ///
    /// # Panics
    /// If the numbers of parameters and gradients differ, or are not those of the moments.
    pub fn step(&mut self, parameters: &mut [f32], gradients: &[f32]) {
        match self {
            Self::Adam(adam) => adam.step(parameters, gradients),
            Self::Sgd(sgd) => sgd.step(parameters, gradients),
        }
    }
}
