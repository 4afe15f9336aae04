use std::fmt;

use crate::{IndexKind, KdTree};

/// The search structure that was used, and the reason.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IndexChoice {
    /// The structure; never [`IndexKind::Auto`].
    pub kind: IndexKind,
    /// The reason for the choice.
    pub reason: Reason,
}

/// The reason why a search structure was used.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reason {
    /// The configuration asked for it.
    Asked,
    /// There are so few queries that building a structure does not pay.
    FewQueries,
    /// There are so few columns that a k-d tree is fastest.
    FewColumns {
        /// Columns of the states.
        columns: usize,
    },
    /// The estimated work of a join as a share of that of a scan, from a sample of the queries.
    Work {
        /// The share.
        share: f64,
    },
    /// The values are too large for the images that a join needs.
    Large,
}

impl IndexChoice {
    /// Returns the structure and the reason without the measured share of work. The last digits of the share may depend on
    /// the processor, and manifests must not.
    pub fn without_share(&self) -> String {
        match (self.kind, self.reason) {
            (IndexKind::Join, Reason::Work { .. }) => {
                "join (less work than a scan, by a sample)".to_owned()
            }
            (kind, Reason::Work { .. }) => {
                format!("{} (a join is more work, by a sample)", kind.name())
            }
            _ => self.to_string(),
        }
    }
}

impl fmt::Display for IndexChoice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = self.kind.name();
        match self.reason {
            Reason::Asked => write!(f, "{name} (asked for)"),
            Reason::FewQueries => write!(f, "{name} (few queries)"),
            Reason::FewColumns { columns } => write!(f, "{name} ({columns} columns)"),
            Reason::Work { share } => {
                write!(f, "{name} (a join takes {share:.2e} of the work of a scan, by a sample)")
            }
            Reason::Large => write!(f, "{name} (values are too large for a join)"),
        }
    }
}

impl IndexKind {
    /// Returns the name that studies and the command line use.
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::KdTree => "kd_tree",
            Self::Join => "join",
            Self::Scan => "scan",
        }
    }

    /// Whether the structure can search states of `columns` columns.
    pub fn supports(self, columns: usize) -> bool {
        self != Self::KdTree || columns <= KdTree::MAX_COLUMNS
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn told(kind: IndexKind, reason: Reason) -> String {
        IndexChoice { kind, reason }.to_string()
    }

    fn without(kind: IndexKind, reason: Reason) -> String {
        IndexChoice { kind, reason }.without_share()
    }

    #[test]
    fn reasons_are_told() {
        assert_eq!(told(IndexKind::Scan, Reason::Asked), "scan (asked for)");
        let share = Reason::Work { share: 0.0123 };
        assert_eq!(
            told(IndexKind::Join, share),
            "join (a join takes 1.23e-2 of the work of a scan, by a sample)"
        );
        assert_eq!(without(IndexKind::Join, share), "join (less work than a scan, by a sample)");
        assert_eq!(without(IndexKind::Scan, share), "scan (a join is more work, by a sample)");
        assert_eq!(without(IndexKind::Join, Reason::Asked), "join (asked for)");
        assert!(IndexKind::Join.supports(500) && !IndexKind::KdTree.supports(9));
    }
}
