//! The lines of text files that are not rows, as users are told of them.

use std::fmt::Display;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

const SHOWN: usize = 5;
/// What is said of a time in another notation.
pub(crate) const NO_TIME: &str = "is no time as the others are";

/// Lines that cannot be read.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct BadRowsFound {
    /// Number of lines.
    pub count: u64,
    /// The first few, each with its file, its line and the error.
    pub examples: Vec<String>,
}

impl BadRowsFound {
    /// Whether there are no such lines.
    pub fn is_none(&self) -> bool {
        self.count == 0
    }

    /// Returns the warning about these lines; `None` if there are none.
    pub fn doubt(&self) -> Option<String> {
        let example = self.examples.first()?;
        let verbs = if self.count == 1 {
            "line cannot be read and is"
        } else {
            "lines cannot be read and are"
        };
        Some(format!("{} {verbs} left out, such as {example}", calib_core::count(self.count)))
    }

    /// Records a line that is not a row.
    pub(crate) fn note(&mut self, why: &impl Display) {
        self.count += 1;
        if self.examples.len() < SHOWN {
            self.examples.push(why.to_string());
        }
    }

    /// Adds lines that were found later.
    pub(crate) fn adopt(&mut self, later: Self) {
        self.count += later.count;
        let room = SHOWN - self.examples.len();
        self.examples.extend(later.examples.into_iter().take(room));
    }

    /// Returns what to do about these lines.
    pub(crate) fn remedy(&self) -> &'static str {
        if self.examples.iter().any(|example| example.contains(NO_TIME)) {
            "Correct or remove such lines, or say how times are written with data.timestamp_format; data.bad_rows = \"skip\" leaves such lines out"
        } else {
            "Restore the file, or correct or remove such lines; data.bad_rows = \"skip\" leaves such lines out"
        }
    }
}
