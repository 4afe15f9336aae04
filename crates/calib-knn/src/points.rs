//! The exact search over points that are not a log: without time, members or exclusions.

use calib_core::{Monitor, RowIndex, Segments, States, Transitions};
use calib_files::ScratchPlace;

use crate::{
    Blocks, Exclusion, IndexKind, KnnError, MemoryNeed, ModelConfig, SelfMatch,
    index::{NeighborLists, Queries, Sources, filled},
    parts::PART_QUERIES,
};

/// Points to search, `f32 [n, d]`.
#[derive(Clone, Debug)]
pub struct Points {
    /// The points, followed by a copy of the last. No search finds the copy: it is there because every source needs a following
    /// row.
    states: States,
    transitions: Transitions,
    blocks: Blocks,
}

/// The nearest points of some queries: `[queries, k]` row by row, nearest first, ties by position.
#[derive(Clone, Debug, PartialEq)]
pub struct PointNeighbors {
    /// Positions of the neighbours.
    pub neighbors: Vec<u32>,
    /// Euclidean distances to the neighbours.
    pub distances: Vec<f32>,
    /// Number of neighbours per query.
    pub k: usize,
}

impl Points {
    /// Creates points from their values, row by row.
    ///
    /// # Errors
    /// If there is no point, the values are not a multiple of `columns`, or one of them is not finite.
    pub fn new(mut values: Vec<f32>, columns: usize) -> Result<Self, KnnError> {
        let count = values.len().checked_div(columns).unwrap_or(0);
        if count == 0 || count >= u32::MAX as usize {
            return Err(KnnError::Points { count });
        }
        values.extend_from_within((count - 1) * columns..count * columns);
        let states = States::new(values, count + 1, columns)?;
        let segments = Segments::from_lengths([count + 1])
            .unwrap_or_else(|_| unreachable!("one segment of two rows or more"));
        let transitions = Transitions::new(segments);
        let blocks = Blocks::undivided(&transitions);
        Ok(Self { states, transitions, blocks })
    }

    /// Returns the number of points.
    pub fn len(&self) -> usize {
        self.transitions.len()
    }

    /// Whether there are no points. Never true.
    pub fn is_empty(&self) -> bool {
        self.transitions.is_empty()
    }

    /// Returns the number of values per point.
    pub fn columns(&self) -> usize {
        self.states.columns()
    }

    /// Returns the maximum memory of a search of `queries` queries with `threads` threads, in bytes, including the results.
    pub fn search_need(&self, queries: usize, k: usize, threads: usize) -> u64 {
        let config = ModelConfig { members: 1, neighbors: k, ..ModelConfig::default() };
        let rows = self.len().max(queries);
        let need = MemoryNeed::predict(rows, self.columns(), &config, threads);
        let returned = 8_u64.saturating_mul(queries as u64).saturating_mul(k as u64);
        need.working.saturating_add(returned)
    }

    /// Returns the `k` nearest points of every point, by exact search.
    ///
    /// The results do not depend on `kind` or on the number of threads. Progress counts passes over the points, then queries.
    ///
    /// # Errors
    /// If there are not `k` points to find, the k-d tree is asked for more columns than it supports, or the monitor interrupts.
    pub fn join(
        &self,
        k: usize,
        self_match: SelfMatch,
        kind: IndexKind,
        monitor: &dyn Monitor,
    ) -> Result<PointNeighbors, KnnError> {
        let rows: Vec<RowIndex> = (0..self.len()).map(RowIndex::new).collect();
        let sources = self.sources();
        let exclusion = Exclusion { self_match, theiler: 0 };
        let queries = Queries::rows(&sources, &rows, 0, exclusion);
        let most = self.len() - usize::from(self_match == SelfMatch::Excluded);
        self.search(&sources, &queries, (k, most), kind, monitor)
    }

    /// Returns the `k` nearest points of each of `states`, by exact search.
    ///
    /// # Errors
    /// As [`Points::join`]; also if the states have another number of columns.
    pub fn nearest(
        &self,
        states: &States,
        k: usize,
        kind: IndexKind,
        monitor: &dyn Monitor,
    ) -> Result<PointNeighbors, KnnError> {
        let sources = self.sources();
        let queries = Queries::external(&sources, states, Some(0))?;
        self.search(&sources, &queries, (k, self.len()), kind, monitor)
    }

