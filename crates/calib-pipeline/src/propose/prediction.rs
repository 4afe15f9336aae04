//! The prediction of a sensor in a trial.

use calib_agent::SimplePredictor;
use calib_stats::Interval;
use calib_sweep::{SensorVerdict, SimpleComparison};

/// A sensor counts as predicted if the error is at most this share of the mean's error.
const PREDICTED: f64 = 0.95;

/// The prediction of a sensor on the last third of the training range, from the data before it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct TrialPrediction {
    /// Ratio of the best simple predictor's error to that of the mean.
    pub(super) simple: f64,
    /// Ratio of the agent's error, with the learning rate that the log chooses, to that of the best simple predictor.
    pub(super) agent: f64,
    /// The comparison with the best simple predictor, if the agent is shown to be ahead of all of them.
    pub(super) lead: Option<Lead>,
}

/// How far an agent is ahead of the best simple predictor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Lead {
    /// The best simple predictor.
    pub(super) predictor: SimplePredictor,
    /// Ratio of the agent's error to that of the predictor.
    pub(super) ratio: f64,
    /// Interval of the ratio over windows.
    pub(super) interval: Interval,
}

impl Lead {
    /// Returns the smallest lead of an agent. `None` if the agent is not shown to be ahead of every simple predictor.
    fn smallest(simple: &[SimpleComparison]) -> Option<Self> {
        if !simple.iter().all(SimpleComparison::is_beaten) {
            return None;
        }
        let leads = simple.iter().filter_map(|row| {
            let ratio = row.ratio?;
            Some(Self { predictor: row.predictor, ratio: ratio.value, interval: ratio.interval? })
        });
        leads.max_by(|one, other| one.ratio.total_cmp(&other.ratio))
    }
}

impl TrialPrediction {
    pub(super) fn of(verdict: &SensorVerdict) -> Self {
        // All ratios of an agent are over the same windows, so their quotients compare predictors with each other.
        let ratios = SimplePredictor::ALL.map(|predictor| ratio_to(predictor, &verdict.simple));
        let agent = ratios.into_iter().fold(f64::NAN, f64::max);
        let lead = Lead::smallest(&verdict.simple);
        let simple = ratio_to(SimplePredictor::Mean, &verdict.simple) / agent;
        Self { simple, agent, lead }
    }

    /// Whether something predicts the sensor better than its mean.
    pub(super) fn is_predicted(&self) -> bool {
        self.simple * self.agent.min(1.0) <= PREDICTED
    }
}

/// Returns the ratio of the agent's error to that of a predictor; NaN if it is not known.
fn ratio_to(predictor: SimplePredictor, simple: &[SimpleComparison]) -> f64 {
    let row = simple.iter().find(|row| row.predictor == predictor);
    row.and_then(|row| row.ratio).map_or(f64::NAN, |ratio| ratio.value)
}

#[cfg(test)]
mod tests {
    use calib_stats::Estimate;

    use super::*;

    /// Returns the comparison of an agent with a predictor, with the ratio of their errors and its interval.
    fn compared(predictor: SimplePredictor, [low, value, high]: [f64; 3]) -> SimpleComparison {
        SimpleComparison {
            predictor,
            online_error: Some(1.0),
            online_rmse: Some(1.0),
            log_error: None,
            ratio: Some(Estimate { value, interval: Some(Interval { low, high }) }),
            runaway_windows: 0,
            against_mean: None,
            log_windows: None,
        }
    }

    #[test]
    fn an_agent_leads_only_if_it_beats_every_simple_predictor() {
        let mean = compared(SimplePredictor::Mean, [0.4, 0.5, 0.6]);
        let line = compared(SimplePredictor::Line, [0.9, 0.93, 0.97]);
        let ridge = compared(SimplePredictor::Ridge, [0.8, 0.9, 1.1]);
        let lead = Lead::smallest(&[mean.clone(), line.clone()]).expect("both are beaten");
        assert_eq!(
            (lead.predictor, lead.ratio, lead.interval.high),
            (SimplePredictor::Line, 0.93, 0.97)
        );
        assert_eq!(Lead::smallest(&[mean, line, ridge]), None, "ridge regression may be as good");
        assert_eq!(Lead::smallest(&[]), None, "nothing was compared");
    }
}
