use calib_stats::{Bounded, Estimate, kendall_tau_b, spearman};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{differ, errors::EnvironmentScores};
use crate::SweepError;

/// What held-out data says of one window.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct WindowTruth {
    /// Row of the held-out range that it begins at.
    pub start_row: u32,
    /// Runs over it.
    pub runs: usize,
    /// Steps of each run that were scored.
    pub scored_steps: usize,
    /// Its best candidate; none where every value diverged.
    pub best: Option<usize>,
}

/// How well a choice does on held-out data.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Agreement {
    /// The candidate.
    pub chosen: usize,
    /// Its mean NRMSE on held-out data.
    #[serde(with = "calib_stats::diverged")]
    #[schemars(with = "Option<f64>")]
    pub online_error: f64,
    /// exp(mean over windows of ln(error / best error of the window)) − 1; none if every value diverged.
    pub regret: Option<Bounded>,
    /// Geometric mean over windows of its error by the default's; none where it is the default.
    pub against_default: Option<Estimate>,
    /// Spearman's correlation of the ranking with the errors on held-out data; none if undefined.
    pub spearman: Option<f64>,
    /// Kendall's τ-b likewise.
    pub kendall: Option<f64>,
    /// Whether it is among the best `top_k`.
    pub top_k_hit: bool,
}

/// Another way to choose, that the choice has to be compared with.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "snake_case")]
// Its name in the schemas of `--json`.
#[schemars(rename = "Baseline")]
pub enum ChoiceBaseline {
    /// Keep the `[agent]` section's own values.
    Default,
    /// The smallest mean error on the replayed log.
    LogReplay,
    /// The best value on the latest window of the log alone.
    LatestWindow,
    /// Every value with the same chance: the mean regret.
    Random,
    /// The one value that is best over all held-out windows: nobody can know it beforehand.
    Hindsight,
    /// The best value of one held-out window, judged on the others: what a chooser that sees a window of the deployment
    /// itself, at another time, would cost. One window is weak evidence: choosers that see more of the plant can do better.
    AnotherWindow,
}

/// What a baseline costs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct BaselineRegret {
    /// Which one.
    pub baseline: ChoiceBaseline,
    /// The value that it chooses, where it is one.
    pub chosen: Option<usize>,
    /// Its regret; none where it cannot be said.
    pub regret: Option<Bounded>,
}

/// What held-out data says about all values.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Truth {
    /// Errors.
    pub scores: EnvironmentScores,
    /// Its windows, in the order of time.
    pub windows: Vec<WindowTruth>,
    /// Scored steps of a run in horizons of 1 / (1 − γ) steps: the least over windows, for the largest γ.
    pub horizons: f64,
    /// The value that is best over all windows; none if every value diverged.
    pub best: Option<usize>,
    /// Regret of each value, infinite (`null` in files) where it diverged; none if every value did.
    #[serde(default, with = "calib_stats::diverged::each_if_known")]
    #[schemars(with = "Option<Vec<calib_stats::diverged::Stored>>")]
    pub regrets: Option<Vec<f64>>,
    /// How the choice does.
    pub choice: Agreement,
    /// What other ways to choose cost.
    pub baselines: Vec<BaselineRegret>,
}

impl Truth {
    /// Whether the default has less error than the choice, with an interval that excludes equality.
    pub fn prefers_the_default(&self) -> bool {
        let interval = self.choice.against_default.and_then(|ratio| ratio.interval);
        interval.is_some_and(|interval| interval.low > 1.0)
    }

    /// Whether the choice has less error than the default, with an interval that excludes equality.
    pub fn improves_on_the_default(&self) -> bool {
        let interval = self.choice.against_default.and_then(|ratio| ratio.interval);
        interval.is_some_and(|interval| interval.high < 1.0)
    }

    /// Whether the errors of settings differ. True for a single setting.
    pub fn tells_apart(&self) -> bool {
        // The best setting of a window has no regret there. If no setting has any regret, all errors are equal.
        self.regrets.as_deref().is_none_or(differ)
    }
}

/// Returns the position of the smallest value, the first of several.
pub(super) fn least(values: &[f64]) -> usize {
    (0..values.len()).min_by(|&a, &b| values[a].total_cmp(&values[b])).unwrap_or(0)
}

/// Returns the correlations of a ranking with the truth.
pub(super) fn correlations(
    scores: &[f64],
    losses: &[f64],
) -> Result<(Option<f64>, Option<f64>), SweepError> {
    if scores.len() < 2 {
        return Ok((None, None));
    }
    Ok((spearman(scores, losses)?, kendall_tau_b(scores, losses)?))
}