    fn sources(&self) -> Sources<'_> {
        Sources::new(&self.states, &self.transitions, &self.blocks)
            .unwrap_or_else(|_| unreachable!("made from the same points"))
    }

    fn search(
        &self,
        sources: &Sources<'_>,
        queries: &Queries<'_>,
        (k, most): (usize, usize),
        kind: IndexKind,
        monitor: &dyn Monitor,
    ) -> Result<PointNeighbors, KnnError> {
        if k == 0 {
            return Err(KnnError::NoNeighbors);
        }
        if k > most {
            return Err(KnnError::TooFewPoints { k, most });
        }
        if !kind.supports(self.columns()) {
            return Err(KnnError::Dimensions {
                columns: self.columns(),
                max: crate::KdTree::MAX_COLUMNS,
            });
        }
        let cells = queries.len().saturating_mul(k);
        let mut neighbors = filled(cells, u32::MAX)?;
        let mut distances = filled(cells, f32::INFINITY)?;
        let planned = sources.index(kind, queries, k, &ScratchPlace::Memory, monitor)?;
        monitor.begin("nearest points", queries.len() as u64);
        for order in planned.order.chunks(PART_QUERIES) {
            let mut found = NeighborLists::with_room(order.len(), 1, k)?;
            planned.index.search(queries, order, &mut found, monitor)?;
            for (place, &query) in order.iter().enumerate() {
                let (near, far) = found.list(place, 0);
                let start = query as usize * k;
                neighbors[start..start + k].copy_from_slice(near);
                distances[start..start + k].copy_from_slice(far);
            }
        }
        Ok(PointNeighbors { neighbors, distances, k })
    }
}

#[cfg(test)]
mod tests {
    use calib_core::Silent;
    use proptest::prelude::*;

    use super::*;

    /// Returns positions in the order of the squared distance in `f64`, ties by position.
    fn brute(points: &[[f32; 3]], query: [f32; 3], skip: Option<usize>, k: usize) -> Vec<u32> {
        let others = points.iter().enumerate().filter(|(at, _)| Some(*at) != skip);
        let mut all: Vec<(f64, usize)> = others
            .map(|(at, point): (usize, &[f32; 3])| {
                let pairs = point.iter().zip(query);
                (pairs.map(|(a, b)| (f64::from(*a) - f64::from(b)).powi(2)).sum(), at)
            })
            .collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        all[..k].iter().map(|(_, at)| *at as u32).collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]
        #[test]
        fn points_are_found_as_by_brute_force(
            cells in prop::collection::vec(0_u8..6, 3 * 8..3 * 300),
            k in 1_usize..7,
            excluded in any::<bool>(),
        ) {
            let points: Vec<[f32; 3]> =
                cells.chunks_exact(3).map(|point| [point[0], point[1], point[2]].map(f32::from)).collect();
            let searched = Points::new(points.concat(), 3).expect("valid");
            let self_match = if excluded { SelfMatch::Excluded } else { SelfMatch::Allowed };
            for kind in [IndexKind::Auto, IndexKind::Join, IndexKind::Scan, IndexKind::KdTree] {
                let joined = searched.join(k, self_match, kind, &Silent).expect("found");
                for (at, point) in points.iter().enumerate() {
                    let got = &joined.neighbors[at * k..(at + 1) * k];
                    prop_assert_eq!(got, brute(&points, *point, excluded.then_some(at), k));
                }
            }
            let elsewhere = States::new(vec![2.5, 0.0, 9.0], 1, 3).expect("valid");
            let near = searched.nearest(&elsewhere, k, IndexKind::Auto, &Silent).expect("found");
            prop_assert_eq!(near.neighbors, brute(&points, [2.5, 0.0, 9.0], None, k));
        }
    }

    /// Joins the points 0, 1 and 3.
    fn join_three(k: usize, self_match: SelfMatch) -> Result<PointNeighbors, KnnError> {
        let points = Points::new(vec![0.0, 1.0, 3.0], 1).expect("three points");
        points.join(k, self_match, IndexKind::Auto, &Silent)
    }

    #[test]
    fn what_cannot_be_found_is_told() {
        assert_eq!(join_three(1, SelfMatch::Excluded).expect("found").distances, [1.0, 1.0, 2.0]);
        assert!(matches!(
            join_three(3, SelfMatch::Excluded),
            Err(KnnError::TooFewPoints { most: 2, .. })
        ));
        assert!(matches!(join_three(0, SelfMatch::Allowed), Err(KnnError::NoNeighbors)));
        assert!(matches!(Points::new(vec![], 3), Err(KnnError::Points { count: 0 })));
        assert!(matches!(Points::new(vec![f32::NAN], 1), Err(KnnError::States(_))));
    }
}
