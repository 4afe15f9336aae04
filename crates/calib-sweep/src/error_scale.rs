use calib_agent::ReturnMoments;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::Candidate;

/// The scale of a sensor's errors: NRMSE = RMSE / standard deviation of its return over the training range.
///
/// The paper divides by the mean return of the run, which is near zero for some sensors. Errors are then infinite, or depend
/// mainly on the runs with the smallest mean. The standard deviation over the training range is known before the deployment. It
/// is the same for *all* runs, so that no run has more weight than another. It is zero only for a constant sensor. An NRMSE of 1
/// is about the error of predicting the mean.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ErrorScale {
    /// The sensor.
    pub sensor: String,
    /// The discount factor of the return.
    pub gamma: f64,
    /// Mean and standard deviation of its return over the training range; none if this is too short for a return.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub returns: Option<ReturnMoments>,
}

impl ErrorScale {
    /// Returns the divisor of errors, in normalised units. It is 1 where the standard deviation is unknown or zero.
    pub fn unit(&self) -> f64 {
        self.returns.map(|returns| returns.std).filter(|&std| std > 0.0).unwrap_or(1.0)
    }

    /// Returns the scale of a setting's errors for `sensor`.
    pub fn find(scales: &[Self], sensor: &str, candidate: &Candidate) -> f64 {
        scales
            .iter()
            .find(|scale| {
                scale.sensor == sensor && scale.gamma == candidate.agent.gamma_for(sensor)
            })
            .map_or(1.0, Self::unit)
    }
}
