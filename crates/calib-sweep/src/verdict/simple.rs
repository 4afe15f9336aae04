use calib_agent::SimplePredictor;
use calib_stats::{Estimate, summarise_overlapping};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{ENOUGH_WINDOWS, Judging, errors::Errors, measured::MeasuredErrors, truth::Truth};
use crate::{Candidate, ErrorScale, SweepError};

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

/// A simple predictor compared with the chosen agent, on the same windows and steps.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SimpleComparison {
    /// Kind of the predictor.
    pub predictor: SimplePredictor,
    /// Mean over held-out windows of the predictor's NRMSE; none without held-out data.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub online_error: Option<f64>,
    /// Mean over held-out windows of the predictor's RMSE, in normalised units of the return; none without held-out data.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub online_rmse: Option<f64>,
    /// Geometric mean of the predictor's NRMSE over windows of the log, each with the predictor fitted on the rest of the
    /// log.
    pub log_error: Option<f64>,
    /// Error of the chosen agent divided by the error of the predictor: geometric mean over windows, with its interval over
    /// windows. They are the held-out windows, or those of the log if `log_windows` is there. None if both have no error,
    /// or if there are no windows in which the returns vary.
    pub ratio: Option<Estimate>,
    /// Error of the predictor divided by that of the training mean, over the same windows as the ratio. None for that mean.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub against_mean: Option<Estimate>,
    /// Number of independent windows of the replayed log that both ratios are over. None if they are over held-out windows.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub log_windows: Option<usize>,
    /// Number of these windows in which the agent has more than ten times the error of the predictor. Default: none.
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

    /// Whether the chosen agent is shown to have at least two per cent less error. Without an interval nothing is shown.
    pub fn is_beaten(&self) -> bool {
        self.ratio.is_some_and(is_shown_lower)
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

/// Compares the simple predictors with a setting: on the held-out windows, or on those of the replayed log if nothing is
/// held out or the sensor does not vary there.
pub(super) fn compared(
    judging: &Judging<'_>,
    sensor: &str,
    chosen: &Candidate,
    measured: &MeasuredErrors,
) -> Result<Vec<SimpleComparison>, SweepError> {
    let scale = ErrorScale::find(judging.scales, sensor, chosen);
    let online = measured.online.as_ref();
    let log = measured.log.as_ref();
    let varying = online.filter(|online| !judging.stands_still && online.varies());
    let deciding = varying.or(log);
    let independent = deciding.map_or(0, Errors::independent);
    let agent: Vec<f64> = deciding
        .into_iter()
        .flat_map(|errors| &errors.streams)
        .map(|stream| stream.mean(chosen.index) * scale)
        .collect();
    let mean = deciding.and_then(|errors| rmses(judging, sensor, SimplePredictor::Mean, errors));
    let mut compared = Vec::new();
    for predictor in SimplePredictor::ALL {
        let [own, held_out, replayed] = [deciding, online, log]
            .map(|errors| errors.and_then(|errors| rmses(judging, sensor, predictor, errors)));
        if own.is_none() && held_out.is_none() {
            continue;
        }
        let own = own.unwrap_or_default();
        let logarithms = log_ratios(&agent, &own);
        let runaway_windows =
            logarithms.iter().filter(|logarithm| **logarithm > RUNAWAY.ln()).count();
        let mean = mean.as_deref().filter(|_| predictor != SimplePredictor::Mean);
        let online_rmse = held_out.as_deref().map(calib_stats::mean).transpose()?;
        compared.push(SimpleComparison {
            predictor,
            online_error: online_rmse.map(|rmse| rmse / scale),
            online_rmse,
            log_error: replayed.map(|errors| {
                let sum: f64 = errors.iter().map(|error| (error / scale).ln()).sum();
                (sum / errors.len() as f64).exp()
            }),
            ratio: ratio(&logarithms, independent)?,
            against_mean: match mean {
                Some(mean) => ratio(&log_ratios(&own, mean), independent)?,
                None => None,
            },
            log_windows: (varying.is_none() && log.is_some()).then_some(independent),
            runaway_windows,
        });
    }
    Ok(compared)
}

/// Returns the RMSE of a predictor in each of these windows, in normalised units of the return. `None` unless it was
/// scored in all of them.
fn rmses(
    judging: &Judging<'_>,
    sensor: &str,
    predictor: SimplePredictor,
    errors: &Errors,
) -> Option<Vec<f64>> {
    let each = errors.streams.iter().map(|stream| {
        let own = judging.simple.iter().find(|score| {
            score.sensor == sensor
                && score.predictor == predictor
                && score.environment == errors.environment
                && score.start_row == stream.start_row
        })?;
        Some(own.scores.of(judging.part)?.rmse)
    });
    let all: Option<Vec<f64>> = each.collect();
    all.filter(|all| !all.is_empty())
}

/// Returns the logarithms of the ratios of errors, without the windows in which both are 0.
fn log_ratios(errors: &[f64], others: &[f64]) -> Vec<f64> {
    errors
        .iter()
        .zip(others)
        .filter(|(error, other)| **error != 0.0 || **other != 0.0)
        .map(|(error, other)| (error / other).ln())
        .collect()
}

/// Returns the geometric mean of ratios over windows, of which so many are independent. `None` without windows.
fn ratio(logarithms: &[f64], independent: usize) -> Result<Option<Estimate>, SweepError> {
    if logarithms.is_empty() {
        return Ok(None);
    }
    if logarithms.iter().any(|logarithm| logarithm.is_infinite()) {
        let diverged = logarithms.contains(&f64::INFINITY);
        let value = if diverged { f64::INFINITY } else { 0.0 };
        return Ok(Some(Estimate { value, interval: None }));
    }
    let summary = summarise_overlapping(logarithms, independent)?;
    let interval = summary.interval.map(|interval| calib_stats::Interval {
        low: interval.low.exp(),
        high: interval.high.exp(),
    });
    Ok(Some(Estimate { value: summary.mean.exp(), interval }))
}

/// Returns the simple predictor that one would deploy: the best on windows of the log, which also choose the agent. The
/// best on held-out windows is only known afterwards. It is used if no log was replayed.
pub(super) fn preferred<'a>(compared: &[&'a SimpleComparison]) -> Option<&'a SimpleComparison> {
    let mut all = compared.iter().copied();
    match all.clone().filter_map(|own| own.log_error).reduce(f64::min) {
        Some(least) => all.find(|own| own.log_error.is_some_and(|error| error <= ALIKE * least)),
        None => all
            .reduce(|best, other| if other.online_rmse < best.online_rmse { other } else { best }),
    }
}

