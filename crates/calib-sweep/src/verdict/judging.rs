//! How results are judged.

use calib_agent::{Part, SimplePredictor};
use calib_core::Seed;

use super::Rule;
use crate::{ErrorScale, SimpleScore};

/// How results are judged.
#[derive(Clone, Copy, Debug)]
pub struct Judging<'a> {
    /// The part of a run whose error counts.
    pub part: Part,
    /// The rule that chooses a setting.
    pub rule: Rule,
    /// The choice counts as a hit if it is among this many best settings.
    pub top_k: usize,
    /// The scale of errors for each sensor.
    pub scales: &'a [ErrorScale],
    /// Errors of simple predictors. Empty where they are not known.
    pub simple: &'a [SimpleScore],
    /// The simple predictor that `agent.baseline = "best"` stands for, if any agent of this sensor starts from it.
    pub best: Option<SimplePredictor>,
    /// Whether the sensor is constant in every held-out window, so that there was nothing to predict.
    pub stands_still: bool,
    /// Number of resamples for intervals; 0 gives no intervals.
    pub resamples: usize,
    /// Root of the resamples' seeds.
    pub seed: Seed,
}

impl<'a> Judging<'a> {
    /// Creates the judging for the choice alone, without simple predictors and without resamples.
    pub fn of_choice(part: Part, rule: Rule, scales: &'a [ErrorScale]) -> Self {
        Self {
            part,
            rule,
            top_k: 1,
            scales,
            simple: &[],
            best: None,
            stands_still: false,
            resamples: 0,
            seed: Seed::new(0),
        }
    }
}

/// With fewer held-out windows, hardly any difference can be shown. Our choice.
pub const ENOUGH_WINDOWS: usize = 4;
