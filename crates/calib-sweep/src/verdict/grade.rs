use serde::{Deserialize, Serialize};

use calib_stats::Estimate;

use super::truth::{Baseline, Truth};

/// How well held-out data supports a choice.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Grade {
    /// No worse than what a chooser that sees another held-out window would cost, and not worse than the default.
    Good,
    /// Worse than that, or only one window was held out; but not worse than the default.
    Fair,
    /// The default is better, or the choice diverged.
    Poor,
    /// Even the best value predicts no better than the mean return.
    NotLearnt,
    /// No held-out data.
    Unchecked,
}

/// Regrets that differ by less than this are alike.
const ALIKE: f64 = 0.01;

impl Grade {
    /// By these rules, the first that holds:
    ///
    /// 1. *unchecked* without held-out data;
    /// 2. *poor* if the choice, or every value, diverged in some window;
    /// 3. *not learnt* if the best value over windows has no skill: 1 − RMSE / σ ≤ 0;
    /// 4. *poor* if the choice has more error than the default, with an interval that excludes equality;
    /// 5. *good* if its regret is at most one percentage point above that of choosing by another held-out window;
    /// 6. *fair* otherwise.
    ///
    /// Regrets below that of another window are noise of the windows, so there is no better grade than that. The limits follow from
    /// what was measured, but for the point.
    pub fn of(truth: Option<&Truth>) -> Self {
        let Some(truth) = truth else { return Self::Unchecked };
        let (Some(best), Some(regret)) = (truth.best, truth.choice.regret) else {
            return Self::Poor;
        };
        if regret.value.is_infinite() {
            return Self::Poor;
        }
        if truth.scores.skill[best].is_none_or(|skill| skill <= 0.0) {
            return Self::NotLearnt;
        }
        let low = |of: Estimate| of.interval.map(|interval| interval.low);
        if truth.choice.against_default.and_then(low).is_some_and(|low| low > 1.0) {
            return Self::Poor;
        }
        let floor = truth.baselines.iter().find(|of| of.baseline == Baseline::AnotherWindow);
        match floor.and_then(|of| of.regret) {
            Some(floor) if regret.value <= floor.value + ALIKE => Self::Good,
            _ => Self::Fair,
        }
    }
}
