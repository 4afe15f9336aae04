use calib_agent::SimplePredictor;
use calib_stats::{Estimate, summarise};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{
    ENOUGH_WINDOWS, Judging,
    errors::{Errors, Stream},
    truth::Truth,
};
use crate::{Candidate, EnvironmentId, ErrorScale, SweepError};

/// An agent is recommended only if its error is at most this many times that of the simple predictor that the log
/// prefers.
const NO_WORSE: f64 = 1.02;

/// The simplest predictor is preferred among those whose errors on the log are within this factor of the best.
const ALIKE: f64 = 1.01;

/// An agent ran away in a window if its error there exceeds this many times that of a simple predictor. Our choice.
const RUNAWAY: f64 = 10.0;

/// Held-out values at this many spreads of the training range from its mean are unlike anything learned there. The unit
/// or the zero of the sensor may have changed. Our choice.
const ELSEWHERE: f64 = 20.0;

/// A simple predictor compared with the chosen agent, on the same held-out windows and steps.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SimpleComparison {
    /// Kind of the predictor.
    pub predictor: SimplePredictor,
    /// Mean over windows of the predictor's NRMSE.
    pub online_error: f64,
    /// Mean over windows of the predictor's RMSE, in normalised units of the return.
    pub online_rmse: f64,
    /// Geometric mean of the predictor's NRMSE over windows of the log, each with the predictor fitted on the rest of the
    /// log.
    pub log_error: Option<f64>,
    /// Error of the chosen agent divided by the error of the predictor: geometric mean over held-out windows, with its
    /// interval over windows. None if both have no error.
    pub ratio: Option<Estimate>,
    /// Number of held-out windows in which the agent has more than ten times the error of the predictor. Default: none.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub runaway_windows: usize,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde wants a reference")]
fn is_zero(count: &usize) -> bool {
    *count == 0
}

impl SimpleComparison {
    /// Whether the chosen agent has more error by more than chance. Without an interval, a difference of two per cent
    /// decides.
    pub fn is_better(&self) -> bool {
        match self.ratio {
            Some(Estimate { interval: Some(interval), .. }) => interval.low > 1.0,
            Some(Estimate { value, interval: None }) => value > NO_WORSE,
            None => false,
        }
    }

    /// Whether the chosen agent is known to have at most two per cent more error.
    fn is_matched(&self) -> bool {
        match self.ratio {
            Some(Estimate { interval: Some(interval), .. }) => interval.high <= NO_WORSE,
            Some(Estimate { value, interval: None }) => value <= NO_WORSE,
            None => true,
        }
    }
}

/// Compares the simple predictors that were scored on the held-out windows with a setting.
pub(super) fn compared(
    judging: &Judging<'_>,
    sensor: &str,
    chosen: &Candidate,
    online: &Errors,
    log: Option<&Errors>,
) -> Result<Vec<SimpleComparison>, SweepError> {
    let scale = ErrorScale::find(judging.scales, sensor, chosen);
    let rmse = |predictor: SimplePredictor, environment: EnvironmentId, stream: &Stream| {
        let own = judging.simple.iter().find(|score| {
            score.sensor == sensor
                && score.predictor == predictor
                && score.environment == environment
                && score.start_row == stream.start_row
        });
        own.and_then(|score| Some(score.scores.of(judging.part)?.rmse))
    };
    let mut compared = Vec::new();
    for predictor in SimplePredictor::ALL {
        let own: Option<Vec<f64>> = online
            .streams
            .iter()
            .map(|stream| rmse(predictor, EnvironmentId::Online, stream))
            .collect();
        let Some(own) = own.filter(|own| !own.is_empty()) else { continue };
        let on_log: Option<Vec<f64>> = log.and_then(|log| {
            log.streams
                .iter()
                .map(|stream| rmse(predictor, EnvironmentId::LogReplay, stream))
                .collect()
        });
        let agent = online.streams.iter().map(|stream| stream.means()[chosen.index] * scale);
        let logarithms: Vec<f64> = agent
            .zip(&own)
            .filter(|(agent, own)| *agent != 0.0 || **own != 0.0)
            .map(|(agent, own)| (agent / own).ln())
            .collect();
        let runaway_windows =
            logarithms.iter().filter(|logarithm| **logarithm > RUNAWAY.ln()).count();
        let online_rmse = calib_stats::mean(&own)?;
        compared.push(SimpleComparison {
            predictor,
            online_error: online_rmse / scale,
            online_rmse,
            log_error: on_log.filter(|errors| !errors.is_empty()).map(|errors| {
                let sum: f64 = errors.iter().map(|error| (error / scale).ln()).sum();
                (sum / errors.len() as f64).exp()
            }),
            ratio: if logarithms.is_empty() { None } else { Some(ratio(&logarithms)?) },
            runaway_windows,
        });
    }
    Ok(compared)
}