/// Whether the agent is shown to have two per cent less error than the training mean. With `learning_off` the same must
/// hold for the setting that replaces the choice.
///
/// Intervals over few windows are wide, whatever the agent learned. In that case the ratio itself decides.
fn beats_the_mean(
    mean: &SimpleComparison,
    truth: Option<&Truth>,
    learning_off: Option<usize>,
) -> bool {
    let Some(ratio) = mean.ratio else { return true };
    let truth = truth.filter(|_| mean.log_windows.is_none());
    let windows = mean.log_windows.or(truth.map(|truth| truth.windows.len()));
    let is_chance = windows.is_some_and(|windows| windows >= ENOUGH_WINDOWS)
        && ratio.interval.is_some_and(|interval| interval.high >= 1.0);
    let of_default = truth.and_then(|truth| {
        let is_replaced = learning_off.is_some_and(|off| off != truth.choice.chosen);
        truth.choice.against_default.filter(|_| is_replaced)
    });
    // Both are geometric means over the same windows. Their quotient is the ratio of the default to the training mean.
    let used = of_default.map_or(ratio.value, |against| ratio.value / against.value);
    !is_chance && ratio.value * NO_WORSE <= 1.0 && (used.is_nan() || used * NO_WORSE <= 1.0)
}

/// Returns the distance of held-out values from the training mean, in spreads of the training range. `None` unless it
/// is so large that nothing was learned about such values.
pub(super) fn elsewhere(compared: &[SimpleComparison]) -> Option<f64> {
    let away = mean_of(compared)?.online_error?;
    (away > ELSEWHERE && away.is_finite()).then_some(away)
}

