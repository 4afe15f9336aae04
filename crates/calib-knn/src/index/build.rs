use calib_core::Monitor;
use calib_files::ScratchPlace;

use super::{Join, KdTree, NeighborIndex, Queries, Scan, Sources};
use crate::{IndexChoice, IndexKind, KnnError, choice::Reason};

/// Up to this many columns the k-d tree is faster than the join; see [`Sources::index`].
const FEW_COLUMNS: usize = 2;
/// Limit on the extra states that the k-d tree returns per query, beyond those that it is first asked for. Above it, the join is
/// faster. Where a member lacks a block, the tree returns a little over five times the neighbours.
const MOST_GIVEN: usize = 128;
/// Below this many queries, building an index does not pay.
const FEW_QUERIES: usize = 256;

/// A search structure that is ready for some queries.
#[expect(missing_debug_implementations, reason = "a trait object of any structure")]
pub struct Planned<'a> {
    /// The structure.
    pub index: Box<dyn NeighborIndex + 'a>,
    /// The queries, in the order in which the structure searches them.
    pub order: Vec<u32>,
    /// Which structure it is, and why.
    pub choice: IndexChoice,
}

impl<'a> Planned<'a> {
    fn new(
        index: impl NeighborIndex + 'a,
        queries: &Queries<'_>,
        kind: IndexKind,
        reason: Reason,
    ) -> Self {
        let order = index.order(queries);
        Self { index: Box::new(index), order, choice: IndexChoice { kind, reason } }
    }

    fn scan(scan: Scan<'a>, queries: &Queries<'_>, reason: Reason) -> Self {
        Self::new(scan, queries, IndexKind::Scan, reason)
    }

    fn tree(tree: KdTree<'a>, queries: &Queries<'_>, reason: Reason) -> Self {
        Self::new(tree, queries, IndexKind::KdTree, reason)
    }
}

