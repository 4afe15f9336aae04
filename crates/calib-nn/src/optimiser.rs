use crate::{Adam, AdamRule, Moments, Sgd, SgdRule};

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

    /// The same optimiser, going on from `moments`; descent has none and stays as it is.
    #[must_use]
    pub fn with_moments(self, moments: Moments) -> Self {
        match self {
            Self::Adam(adam) => Self::Adam(Adam::from_moments(adam.rule(), moments)),
            Self::Sgd(sgd) => Self::Sgd(sgd),
        }
    }

    /// What it remembers, if it does.
    pub fn moments(&self) -> Option<Moments> {
        match self {
            Self::Adam(adam) => Some(adam.moments()),
            Self::Sgd(_) => None,
        }
    }

    /// Gradient descent.
    pub fn sgd(rule: SgdRule) -> Self {
        Self::Sgd(Sgd::new(rule))
    }

    /// Go on with another step size.
    pub fn set_learning_rate(&mut self, learning_rate: f64) {
        match self {
            Self::Adam(adam) => adam.set_learning_rate(learning_rate),
            Self::Sgd(sgd) => sgd.set_learning_rate(learning_rate),
        }
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
