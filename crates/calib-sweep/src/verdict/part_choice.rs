use calib_agent::{Part, SimplePredictor};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Recommendation, SimpleComparison};

/// The choice and the recommendation by the errors over one part of each run. They are those that `sweep.scored` would
/// give for this part.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PartChoice {
    /// The part of each run.
    pub part: Part,
    /// Index of the setting chosen by these errors.
    pub chosen: usize,
    /// Mean NRMSE of this setting over the part on held-out data; none without held-out data.
    pub online_error: Option<f64>,
    /// Mean NRMSE over the part of the setting that the verdict chose; none without held-out data.
    pub online_error_of_verdict: Option<f64>,
    /// The recommendation if errors over this part count.
    pub recommendation: Recommendation,
    /// The simple predictor to use; none unless the recommendation is to use one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub predictor: Option<SimplePredictor>,
    /// The simple predictor that decides against this setting, or else the one that the log prefers, compared over this part. It is not the
    /// one to use if a setting does as well that starts from another predictor and does not learn. None if simple predictors are not known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub simple: Option<SimpleComparison>,
}
