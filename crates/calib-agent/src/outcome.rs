use serde::{Deserialize, Serialize};

use crate::{CurvePoint, CurveRule, curve::Curve, scoring::ScoredReturns};

/// What one agent's run came to. Errors and returns are in normalised units of the sensor.
#[derive(Clone, Debug, PartialEq)]
pub struct RunOutcome {
    /// Root of the mean squared difference of recorded predictions and Monte-Carlo returns over the
    /// scored steps; +∞ for a diverged run.
    pub rmse: f64,
    /// RMSE / |mean return|; +∞ for a diverged run or a mean return of 0.
    pub nrmse: f64,
    /// RMSE / standard deviation of the returns: the measure to trust where the mean return is near 0.
    /// +∞ for a diverged run or constant returns.
    pub rmse_over_std: f64,
    /// Mean of the returns over the scored steps. The same for all agents of one stream and γ.
    pub mean_return: f64,
    /// Standard deviation (divided by n) of the returns over the scored steps.
    pub return_std: f64,
    /// Steps that count for the error.
    pub scored_steps: usize,
    /// Steps of the stream.
    pub steps: usize,
    /// Updates made.
    pub updates: u64,
    /// The step at which a prediction, a TD error or a parameter was no longer finite.
    pub diverged: Option<usize>,
    /// Learning curve; it ends before the window in which a run diverged.
    pub curve: Vec<CurvePoint>,
}

/// Running error of one agent: sums in f64, in the order of the steps.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Tracker {
    sum: f64,
    count: usize,
    curve: Curve,
    pub(crate) updates: u64,
    pub(crate) diverged: Option<usize>,
}

impl Tracker {
    pub(crate) fn new(rule: CurveRule, steps: usize) -> Self {
        Self { sum: 0.0, count: 0, curve: Curve::new(rule, steps), updates: 0, diverged: None }
    }

    /// Record the prediction at step `t`, whose return is known.
    pub(crate) fn record(&mut self, t: usize, prediction: f32, value: f64, scored: bool) {
        let squared_error = (f64::from(prediction) - value).powi(2);
        self.curve.add(t, squared_error);
        if scored {
            self.sum += squared_error;
            self.count += 1;
        }
    }

    pub(crate) fn outcome(self, returns: ScoredReturns, steps: usize) -> RunOutcome {
        let (rmse, curve) = if self.diverged.is_some() {
            (f64::INFINITY, self.curve.abandon())
        } else {
            debug_assert_eq!(self.count, returns.steps);
            let rmse = (self.sum / self.count as f64).sqrt();
            (rmse, self.curve.finish())
        };
        let relative_to = |scale: f64| {
            if scale > 0.0 { rmse / scale } else { f64::INFINITY }
        };
        RunOutcome {
            rmse,
            nrmse: relative_to(returns.mean.abs()),
            rmse_over_std: relative_to(returns.std),
            mean_return: returns.mean,
            return_std: returns.std,
            scored_steps: returns.steps,
            steps,
            updates: self.updates,
            diverged: self.diverged,
            curve,
        }
    }
}
