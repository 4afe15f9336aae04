use calib_agent::Part;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Judging, Recommendation, SimpleComparison, errors::Errors, judge::SensorResults};
use crate::{EnvironmentId, SweepError, UnitResult};

/// The choice and the recommendation by the errors over one part of each run. They are those that `sweep.scored` would
/// give for this part.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PartChoice {
    /// The part of each run.
    pub part: Part,
    /// Index of the setting chosen by these errors.
    pub chosen: usize,
    /// Mean NRMSE of this setting over the part on held-out data; none without held-out data.
    pub online_error: Option<f64>,
    /// Mean NRMSE over the part of the setting that the verdict chose; none without held-out data.
    pub online_error_of_verdict: Option<f64>,
    /// The recommendation if errors over this part count.
    pub recommendation: Recommendation,
    /// The simple predictor to use instead of this setting, or else the one that the log prefers, compared over this part; none if simple
    /// predictors are not known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub simple: Option<SimpleComparison>,
    /// Index of a setting that starts from a simple predictor and does not learn after the log, as in the verdict; none if `simple` is to be
    /// used instead.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub learning_off: Option<usize>,
}

/// Returns the choice by each part of a run that has steps to score in every environment. The verdict chose the setting
/// `chosen`.
pub(super) fn choices(
    results: &SensorResults<'_>,
    judging: &Judging<'_>,
    chosen: usize,
) -> Result<Vec<PartChoice>, SweepError> {
    let mut choices = Vec::new();
    for part in Part::ALL {
        // Resamples show how firm the choice of the verdict is, and are not asked of parts.
        let judging = Judging { part, resamples: 0, ..*judging };
        let Ok(measured) = results.measured(&judging) else { continue };
        let own = results.judged(&measured, &judging)?;
        let online = measured.online.as_ref().map(Errors::means).transpose()?;
        let [online_error, online_error_of_verdict] = [own.chosen, chosen].map(|candidate| {
            online.as_ref().map(|means| means[candidate]).filter(|error| error.is_finite())
        });
        choices.push(PartChoice {
            part,
            chosen: own.chosen,
            online_error,
            online_error_of_verdict,
            recommendation: own.recommendation(),
            simple: own.simpler().or_else(|| own.preferred_simple()).cloned(),
            learning_off: own.learning_off.filter(|_| own.simpler().is_none()),
        });
    }
    Ok(choices)
}

/// Returns the share of the squared error of a setting's held-out runs that falls into their first tenth. The agent has
/// learned little by then. Computed from the learning curves. `None` if a curve has fewer than ten points, or the error
/// is zero.
pub(super) fn start_up_share(results: &[&UnitResult], candidate: usize) -> Option<f64> {
    let mut first = 0.0;
    let mut all = 0.0;
    for result in results.iter().filter(|result| result.unit.environment == EnvironmentId::Online) {
        let row = result.rows.iter().find(|row| row.candidate == candidate)?;
        if row.diverged_at.is_some() || row.curve.len() < 10 {
            return None;
        }
        for point in &row.curve {
            let squared = point.rmse * point.rmse;
            all += squared;
            if point.step * 10 <= row.steps {
                first += squared;
            }
        }
    }
    (all > 0.0).then(|| first / all)
}