/// Returns the comparison with the training mean.
pub(super) fn mean_of(compared: &[SimpleComparison]) -> Option<&SimpleComparison> {
    compared.iter().find(|own| own.predictor == SimplePredictor::Mean)
}

/// Returns the simple predictor to use instead of the agent, if there is one. This is the [`preferred`] one if the
/// agent is not known to match it, or otherwise one that is better than the agent by more than chance.
///
/// If the training mean does as well as that, or the agent is not shown to beat the mean, the mean is returned, unless
/// something is shown to predict better than it: then the predictors decide that are shown to. One of them is returned
/// under the same conditions, or because the agent itself is not shown to beat the mean.
pub(super) fn decisive<'a>(
    compared: &'a [SimpleComparison],
    truth: Option<&Truth>,
    learning_off: Option<usize>,
) -> Option<&'a SimpleComparison> {
    let all: Vec<&SimpleComparison> = compared.iter().collect();
    let instead = rival(&all);
    let Some(mean) = mean_of(compared) else { return instead };
    let agent_predicts = beats_the_mean(mean, truth, learning_off);
    let shown: Vec<&SimpleComparison> =
        all.iter().copied().filter(|own| own.against_mean.is_some_and(is_shown_lower)).collect();
    let Some(instead) = instead else {
        return if agent_predicts { None } else { preferred(&shown).or(Some(mean)) };
    };
    if !does_as_well(mean, instead) {
        return Some(instead);
    }
    if shown.is_empty() && !mean.is_beaten() {
        return Some(mean);
    }
    match rival(&shown).or_else(|| clearly_better(&all)) {
        None if agent_predicts => None,
        None => preferred(&shown).or(Some(mean)),
        better => better,
    }
}

/// Returns the [`preferred`] one of these predictors if the agent is not known to match it, or otherwise one that is
/// better than the agent by more than chance.
fn rival<'a>(compared: &[&'a SimpleComparison]) -> Option<&'a SimpleComparison> {
    let unmatched = preferred(compared).filter(|own| own.is_better() || !own.is_matched());
    unmatched.or_else(|| clearly_better(compared))
}

/// Returns the predictor that is better than the agent by most, among those that are by more than chance.
fn clearly_better<'a>(compared: &[&'a SimpleComparison]) -> Option<&'a SimpleComparison> {
    let better = compared.iter().copied().filter(|own| own.is_better());
    better.reduce(|best, other| if ratio_or_one(other) > ratio_or_one(best) { other } else { best })
}

/// Whether a ratio of errors is shown to be two per cent below 1: by its value, and with an interval that excludes 1.
fn is_shown_lower(ratio: Estimate) -> bool {
    ratio.value * NO_WORSE <= 1.0 && ratio.interval.is_some_and(|interval| interval.high < 1.0)
}

/// Whether the training mean is as good as another predictor: no more error on average over held-out windows, or at
/// most two per cent more in the geometric mean. A smaller advantage does not count as prediction.
fn does_as_well(mean: &SimpleComparison, other: &SimpleComparison) -> bool {
    // Both ratios have the same agent's error, so their quotient compares the predictors.
    let geometric = match (mean.ratio, other.ratio) {
        (Some(mean), Some(other)) => other.value / mean.value,
        _ => f64::NAN,
    };
    let held_out = mean.online_rmse.zip(other.online_rmse).filter(|_| mean.log_windows.is_none());
    held_out.is_some_and(|(mean, other)| mean <= other) || geometric <= NO_WORSE
}

/// Returns the ratio of the agent's error to the predictor's, or 1 if it is not known.
fn ratio_or_one(comparison: &SimpleComparison) -> f64 {
    comparison.ratio.map_or(1.0, |ratio| ratio.value)
}
