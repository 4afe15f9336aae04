use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::ActionModelKind;

/// Results of the ensemble members of one kind.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct KindReturns {
    /// The kind of model.
    pub kind: ActionModelKind,
    /// Index of the setting that these ensemble members alone would choose, by the same rule.
    pub chosen: usize,
    /// Mean return of each setting over the runs of each ensemble member, `[members][candidates]` (`"-inf"` in files where it diverged).
    #[serde(with = "calib_stats::diverged::rows")]
    #[schemars(with = "Vec<Vec<calib_stats::diverged::Stored>>")]
    pub members: Vec<Vec<f64>>,
}

impl KindReturns {
    /// Returns the mean return of a setting in each ensemble member, `[members]`.
    pub(super) fn of_setting(&self, candidate: usize) -> Vec<f64> {
        self.members.iter().map(|returns| returns[candidate]).collect()
    }
}
