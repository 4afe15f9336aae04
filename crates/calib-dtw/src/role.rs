//! Which of the two series is meant.

use std::fmt;

/// The input that an error is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// The first series, N samples, index i.
    Query,
    /// The second series, M samples, index j.
    Reference,
}

impl fmt::Display for Role {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Query => "query",
            Self::Reference => "reference",
        })
    }
}
