use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::prototypes::CHOOSING;

/// Options that make a search faster and its tables approximate. [`recall`](crate::recall) measures the loss.
///
/// The paper names prototypes and reduced states for data that is too large for exact search, and does not say which.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shortcuts {
    /// About one source in this many can be a neighbour; 1 for all.
    pub prototypes: u32,
    /// How the prototypes are chosen.
    pub prototype_kind: PrototypeKind,
    /// Number of leading principal components in which neighbours are searched; 0 for all columns. The distances in the
    /// tables are still those of the states.
    pub components: usize,
    /// Maximum number of leaves that the join visits for a band of queries besides their own, nearest first; 0 for no
    /// limit. Only the join supports it.
    pub leaf_budget: usize,
}

/// The sources that are prototypes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PrototypeKind {
    /// Every m-th transition in time order, from the first: in densely sampled logs the others are nearly copies of them
    /// (our choice).
    #[default]
    Every,
    /// The sources that cover the states best. In each cluster of near states, the source farthest from all chosen ones
    /// is chosen, repeatedly (k-centre, Gonzalez 1985; the clusters are our choice).
    KCentre,
}

impl Default for Shortcuts {
    fn default() -> Self {
        Self { prototypes: 1, prototype_kind: PrototypeKind::Every, components: 0, leaf_budget: 0 }
    }
}

impl Shortcuts {
    /// Whether the search is exact: no option is in use.
    pub fn is_exact(self) -> bool {
        self.prototypes == 1 && self.components == 0 && self.leaf_budget == 0
    }

    /// Returns the memory per row of the states, in bytes: for the components that are searched, and while prototypes are
    /// chosen.
    pub(crate) fn bytes_a_row(self, columns: usize) -> (u64, u64) {
        let reduced = if self.components < columns { 4 * self.components as u64 } else { 0 };
        let covers = self.prototypes > 1 && self.prototype_kind == PrototypeKind::KCentre;
        (reduced, if covers { CHOOSING } else { 0 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_leaves_something_out_is_not_exact() {
        let exact = Shortcuts::default();
        assert!(exact.is_exact());
        assert!(Shortcuts { prototype_kind: PrototypeKind::KCentre, ..exact }.is_exact());
        assert!(!Shortcuts { prototypes: 2, ..exact }.is_exact());
        assert!(!Shortcuts { components: 5, ..exact }.is_exact());
        assert!(!Shortcuts { leaf_budget: 1, ..exact }.is_exact());
    }
}
