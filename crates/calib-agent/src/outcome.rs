use serde::{Deserialize, Serialize};

use crate::{CurvePoint, CurveRule, Part, PartScore, Scores, curve::Curve, scoring::ScoredReturns};

/// The result of one agent's run. Errors and returns are in normalised units of the
/// sensor.
#[derive(Clone, Debug, PartialEq)]
pub struct RunOutcome {
    /// The error over each part of the run.
    pub scores: Scores,
    /// Steps of the run.
    pub steps: usize,
    /// Number of updates.
    pub updates: u64,
    /// The step at which a prediction, a TD error or a parameter was no longer finite.
    pub diverged: Option<usize>,
    /// Learning curve. It ends before the window in which the run diverged.
    pub curve: Vec<CurvePoint>,
}

/// Running errors of one agent: sums in f64, in the order of the steps, one for each part.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Tracker {
    steps: usize,
    sums: [f64; Part::ALL.len()],
    counts: [usize; Part::ALL.len()],
    curve: Curve,
    pub(crate) updates: u64,
    pub(crate) diverged: Option<usize>,
}

impl Tracker {
    pub(crate) fn new(rule: CurveRule, steps: usize) -> Self {
        Self {
            steps,
            sums: Default::default(),
            counts: Default::default(),
            curve: Curve::new(rule, steps),
            updates: 0,
            diverged: None,
        }
    }

    /// Records a prediction for a step with a known return.
    pub(crate) fn record(&mut self, t: usize, prediction: f32, value: f64) {
        let squared_error = (f64::from(prediction) - value).powi(2);
        self.curve.add(t, squared_error);
        for (place, part) in Part::ALL.into_iter().enumerate() {
            if t >= part.first_step(self.steps) {
                self.sums[place] += squared_error;
                self.counts[place] += 1;
            }
        }
    }

    /// Returns the outcome. `returns` gives the statistics of the returns in each part.
    pub(crate) fn outcome(self, returns: impl Fn(Part) -> Option<ScoredReturns>) -> RunOutcome {
        let diverged = self.diverged.is_some();
        let scores = Scores::each(|part| {
            let ScoredReturns { steps, mean, std } = returns(part)?;
            let count = self.counts[part as usize];
            debug_assert!(diverged || count == steps);
            let rmse = (self.sums[part as usize] / count as f64).sqrt();
            Some(PartScore {
                scored_steps: steps,
                rmse: if diverged { f64::INFINITY } else { rmse },
                mean_return: mean,
                return_std: std,
            })
        });
        let curve = if diverged { self.curve.abandon() } else { self.curve.finish() };
        RunOutcome {
            scores,
            steps: self.steps,
            updates: self.updates,
            diverged: self.diverged,
            curve,
        }
    }
}
