//! How far a choice can be relied on.

use super::{Agreement, Grade, Told, Verdict};

impl Verdict {
    /// How far the choice can be relied on: its grade, unless held-out data says nothing of the kind.
    ///
    /// A choice without skill is poor, however little the other values would have gained. Where all values have the same error Online,
    /// or the sensor does not move there, nothing has checked the choice.
    pub fn reliance(&self) -> Grade {
        let (Some(online), grade) = (&self.online, self.grade) else { return self.grade };
        match grade {
            _ if online.stands_still => Grade::Unchecked,
            Grade::Good | Grade::Fair if online.values == Told::Alike => Grade::Unchecked,
            Grade::Good | Grade::Fair if online.is_unskilled() => Grade::Poor,
            grade => grade,
        }
    }

    /// Whether a choice that could be used is as good as any other, as far as it was chosen from anything.
    pub(super) fn is_arbitrary(&self) -> bool {
        self.evidence == Told::Alike
            && matches!(self.reliance(), Grade::Good | Grade::Fair | Grade::Unchecked)
    }

    /// Whether every value diverged on held-out data.
    pub(crate) fn has_all_diverged(&self) -> bool {
        self.online.as_ref().is_some_and(|online| online.regret.is_none())
    }

    /// How far the choice can be relied on, in a few words.
    pub(crate) fn badge(&self) -> &'static str {
        let reliance = self.reliance();
        match &self.online {
            _ if self.is_arbitrary() => "Not told apart: all values did alike",
            Some(online) if online.stands_still => {
                "Not checked: the sensor stands still in the held-out data"
            }
            Some(_) if reliance == Grade::Unchecked => {
                "Not checked: held-out data does not tell the values apart"
            }
            _ => reliance.label(),
        }
    }

    /// Whether what choices cost Online says which is better.
    pub(crate) fn has_costs(&self) -> bool {
        matches!(self.reliance(), Grade::Good | Grade::Fair | Grade::Poor)
    }
}

impl Agreement {
    /// Whether the choice predicts no better than the mean return.
    pub(super) fn is_unskilled(&self) -> bool {
        self.chosen_skill.is_some_and(|skill| skill <= 0.0)
    }
}

impl Grade {
    /// The grade in a few words.
    pub const fn label(self) -> &'static str {
        match self {
            Self::Good => "Good: as good as choosing by the deployment itself",
            Self::Fair => "Fair: not worse than the default",
            Self::Poor => "Poor: do not rely on it",
            Self::NotLearnt => "Not learnt: no value beats predicting the mean",
            Self::Unchecked => "Not checked on held-out data",
        }
    }

    /// The grade in a word or two.
    pub const fn word(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Fair => "fair",
            Self::Poor => "poor",
            Self::NotLearnt => "not learnt",
            Self::Unchecked => "not checked",
        }
    }

    /// Its name in the style sheet.
    pub(crate) const fn class(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Fair => "fair",
            Self::Poor | Self::NotLearnt => "poor",
            Self::Unchecked => "unchecked",
        }
    }
}
