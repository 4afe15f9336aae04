use calib_stats::{Bounded, Estimate, kendall_tau_b, spearman};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{differ::differ, errors::EnvironmentScores};
use crate::SweepError;

/// Results on held-out data for one window.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct WindowTruth {
    /// Row of the held-out range at which the window begins.
    pub start_row: u32,
    /// Number of runs over the window.
    pub runs: usize,
    /// Number of scored steps of each run.
    pub scored_steps: usize,
    /// Index of the best setting of the window; none if every setting diverged.
    pub best: Option<usize>,
}

/// How well a choice does on held-out data.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Agreement {
    /// Index of the chosen setting.
    pub chosen: usize,
    /// Mean NRMSE of the choice on held-out data.
    #[serde(with = "calib_stats::diverged")]
    #[schemars(with = "Option<f64>")]
    pub online_error: f64,
    /// exp(mean over windows of ln(error / best error of the window)) − 1; none if every setting diverged.
    pub regret: Option<Bounded>,
    /// Geometric mean over windows of its error divided by the default's error; none if the choice is the default.
    pub against_default: Option<Estimate>,
    /// Spearman's correlation of the ranking with the errors on held-out data; none if undefined.
    pub spearman: Option<f64>,
    /// Kendall's τ-b of the ranking with the errors on held-out data; none if undefined.
    pub kendall: Option<f64>,
    /// Whether the choice is among the best `top_k` settings.
    pub top_k_hit: bool,
}

/// Another selection method, with which the choice is compared.
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
    /// The best setting on the latest window of the log alone.
    LatestWindow,
    /// A uniformly random setting: the mean regret.
    Random,
    /// The best fixed setting over all held-out windows, which is known only afterwards.
    Hindsight,
    /// The best setting of one held-out window, judged on the others. It shows the regret of a selection method that sees
    /// the deployment itself, at another time. One window is weak evidence, so selection methods that see more of the plant
    /// can do better.
    AnotherWindow,
}

/// Regret of a selection method.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct BaselineRegret {
    /// The selection method.
    pub baseline: ChoiceBaseline,
    /// Index of the setting that it chooses, if it chooses a single one.
    pub chosen: Option<usize>,
    /// Its regret; none if it cannot be computed.
    pub regret: Option<Bounded>,
}

/// Results on held-out data for all settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Truth {
    /// Errors of all settings.
    pub scores: EnvironmentScores,
    /// The held-out windows, in order of time.
    pub windows: Vec<WindowTruth>,
    /// Number of scored steps of a run, in effective horizons of 1 / (1 − γ) steps: the smallest over windows, for the
    /// largest γ.
    pub horizons: f64,
    /// Index of the best setting over all windows; none if every setting diverged.
    pub best: Option<usize>,
    /// Regret of each setting, infinite (`null` in files) if it diverged; none if every setting diverged.
    #[serde(default, with = "calib_stats::diverged::each_if_known")]
    #[schemars(with = "Option<Vec<calib_stats::diverged::Stored>>")]
    pub regrets: Option<Vec<f64>>,
    /// Results of the choice.
    pub choice: Agreement,
    /// Regrets of other selection methods.
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
