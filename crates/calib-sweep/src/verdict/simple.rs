use calib_agent::SimplePredictor;
use calib_stats::{Estimate, summarise};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{
    Judging,
    errors::{Errors, Stream},
};
use crate::{Candidate, EnvironmentId, ErrorScale, SweepError};

/// An agent is recommended only if it has at most this many times the error of the simple predictor that the log prefers.
const NO_WORSE: f64 = 1.02;

/// Of predictors whose errors on the log are within this factor, the simplest is preferred.
const ALIKE: f64 = 1.01;

/// A simple predictor beside the chosen agent, on the same held-out windows and steps.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SimpleComparison {
    /// What predicts.
    pub predictor: SimplePredictor,
    /// Mean over windows of its NRMSE.
    pub online_error: f64,
    /// Mean over windows of its RMSE, in normalised units of the return.
    pub online_rmse: f64,
    /// Geometric mean of its NRMSE over windows of the log, when it is fitted on the rest of the log.
    pub log_error: Option<f64>,
    /// Error of the chosen agent by that of the predictor: geometric mean over held-out windows, with its interval over them.
    /// None where both have no error.
    pub ratio: Option<Estimate>,
}

impl SimpleComparison {
    /// Whether the chosen agent has more error, and that is no chance. Where there is no interval, two per cent count.
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

/// The simple predictors that were scored on the held-out windows, beside a candidate.
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

/// The simple predictor that one would deploy: the best on windows of the log, as the agent is chosen. The best on held-out
/// windows is known only afterwards; it is taken where nothing of the log was replayed.
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

/// Whether the agent has less error than the training mean, as far as that was compared.
pub(super) fn beats_the_mean(compared: &[SimpleComparison]) -> bool {
    let mean = compared.iter().find(|own| own.predictor == SimplePredictor::Mean);
    mean.and_then(|mean| mean.ratio).is_none_or(|ratio| ratio.value < 1.0)
}

/// The simple predictor to use instead of the agent, if there is one: the [`preferred`] one, if the agent is not known to match
/// it, or another that is better than the agent by more than chance. Where the training mean does as well as that, the mean.
pub(super) fn decisive(compared: &[SimpleComparison]) -> Option<&SimpleComparison> {
    let unmatched = preferred(compared).filter(|own| own.is_better() || !own.is_matched());
    let instead = unmatched.or_else(|| {
        let better = compared.iter().filter(|own| own.is_better());
        better.reduce(
            |best, other| if ratio_or_one(other) > ratio_or_one(best) { other } else { best },
        )
    })?;
    let mean = compared.iter().find(|own| own.predictor == SimplePredictor::Mean);
    mean.filter(|mean| mean.online_rmse <= instead.online_rmse).or(Some(instead))
}

/// By how much the agent has more error; as much where that is not known.
fn ratio_or_one(comparison: &SimpleComparison) -> f64 {
    comparison.ratio.map_or(1.0, |ratio| ratio.value)
}