impl<'a> Sources<'a> {
    /// Returns a search structure of this kind over these sources, with its large arrays in `place`.
    ///
    /// [`IndexKind::Auto`] takes the scan for few queries. Otherwise it takes the k-d tree up to 2 columns, unless its arrays should be
    /// in files, or it would return too many states that a query must not find. Otherwise it takes the join, unless a sample of the
    /// queries shows that the join is more work than the scan. Processor seconds for the tables of 100 000 rows (`k` = 3, five members;
    /// `cargo bench -p calib-knn --bench choice` measures them):
    ///
    /// | columns | uniform: tree, join | simulated plant: tree, join |
    /// |---|---|---|
    /// | 1 | 0.19, 0.23 | 0.09, 0.16 |
    /// | 2 | 0.26, 0.26 | 0.21, 0.22 |
    /// | 3 | 0.36, 0.30 | 0.24, 0.22 |
    /// | 4 | 0.47, 0.35 | 0.20, 0.19 |
    /// | 6 | 1.03, 0.45 | 0.17, 0.17 |
    /// | 8 | 2.58, 0.69 | 0.20, 0.18 |
    ///
    /// With a Theiler window of 3600 rows, 20 000 rows of two columns of the plant take 1.01 with the tree and 0.14 with the join.
    ///
    /// The k-d tree has no lists for classes. Sources in classes get the join instead.
    ///
    /// Progress counts passes over the sources.
    ///
    /// # Errors
    /// If the k-d tree is asked for more columns than it supports, there is no place for the arrays, or the monitor interrupts.
    pub fn index(
        &self,
        kind: IndexKind,
        queries: &Queries<'_>,
        k: usize,
        place: &ScratchPlace,
        monitor: &dyn Monitor,
    ) -> Result<Planned<'a>, KnnError> {
        let budget = self.leaf_budget;
        let by_class = self.classes.are_given();
        // Only the join has a leaf budget. A budget therefore fixes the structure, so that the tables do not depend on the choice.
        let kind = if budget > 0 { IndexKind::Join } else { kind };
        match kind {
            IndexKind::KdTree if !by_class => {
                Ok(Planned::tree(KdTree::new(*self, monitor)?, queries, Reason::Asked))
            }
            IndexKind::Scan | IndexKind::Auto if queries.len() < FEW_QUERIES => {
                let asked = kind == IndexKind::Scan;
                let reason = if asked { Reason::Asked } else { Reason::FewQueries };
                Ok(Planned::scan(Scan::new(*self), queries, reason))
            }
            IndexKind::Scan => {
                Ok(Planned::scan(Scan::grouped(*self, monitor)?, queries, Reason::Asked))
            }
            IndexKind::KdTree | IndexKind::Join | IndexKind::Auto => {
                // The tree's arrays cannot be in files.
                let few =
                    !by_class && self.columns() <= FEW_COLUMNS && *place == ScratchPlace::Memory;
                if kind == IndexKind::Auto && few {
                    let built = KdTree::new(*self, monitor)?;
                    let most = MOST_GIVEN + 6 * k;
                    if built.given(queries, k, 4 * most) <= most as f64 {
                        let reason = Reason::FewColumns { columns: self.columns() };
                        return Ok(Planned::tree(built, queries, reason));
                    }
                }
                let Some(join) = Join::new(*self, place, monitor)? else {
                    let scan = Scan::grouped(*self, monitor)?;
                    return Ok(Planned::scan(scan, queries, Reason::Large));
                };
                let order = join.order(queries);
                let mut reason = Reason::Asked;
                if kind == IndexKind::Auto {
                    let share = join.share_of_scan(queries, &order, k, monitor);
                    reason = Reason::Work { share };
                    if share > 1.0 {
                        let groups = join.into_groups().in_time();
                        return Ok(Planned::scan(Scan::of(*self, groups), queries, reason));
                    }
                }
                let choice = IndexChoice { kind: IndexKind::Join, reason };
                Ok(Planned { index: Box::new(join), order, choice })
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use calib_core::{Seed, Segments, Silent, States, Transitions};

    use super::*;
    use crate::{Blocks, Exclusion, index::NeighborLists};

    /// Returns the structure that is chosen for the next states, and what it finds. Checks the result against a scan of every
    /// transition.
    fn chosen(
        states: &States,
        exclusion: Exclusion,
        place: &ScratchPlace,
    ) -> (IndexKind, NeighborLists) {
        let rows = states.rows();
        let transitions = Transitions::new(Segments::from_lengths([rows]).expect("valid"));
        let blocks = Blocks::new(&transitions, 3).expect("valid");
        let sources = Sources::new(states, &transitions, &blocks).expect("valid");
        let queries = Queries::next_states(&sources, exclusion);
        let planned =
            sources.index(IndexKind::Auto, &queries, 3, place, &Silent).expect("not interrupted");
        let mut found = NeighborLists::new(queries.len(), 3, 3);
        let order: Vec<u32> = (0..queries.len() as u32).collect();
        planned.index.search(&queries, &order, &mut found, &Silent).expect("not interrupted");
        let scan = Scan::new(sources);
        let mut expected = NeighborLists::new(queries.len(), 3, 3);
        scan.search(&queries, &order, &mut expected, &Silent).expect("not interrupted");
        assert_eq!(found, expected);
        (planned.choice.kind, found)
    }

    fn window(theiler: u32) -> Exclusion {
        Exclusion { theiler, ..Exclusion::default() }
    }

    #[test]
    fn a_tree_is_not_chosen_where_the_nearest_states_are_forbidden() {
        // In a slow random walk, the nearest states are those just before and after.
        let mut rng = Seed::new(1).rng();
        let mut value = 0.0;
        let rows = 4000;
        let walk = (0..rows).map(|_| {
            value += rng.normal();
            value as f32
        });
        let states = States::new(walk.collect(), rows, 1).expect("finite");
        let memory = ScratchPlace::Memory;
        assert_eq!(chosen(&states, window(0), &memory).0, IndexKind::KdTree);
        assert_ne!(chosen(&states, window(600), &memory).0, IndexKind::KdTree);
        let directory = tempfile::tempdir().expect("a directory");
        let disk = ScratchPlace::Disk(directory.path().to_owned());
        assert_ne!(chosen(&states, window(0), &disk).0, IndexKind::KdTree);
    }

    #[test]
    fn a_scan_gets_the_different_states() {
        // Half of the rows are one standstill. No other source can be ruled out.
        let rows = 2000;
        let columns = 64;
        let mut rng = Seed::new(2).rng();
        let mut values: Vec<f32> = (0..rows * columns).map(|_| rng.normal() as f32).collect();
        values[..rows / 2 * columns].fill(0.5);
        let states = States::new(values, rows, columns).expect("finite");
        let (kind, found) = chosen(&states, Exclusion::default(), &ScratchPlace::Memory);
        assert_eq!(kind, IndexKind::Scan);
        assert_eq!(found.list(5, 2).0, [0, 1, 2]);
        let transitions = Transitions::new(Segments::from_lengths([rows]).expect("valid"));
        let blocks = Blocks::new(&transitions, 3).expect("valid");
        let sources = Sources::new(&states, &transitions, &blocks).expect("valid");
        let join = Join::new(sources, &ScratchPlace::Memory, &Silent).expect("not interrupted");
        let groups = join.expect("small values").into_groups().in_time();
        assert_eq!((groups.len(), groups.transitions(0).len()), (rows / 2, rows / 2));
    }
}
