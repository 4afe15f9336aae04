//! What a channel is, in words.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Label and unit of a channel, for readers.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Description {
    /// The unit of its values: `kPa`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
    /// A description in words: `membrane pressure`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub label: Option<String>,
}

impl Description {
    /// Whether the description is empty.
    pub fn is_empty(&self) -> bool {
        self.unit.is_none() && self.label.is_none()
    }

    /// Returns this description, with missing parts taken from `other`.
    #[must_use]
    pub fn or(self, other: &Self) -> Self {
        Self {
            unit: self.unit.or_else(|| other.unit.clone()),
            label: self.label.or_else(|| other.label.clone()),
        }
    }
}
