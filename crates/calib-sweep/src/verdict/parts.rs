use calib_agent::{Part, SimplePredictor};

use super::{
    Judging, PartChoice, Recommendation, SensorVerdict, errors::Errors, judge::SensorResults,
};
use crate::{EnvironmentId, SweepError, UnitResult};

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
            predictor: results.predictor_to_use(&own, judging.best),
            simple: own.simpler().or_else(|| own.preferred_simple()).cloned(),
        });
    }
    Ok(choices)
}

impl SensorResults<'_> {
    /// Returns the simple predictor that a verdict recommends, if it recommends one: that which decides against the
    /// choice, or else the start of the setting that does not learn. `best` is as in [`Judging`].
    fn predictor_to_use(
        &self,
        verdict: &SensorVerdict,
        best: Option<SimplePredictor>,
    ) -> Option<SimplePredictor> {
        if verdict.recommendation() != Recommendation::UseSimplePredictor {
            return None;
        }
        match verdict.simpler() {
            Some(simpler) => Some(simpler.predictor),
            None => self.candidates[verdict.learning_off?].start(best),
        }
    }
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
