use calib_stats::{Estimate, competition_ranks, kendall_tau_b, spearman};
use serde::{Deserialize, Serialize};

use super::errors::EnvironmentScores;
use crate::{LOWER, SweepError};

/// What held-out data says of one window.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
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
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Agreement {
    /// The candidate.
    pub chosen: usize,
    /// Its mean NRMSE on held-out data.
    #[serde(with = "crate::unit::infinite")]
    pub online_error: f64,
    /// exp(mean over windows of ln(error / best error of the window)) − 1; none if every value diverged.
    pub regret: Option<Estimate>,
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
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Baseline {
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
    /// The best value of one held-out window, judged on the others: what a chooser that sees the deployment itself, at another
    /// time, would cost. What is below it is noise.
    AnotherWindow,
}

/// What a baseline costs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BaselineRegret {
    /// Which one.
    pub baseline: Baseline,
    /// The value that it chooses, where it is one.
    pub chosen: Option<usize>,
    /// Its regret; none where it cannot be said.
    pub regret: Option<Estimate>,
}

/// What held-out data says about all values.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Truth {
    /// Errors.
    pub scores: EnvironmentScores,
    /// Its windows, in the order of time.
    pub windows: Vec<WindowTruth>,
    /// Scored steps of a run in horizons of 1 / (1 − γ) steps: the least over windows, for the largest γ.
    pub horizons: f64,
    /// The value that is best over all windows; none if every value diverged.
    pub best: Option<usize>,
    /// Regret of each value; none if every value diverged.
    pub regrets: Option<Vec<f64>>,
    /// How the choice does.
    pub choice: Agreement,
    /// What other ways to choose cost.
    pub baselines: Vec<BaselineRegret>,
}

/// Logarithms of the errors by the smallest of their window, `[window][value]`, of the windows in which some value did not diverge.
pub(super) fn losses(windows: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let of = |errors: &Vec<f64>| {
        let least = errors.iter().copied().fold(f64::INFINITY, f64::min);
        // Errors of 0 are those of a sensor that does not move: all that are 0 are best.
        let loss = |&error: &f64| if error == least { 0.0 } else { (error / least).ln() };
        least.is_finite().then(|| errors.iter().map(loss).collect())
    };
    windows.iter().filter_map(of).collect()
}

/// Mean loss of each value over windows; none if there is none.
pub(super) fn mean_losses(losses: &[Vec<f64>]) -> Option<Vec<f64>> {
    let values = losses.first()?.len();
    let mean = |value: usize| losses.iter().map(|of| of[value]).sum::<f64>() / losses.len() as f64;
    Some((0..values).map(mean).collect())
}

/// Mean loss of the best value of one window on the others.
pub(super) fn another_window(losses: &[Vec<f64>]) -> Option<f64> {
    let mut others = Vec::new();
    for (window, own) in losses.iter().enumerate() {
        let chosen = least(own);
        let rest = losses.iter().enumerate().filter(|&(other, _)| other != window);
        others.extend(rest.map(|(_, of)| of[chosen]));
    }
    let count = others.len() as f64;
    (!others.is_empty()).then(|| others.iter().sum::<f64>() / count)
}

/// The first of the smallest.
pub(super) fn least(values: &[f64]) -> usize {
    (0..values.len()).min_by(|&a, &b| values[a].total_cmp(&values[b])).unwrap_or(0)
}

/// Correlations of a ranking with the truth.
pub(super) fn correlations(
    scores: &[f64],
    losses: &[f64],
) -> Result<(Option<f64>, Option<f64>), SweepError> {
    if scores.len() < 2 {
        return Ok((None, None));
    }
    Ok((spearman(scores, losses)?, kendall_tau_b(scores, losses)?))
}

/// Whether a choice is among the `k` best.
pub(super) fn is_among_best(losses: &[f64], chosen: usize, k: usize) -> Result<bool, SweepError> {
    Ok(losses[chosen].is_finite() && competition_ranks(losses, LOWER)?[chosen] <= k)
}