fn ratio(logarithms: &[f64]) -> Result<Estimate, SweepError> {
    if logarithms.iter().any(|logarithm| logarithm.is_infinite()) {
        let diverged = logarithms.contains(&f64::INFINITY);
        return Ok(Estimate { value: if diverged { f64::INFINITY } else { 0.0 }, interval: None });
    }
    let summary = summarise(logarithms)?;
    let interval = summary.interval.map(|interval| calib_stats::Interval {
        low: interval.low.exp(),
        high: interval.high.exp(),
    });
    Ok(Estimate { value: summary.mean.exp(), interval })
}

/// Returns the simple predictor that one would deploy: the best on windows of the log, which also choose the agent. The
/// best on held-out windows is only known afterwards. It is used if no log was replayed.
pub(super) fn preferred(compared: &[SimpleComparison]) -> Option<&SimpleComparison> {
    match compared.iter().filter_map(|own| own.log_error).reduce(f64::min) {
        Some(least) => {
            compared.iter().find(|own| own.log_error.is_some_and(|error| error <= ALIKE * least))
        }
        None => compared
            .iter()
            .reduce(|best, other| if other.online_rmse < best.online_rmse { other } else { best }),
    }
}

/// Whether the agent is shown to have two per cent less error than the training mean, if that was compared. With
/// `learning_off` the same must hold for the setting that replaces the choice.
///
/// Intervals over few windows are wide, whatever the agent learned. In that case the ratio itself decides.
pub(super) fn beats_the_mean(
    compared: &[SimpleComparison],
    truth: &Truth,
    learning_off: Option<usize>,
) -> bool {
    let Some(ratio) = mean_of(compared).and_then(|mean| mean.ratio) else { return true };
    let is_chance = truth.windows.len() >= ENOUGH_WINDOWS
        && ratio.interval.is_some_and(|interval| interval.high >= 1.0);
    let is_replaced = learning_off.is_some_and(|off| off != truth.choice.chosen);
    let of_default = truth.choice.against_default.filter(|_| is_replaced);
    // Both are geometric means over the same windows. Their quotient is the ratio of the default to the training mean.
    let used = of_default.map_or(ratio.value, |against| ratio.value / against.value);
    !is_chance && ratio.value * NO_WORSE <= 1.0 && (used.is_nan() || used * NO_WORSE <= 1.0)
}

/// Returns the distance of held-out values from the training mean, in spreads of the training range. `None` unless it
/// is so large that nothing was learned about such values.
pub(super) fn elsewhere(compared: &[SimpleComparison]) -> Option<f64> {
    let away = mean_of(compared)?.online_error;
    (away > ELSEWHERE && away.is_finite()).then_some(away)
}

/// Returns the comparison with the training mean.
pub(super) fn mean_of(compared: &[SimpleComparison]) -> Option<&SimpleComparison> {
    compared.iter().find(|own| own.predictor == SimplePredictor::Mean)
}

/// Returns the simple predictor to use instead of the agent, if there is one. This is the [`preferred`] one if the
/// agent is not known to match it, or otherwise one that is better than the agent by more than chance. If the training
/// mean is at most two per cent worse than that, the mean is returned.
pub(super) fn decisive(compared: &[SimpleComparison]) -> Option<&SimpleComparison> {
    let unmatched = preferred(compared).filter(|own| own.is_better() || !own.is_matched());
    let instead = unmatched.or_else(|| {
        let better = compared.iter().filter(|own| own.is_better());
        better.reduce(
            |best, other| if ratio_or_one(other) > ratio_or_one(best) { other } else { best },
        )
    })?;
    mean_of(compared).filter(|mean| does_as_well(mean, instead)).or(Some(instead))
}

/// Whether the training mean is as good as another predictor: no more error on average over windows, or at most two per
/// cent more in the geometric mean. A smaller advantage does not count as prediction.
fn does_as_well(mean: &SimpleComparison, other: &SimpleComparison) -> bool {
    // Both ratios have the same agent's error, so their quotient compares the predictors.
    let geometric = match (mean.ratio, other.ratio) {
        (Some(mean), Some(other)) => other.value / mean.value,
        _ => f64::NAN,
    };
    mean.online_rmse <= other.online_rmse || geometric <= NO_WORSE
}

/// Returns the ratio of the agent's error to the predictor's, or 1 if it is not known.
fn ratio_or_one(comparison: &SimpleComparison) -> f64 {
    comparison.ratio.map_or(1.0, |ratio| ratio.value)
}
