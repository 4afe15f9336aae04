use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use calib_stats::Estimate;

use super::{
    rule::Standing,
    truth::{Baseline, Truth},
};

/// How well held-out data supports a choice.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Grade {
    /// No worse than what a chooser that sees another held-out window would cost, and not worse than the default.
    Good,
    /// Worse than that, or nothing to compare with, as where only one window was held out; but not worse than the default.
    Fair,
    /// The default is better, or the choice diverged.
    Poor,
    /// Even the best value predicts no better than the mean return of each window.
    NotLearnt,
    /// No held-out data, or none whose returns vary, or are known to.
    Unchecked,
}

/// Regrets that differ by less than this are alike.
const ALIKE: f64 = 0.01;

impl Grade {
    /// By these rules, the first that holds:
    ///
    /// 1. *poor* if the choice diverged in some stream that it was made from, as every other value then did;
    /// 2. *unchecked* without held-out data;
    /// 3. *poor* if the choice diverged in some held-out window;
    /// 4. *not learnt* if the best value over windows has no skill: 1 − RMSE / σ ≤ 0, and *unchecked* where σ is 0, or not known, and skill says nothing;
    /// 5. *poor* if the choice has more error than the default, with an interval over windows that excludes equality;
    /// 6. *good* if its regret is at most one percentage point above that of choosing by another held-out window;
    /// 7. *fair* otherwise.
    ///
    /// The limits follow from what was measured, but for the point.
    pub(super) fn of(standing: Standing, truth: Option<&Truth>) -> Self {
        if standing == Standing::Diverged {
            return Self::Poor;
        }
        let Some(truth) = truth else { return Self::Unchecked };
        let (Some(best), Some(regret)) = (truth.best, truth.choice.regret) else {
            return Self::Poor;
        };
        if truth.choice.online_error.is_infinite() {
            return Self::Poor;
        }
        match truth.scores.skill[best] {
            Some(skill) if skill > 0.0 => {}
            Some(_) => return Self::NotLearnt,
            None => return Self::Unchecked,
        }
        let low = |of: Estimate| of.interval.map(|interval| interval.low);
        if truth.choice.against_default.and_then(low).is_some_and(|low| low > 1.0) {
            return Self::Poor;
        }
        let another = truth.baselines.iter().find(|of| of.baseline == Baseline::AnotherWindow);
        match another.and_then(|of| of.regret) {
            Some(another) if regret.value <= another.value + ALIKE => Self::Good,
            _ => Self::Fair,
        }
    }
}
