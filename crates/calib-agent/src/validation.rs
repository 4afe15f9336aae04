use std::ops::Range;

use calib_core::Stream;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{Learner, scoring::known_returns};

/// One epoch of one agent. Losses are means of squared TD errors, δ² with δ = o' + γ v(s') − v(s), in squared
/// normalised units.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Epoch {
    /// Number of the epoch, from 1.
    pub epoch: usize,
    /// Mean loss over the training transitions, each taken before the update that learns from it.
    pub training_loss: f64,
    /// Mean loss over the validation transitions, after the epoch.
    pub validation_loss: f64,
    /// RMSE between values and Monte-Carlo returns over the validation steps whose returns are known.
    pub validation_rmse: Option<f64>,
    /// The validation RMSE divided by |mean return|.
    pub validation_nrmse: Option<f64>,
}

impl Epoch {
    /// Returns the early-stopping criterion: the error to returns, or the loss where no return is known.
    pub(crate) fn error(&self) -> f64 {
        self.validation_rmse.unwrap_or(self.validation_loss)
    }
}

/// The validation transitions of one sensor. The target returns are summed again in each epoch: this costs nothing
/// beside the predictions, and years of returns need no memory.
pub(crate) struct Validation<'a> {
    baseline: Option<&'a [f32]>,
    cumulant: usize,
    gamma: f64,
    /// States from the first transition to the end of the last one, piece by piece.
    stretches: Vec<Range<usize>>,
    /// Steps of each stretch with known returns.
    known: Vec<Range<usize>>,
}

impl<'a> Validation<'a> {
    /// Returns the validation data of `transitions` of `stream`, identified by the steps they start from, in order.
    pub(crate) fn new(stream: &dyn Stream, learner: &Learner<'a>, transitions: &[usize]) -> Self {
        let Learner { config, cumulant, baseline, .. } = *learner;
        let gamma = config.gamma;
        let first = transitions.first().copied().unwrap_or(usize::MAX);
        let pieces = stream.pieces().iter().filter(|piece| piece.end > first.saturating_add(1));
        let (stretches, known) = pieces
            .map(|piece| {
                let known = known_returns(piece, gamma);
                let stretch = piece.start.max(first).min(piece.end)..piece.end;
                (stretch, known.start.max(first).min(known.end)..known.end)
            })
            .unzip();
        Self { baseline, cumulant, gamma, stretches, known }
    }

    /// Returns the epoch of a learner. `predict` appends its values at some steps.
    pub(crate) fn epoch(
        &self,
        epoch: usize,
        training_loss: f64,
        stream: &dyn Stream,
        mut predict: impl FnMut(Range<usize>, &mut Vec<f32>),
    ) -> Epoch {
        let mut loss = 0.0;
        let mut transitions = 0_usize;
        let mut squares = 0.0;
        let mut sum = 0.0;
        let mut steps = 0_usize;
        let mut values = Vec::new();
        for (stretch, known) in self.stretches.iter().zip(&self.known) {
            values.clear();
            predict(stretch.clone(), &mut values);
            if let Some(baseline) = self.baseline {
                for (value, known) in values.iter_mut().zip(&baseline[stretch.clone()]) {
                    *value += known;
                }
            }
            // From the end of the piece, so that G_t = o_{t+1} + γ G_{t+1} follows from the step before.
            let mut following = 0.0;
            for (t, pair) in stretch.clone().zip(values.windows(2)).rev() {
                let observed = f64::from(stream.state(t + 1)[self.cumulant]);
                let error = observed + self.gamma * f64::from(pair[1]) - f64::from(pair[0]);
                loss += error * error;
                transitions += 1;
                following = observed + self.gamma * following;
                if known.contains(&t) {
                    squares += (f64::from(pair[0]) - following).powi(2);
                    sum += following;
                    steps += 1;
                }
            }
        }
        let rmse = (steps > 0).then(|| (squares / steps as f64).sqrt());
        let mean = (sum / steps.max(1) as f64).abs();
        Epoch {
            epoch,
            training_loss,
            validation_loss: loss / transitions.max(1) as f64,
            validation_rmse: rmse,
            validation_nrmse: rmse.filter(|_| mean > 0.0).map(|rmse| rmse / mean),
        }
    }
}
