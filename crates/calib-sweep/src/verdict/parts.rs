use calib_agent::Part;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{
    Judging,
    measured::{MeasuredErrors, NestedRuns},
    rule::Chooser,
};
use crate::{Candidate, EnvironmentId, SweepError, UnitResult};

/// The choice of the rule by the errors over another part of each run.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PartChoice {
    /// The part of each run.
    pub part: Part,
    /// Index of the setting chosen by these errors.
    pub chosen: usize,
    /// Mean NRMSE of this setting over the part on held-out data; none without held-out data.
    pub online_error: Option<f64>,
    /// Mean NRMSE over the part of the setting that the verdict chose; none without held-out data.
    pub online_error_of_verdict: Option<f64>,
}

/// Returns the choice by each part of a run that has steps to score in every environment.
pub(super) fn choices(
    results: &[&UnitResult],
    candidates: &[Candidate],
    judging: &Judging<'_>,
    chooser: &Chooser<'_>,
    chosen: usize,
) -> Result<Vec<PartChoice>, SweepError> {
    let mut choices = Vec::new();
    for part in Part::ALL {
        let judging = Judging { part, ..*judging };
        let Ok(measured) = MeasuredErrors::new(results, candidates, &judging) else { continue };
        let runs = NestedRuns::new(&measured)?;
        let own = chooser.choose(judging.rule, runs.whole().evidence())?;
        let online = measured.online.as_ref().map(super::errors::Errors::means).transpose()?;
        let error = |candidate: usize| {
            online.as_ref().map(|means| means[candidate]).filter(|error| error.is_finite())
        };
        choices.push(PartChoice {
            part,
            chosen: own,
            online_error: error(own),
            online_error_of_verdict: error(chosen),
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
