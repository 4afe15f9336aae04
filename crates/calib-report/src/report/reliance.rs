//! What a grade is called, and what it allows to say.

use calib_agent::SimplePredictor;
use calib_sweep::ENOUGH_WINDOWS;

use super::{Grade, HeldOutResult, Separation, Simpler, Verdict, simple::WORTH_MENTIONING};

/// An agent that goes on learning is worth it with at most this share of the error of what learns nothing more. Our choice.
const WORTH_A_WORD: f64 = 0.99;

const SIMPLER_IS_BETTER: &str = "Simpler is better: no agent needed";
const UNDECIDED: &str = "Undecided: the agent may be better";
const FEW_WINDOWS: &str = "Undecided: too few held-out windows to tell";

impl Verdict {
    /// Whether a choice that could be used is as good as any other, as far as it was chosen from anything.
    pub(super) fn is_arbitrary(&self) -> bool {
        self.evidence == Separation::Alike
            && matches!(self.grade, Grade::Good | Grade::Fair | Grade::Unchecked)
    }

    /// Whether every setting diverged on held-out data.
    pub(crate) fn has_all_diverged(&self) -> bool {
        self.online.as_ref().is_some_and(|online| online.regret.is_none())
    }

    /// How far the choice can be relied on, in a few words.
    pub(crate) fn badge(&self) -> &'static str {
        match (&self.online, self.grade) {
            _ if self.is_arbitrary() => "No clear difference: all settings did alike",
            _ if self.may_gain_by_learning() => UNDECIDED,
            (_, Grade::Good | Grade::Fair) if self.has_few_windows() => FEW_WINDOWS,
            _ if self.without_learning().is_some() => SIMPLER_IS_BETTER,
            (Some(online), _) if online.stands_still => {
                "Not checked: the sensor is constant in the held-out period"
            }
            (Some(_), Grade::Unchecked) => "Not checked: no clear difference on held-out data",
            (_, Grade::Good) => "Good: at most 5 % from the best setting",
            (_, Grade::Fair) => "Fair: not shown to be worse than the default",
            (_, Grade::Simpler) if self.may_beat_simple() => UNDECIDED,
            (_, Grade::Simpler)
                if self
                    .simpler
                    .as_ref()
                    .is_some_and(|simpler| !simpler.is_shown() && simpler.is_better) =>
            {
                FEW_WINDOWS
            }
            (_, Grade::Simpler) => SIMPLER_IS_BETTER,
            (_, Grade::Poor) if self.elsewhere.is_some() => {
                "Poor: held-out values are far from the training range"
            }
            (_, Grade::Poor) => "Poor: do not rely on it",
            (_, Grade::NotLearnt) if self.left_training().is_some() => {
                "Not learned: the sensor left its training range"
            }
            (_, Grade::NotLearnt) => "Not learned: nothing beats a mean",
            (None, Grade::Unchecked) => "Not checked on held-out data",
        }
    }

    /// The simple predictor to use although the choice is a good one, because further learning adds nothing to it.
    pub fn without_learning(&self) -> Option<SimplePredictor> {
        self.frozen.filter(|_| matches!(self.grade, Grade::Good | Grade::Fair))
    }

    /// Whether the chosen agent has less error than the default that learns nothing, by more than a rounding, which could be chance.
    pub(super) fn may_gain_by_learning(&self) -> bool {
        let against = self.online.as_ref().and_then(|online| online.against_default);
        self.without_learning().is_some()
            && !self.learns_nothing
            && against.is_some_and(|ratio| ratio.value < WORTH_MENTIONING)
    }

    /// Whether held-out windows exclude that further learning lowers the error by a hundredth. Where the choice learns nothing
    /// itself, they do if no other setting did better in any window, or hardly better.
    pub(super) fn excludes_a_gain(&self) -> bool {
        let Some(online) = &self.online else { return false };
        match (online.against_default.filter(|_| !self.learns_nothing), online.regret) {
            (Some(ratio), _) => ratio.interval.is_some_and(|interval| interval.low >= WORTH_A_WORD),
            (None, Some(regret)) => {
                regret.value == 0.0 || regret.upper.is_some_and(|upper| upper <= 1.0 - WORTH_A_WORD)
            }
            (None, None) => false,
        }
    }

    /// Whether so few windows were held out that they tell hardly any difference from chance.
    pub(super) fn has_few_windows(&self) -> bool {
        self.online.as_ref().is_some_and(|online| online.windows < ENOUGH_WINDOWS)
    }

    /// What to do, in a word or two.
    pub(crate) fn advice(&self) -> String {
        match self.grade {
            _ if self.is_arbitrary() => "keep the default".to_owned(),
            Grade::Good | Grade::Fair | Grade::Simpler => self.simple_to_use().map_or_else(
                || "deploy the choice".to_owned(),
                |predictor| format!("use {}", predictor.label()),
            ),
            Grade::Poor if self.better_default().is_some() => "keep the default".to_owned(),
            Grade::Poor | Grade::NotLearnt => "deploy nothing".to_owned(),
            Grade::Unchecked => "not checked".to_owned(),
        }
    }

    /// Whether the agent has less error than the simple predictor to use instead, which could be chance.
    fn may_beat_simple(&self) -> bool {
        self.simpler.as_ref().is_some_and(Simpler::may_be_worse)
    }

    /// Whether a simple predictor is to be used instead of an agent.
    pub(crate) fn is_simpler_better(&self) -> bool {
        self.grade == Grade::Simpler || self.without_learning().is_some()
    }

    /// The simple predictor to use, where one is.
    pub(crate) fn simple_to_use(&self) -> Option<SimplePredictor> {
        let simpler = self.simpler.as_ref().filter(|_| self.grade == Grade::Simpler);
        self.without_learning().or(simpler.map(|simpler| simpler.predictor))
    }

    /// Its name in the style sheet.
    pub(crate) fn class(&self) -> &'static str {
        match self.grade {
            _ if self.without_learning().is_some() => "simpler",
            Grade::Good => "good",
            Grade::Fair => "fair",
            Grade::Simpler => "simpler",
            Grade::Poor | Grade::NotLearnt => "poor",
            Grade::Unchecked => "unchecked",
        }
    }

    /// Whether what choices cost Online says which is better.
    pub(crate) fn has_costs(&self) -> bool {
        matches!(self.grade, Grade::Good | Grade::Fair | Grade::Simpler | Grade::Poor)
    }
}

impl HeldOutResult {
    /// Whether the choice predicts no better than the mean return.
    pub(super) fn is_unskilled(&self) -> bool {
        self.chosen_skill.is_some_and(|skill| skill <= 0.0)
    }
}
