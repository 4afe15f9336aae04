//! What to deploy, and how well that is supported.

use crate::Setting;

/// Up to this regret a choice is called good, and up to the next one fair.
const GOOD_REGRET: f64 = 0.05;
const FAIR_REGRET: f64 = 0.20;

/// The value a calibration model chose for one sensor.
#[derive(Debug, Clone, PartialEq)]
pub struct Verdict {
    /// The predicted sensor.
    pub sensor: String,
    /// The swept hyperparameter, as in the study file.
    pub field: String,
    /// The calibration model that chose.
    pub model: String,
    /// Its choice.
    pub chosen: Setting,
    /// All values that share the smallest worst rank, the choice included, in grid order.
    pub tie_set: Vec<Setting>,
    /// That worst rank; 1 = best in every member.
    pub worst_rank: usize,
    /// Number of values in the grid.
    pub values: usize,
    /// Number of members of the ensemble.
    pub members: usize,
    /// How the choice did Online; `None` if no data was held out.
    pub online: Option<Agreement>,
    /// The value one would use without calib.
    pub default: Option<Alternative>,
    /// The value one would choose by replaying the training log.
    pub log_replay: Option<Alternative>,
    /// What else is worth knowing about this verdict.
    pub notes: Vec<String>,
}

/// The choice, judged by held-out data.
#[derive(Debug, Clone, PartialEq)]
pub struct Agreement {
    /// Mean Online score of the choice; infinite if it diverged.
    pub chosen_error: f64,
    /// The best value Online.
    pub best: Setting,
    /// Its mean Online score.
    pub best_error: f64,
    /// (score of the choice − best) / best; `None` where it is undefined.
    pub regret: Option<f64>,
    /// Spearman correlation between the model's ranking and Online's; `None` where it is undefined.
    pub spearman: Option<f64>,
    /// Kendall's τ-b between them.
    pub kendall: Option<f64>,
    /// Whether the choice is among the k best Online.
    pub top_k: Option<TopK>,
}

/// Whether the choice is among the `k` best values Online.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TopK {
    /// How many values count as best.
    pub k: usize,
    /// Whether the choice is one of them.
    pub hit: bool,
}

/// Another way to choose, and what it would have cost.
#[derive(Debug, Clone, PartialEq)]
pub struct Alternative {
    /// The value it would have chosen.
    pub value: Setting,
    /// Its regret Online; `None` without Online.
    pub regret: Option<f64>,
}

/// How well a verdict is supported by held-out data.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Grade {
    /// Regret up to 5 %.
    Good,
    /// Regret up to 20 %.
    Fair,
    /// Larger regret, or the choice, or every value, diverged.
    Poor,
    /// No held-out data.
    Unchecked,
}

impl Verdict {
    /// How well held-out data supports the choice. The limits are our choice.
    pub fn grade(&self) -> Grade {
        match self.online.as_ref().map(|online| online.regret) {
            None => Grade::Unchecked,
            Some(Some(regret)) if regret <= GOOD_REGRET => Grade::Good,
            Some(Some(regret)) if regret <= FAIR_REGRET => Grade::Fair,
            Some(_) => Grade::Poor,
        }
    }
}

impl Grade {
    /// The grade in a few words.
    pub const fn label(self) -> &'static str {
        match self {
            Self::Good => "Good: within 5 % of the best",
            Self::Fair => "Fair: within 20 % of the best",
            Self::Poor => "Poor: do not rely on it",
            Self::Unchecked => "Not checked on held-out data",
        }
    }

    /// Its name in the style sheet.
    pub(crate) const fn class(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Fair => "fair",
            Self::Poor => "poor",
            Self::Unchecked => "unchecked",
        }
    }
}
