//! The statistical power of a number of plants.

use calib_stats::{StatsError, observations_needed, sample_std, smallest_difference};
use schemars::JsonSchema;
use serde::Serialize;

use crate::{Comparison, Method};

/// Error differences for which the required number of plants is reported: 1, 2 and 5 %.
pub const DIFFERENCES: [f64; 3] = [0.01, 0.02, 0.05];

/// Power of a comparison: the differences that it can detect with 80 % power at 5 % two-sided. They are in the logarithm of the
/// quotient of errors, with the plant as the unit.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Power {
    /// The method.
    pub method: Method,
    /// The other method.
    pub against: Method,
    /// Number of plants in which both have a choice.
    pub plants: usize,
    /// Standard deviation over plants of the plant's mean ln(quotient); none for one plant.
    pub std: Option<f64>,
    /// The smallest detectable difference with this number of plants, as a share of the error: 0.05 is 5 % more.
    pub visible: Option<f64>,
    /// Number of plants needed to detect each of [`DIFFERENCES`]; none if a million are not enough.
    pub needed: [Option<usize>; 3],
}

impl Power {
    pub(crate) fn of(comparison: &Comparison) -> Result<Self, StatsError> {
        let plants = comparison.of_plants.len();
        let std = sample_std(&comparison.of_plants)?;
        let visible = std.and_then(|std| smallest_difference(std, plants)).map(f64::exp_m1);
        Ok(Self {
            method: comparison.method.clone(),
            against: comparison.against.clone(),
            plants,
            std,
            visible,
            needed: DIFFERENCES
                .map(|difference: f64| observations_needed(std?, difference.ln_1p())),
        })
    }
}
