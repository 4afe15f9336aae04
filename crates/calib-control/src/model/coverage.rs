use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Covered;

/// Coverage of the steps of a rollout by recorded transitions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Coverage {
    /// Number of steps.
    pub steps: u64,
    /// Steps with an action that occurs in no transition of the ensemble member.
    pub missing: u64,
    /// Steps whose nearest transition with the action is beyond the radius.
    pub far: u64,
}

impl Coverage {
    /// Returns the share of the steps that the log does not cover; 0
    /// without steps.
    pub fn uncovered(&self) -> f64 {
        (self.missing + self.far) as f64 / self.steps.max(1) as f64
    }

    /// Returns the sum of both.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self {
            steps: self.steps + other.steps,
            missing: self.missing + other.missing,
            far: self.far + other.far,
        }
    }

    /// Counts a step.
    pub(crate) fn count(&mut self, covered: Covered) {
        self.steps += 1;
        self.missing += u64::from(covered == Covered::Missing);
        self.far += u64::from(covered == Covered::Far);
    }
}
