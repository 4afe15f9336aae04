use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How often a setting is chosen in resamples of the evidence. It shows how stable the choice is on this log. Ensemble members share most
/// of the log, so another log of the same plant would agree less often.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Share {
    /// Index of the setting.
    pub candidate: usize,
    /// Share of the resamples in which the rule chooses the setting.
    pub share: f64,
}
