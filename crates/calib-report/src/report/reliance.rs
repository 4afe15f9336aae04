//! Names of grades, and the advice that each grade allows.

use calib_agent::SimplePredictor;
use calib_sweep::ENOUGH_WINDOWS;

use super::{Grade, HeldOutResult, Separation, Simpler, Verdict, simple::WORTH_MENTIONING};

/// Further learning is worthwhile if the error is at most this share of that without further learning. Our choice.
const WORTH_A_WORD: f64 = 0.99;

const SIMPLER_IS_BETTER: &str = "Simpler is better: no agent needed";
const SIMPLER_ON_THE_LOG: &str = "Simpler is better on the log: no agent needed";
const UNDECIDED: &str = "Undecided: the agent may be better";
const FEW_WINDOWS: &str = "Undecided: too few held-out windows to tell";
const FEW_OF_THE_LOG: &str = "Undecided: too few windows of the log to tell";

impl Verdict {
    /// Whether a usable choice was made from evidence that shows no difference between settings.
    pub(super) fn is_arbitrary(&self) -> bool {
        self.evidence == Separation::Alike
            && matches!(self.grade, Grade::Good | Grade::Fair | Grade::Unchecked)
    }

    /// Whether every setting diverged on held-out data.
    pub(crate) fn has_all_diverged(&self) -> bool {
        self.online.as_ref().is_some_and(|online| online.regret.is_none())
    }

    /// Returns the reliability of the choice in a few words.
    pub(crate) fn badge(&self) -> &'static str {
        match (&self.online, self.grade) {
            _ if self.is_arbitrary() => "No clear difference: all settings did alike",
            _ if self.may_gain_by_learning() => UNDECIDED,
            (_, Grade::Good | Grade::Fair) if self.has_few_windows() => FEW_WINDOWS,
            _ if self.without_learning().is_some() => SIMPLER_IS_BETTER,
            (_, Grade::Simpler) if self.is_of_log() => self.badge_of_log(),
            (_, Grade::NotLearnt) if self.is_of_log() => {
                "Not learned: nothing beats a mean on the log"
            }
            (Some(online), _) if online.stands_still => {
                "Not checked: the sensor is constant in the held-out period"
            }
            (Some(_), Grade::Unchecked) => "Not checked: no clear difference on held-out data",
            (_, Grade::Good) => "Good: at most 5 % from the best setting",
            (_, Grade::Fair) => "Fair: not shown to be worse than the default",
            (_, Grade::Simpler) if self.may_beat_simple() => UNDECIDED,
            (_, Grade::Simpler) if self.may_be_simpler() => FEW_WINDOWS,
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

    /// Returns the badge if a simple predictor is as good or better on the log.
    fn badge_of_log(&self) -> &'static str {
        if self.may_beat_simple() {
            UNDECIDED
        } else if self.may_be_simpler() {
            FEW_OF_THE_LOG
        } else {
            SIMPLER_ON_THE_LOG
        }
    }

    /// Whether the recommended simple predictor has less error than the agent, in too few windows for an interval.
    fn may_be_simpler(&self) -> bool {
        self.simpler.as_ref().is_some_and(|simpler| !simpler.is_shown() && simpler.is_better)
    }

    /// Returns the simple predictor to use instead of a good choice, because further learning adds nothing to it.
    pub fn without_learning(&self) -> Option<SimplePredictor> {
        self.frozen.filter(|_| matches!(self.grade, Grade::Good | Grade::Fair))
    }

    /// Whether the chosen agent has less error than the default that learns nothing.
    /// The difference is above rounding, but may be chance.
    pub(super) fn may_gain_by_learning(&self) -> bool {
        let against = self.online.as_ref().and_then(|online| online.against_default);
        self.without_learning().is_some()
            && !self.learns_nothing
            && against.is_some_and(|ratio| ratio.value < WORTH_MENTIONING)
    }

    /// Whether held-out windows exclude that further learning lowers the error by 1 %. If the choice itself learns nothing, they
    /// exclude it if no other setting was better in any window, or hardly better.
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

    /// Whether there are too few held-out windows to separate most differences from chance.
    pub(super) fn has_few_windows(&self) -> bool {
        self.online.as_ref().is_some_and(|online| online.windows < ENOUGH_WINDOWS)
    }

    /// Returns the advice in a word or two.
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

    /// Whether the agent has less error than the recommended simple predictor, which may be chance.
    fn may_beat_simple(&self) -> bool {
        self.simpler.as_ref().is_some_and(Simpler::may_be_worse)
    }

    /// Whether the advice is a simple predictor instead of an agent.
    pub(crate) fn is_simpler_better(&self) -> bool {
        self.grade == Grade::Simpler || self.without_learning().is_some()
    }

    /// Returns the recommended simple predictor, if there is one.
    pub(crate) fn simple_to_use(&self) -> Option<SimplePredictor> {
        let simpler = self.simpler.as_ref().filter(|_| self.grade == Grade::Simpler);
        self.without_learning().or(simpler.map(|simpler| simpler.predictor))
    }

    /// Returns the name of the grade in the style sheet.
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

    /// Whether the costs of the choices on held-out data show which choice is better.
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
