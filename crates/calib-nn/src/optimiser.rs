use crate::{Adam, AdamRule, Moments, Sgd, SgdRule};

/// The rule by which parameters follow gradients.
#[derive(Clone, Debug, PartialEq)]
pub enum Optimiser {
    /// Adam, with its moments.
    Adam(Adam),
    /// Gradient descent.
    Sgd(Sgd),
}

impl Optimiser {
    /// Creates Adam for `parameters` parameters, with zero moments.
    pub fn adam(rule: AdamRule, parameters: usize) -> Self {
        Self::Adam(Adam::new(rule, parameters))
    }

    /// Returns the same optimiser, continuing from `moments`. Gradient descent has none and stays
    /// unchanged.
    #[must_use]
    pub fn with_moments(self, moments: Moments) -> Self {
        match self {
            Self::Adam(adam) => Self::Adam(Adam::from_moments(adam.rule(), moments)),
            Self::Sgd(sgd) => Self::Sgd(sgd),
        }
    }

    /// Returns the moments, if the optimiser has any.
    pub fn moments(&self) -> Option<Moments> {
        match self {
            Self::Adam(adam) => Some(adam.moments()),
            Self::Sgd(_) => None,
        }
    }

    /// Creates gradient descent.
    pub fn sgd(rule: SgdRule) -> Self {
        Self::Sgd(Sgd::new(rule))
    }

    /// Sets another step size for the next steps.
    pub fn set_learning_rate(&mut self, learning_rate: f64) {
        match self {
            Self::Adam(adam) => adam.set_learning_rate(learning_rate),
            Self::Sgd(sgd) => sgd.set_learning_rate(learning_rate),
        }
    }

    /// Updates `parameters` by one step against `gradients`. Allocates nothing.
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
