use std::marker::PhantomData;

use calib_core::Monitor;
use pulp::Arch;
use rayon::prelude::*;

mod block;
mod class_masks;
mod embedding;
mod far;
mod kernel;
mod spread;
mod structure;
mod tree;

use super::{NeighborIndex, NeighborLists, Queries};
use crate::{KnnError, Lists, MemberLists, class_lists::ClassLists, groups::Groups};
use block::{Band, Limit, QUERIES};
pub(crate) use embedding::width as image_width;
pub(crate) use spread::leaves;
pub use structure::Join;
use tree::LEAF;

/// Leaves of a band. Its queries share what is read of other leaves.
const BAND: usize = 4;
/// Number of bands from which the work is estimated.
const SAMPLE: usize = 12;

impl Join<'_> {
    /// Returns the distinct states, for use in a scan that is less work.
    pub(super) fn into_groups(self) -> Groups {
        self.groups
    }

    /// Returns the leaf near the query.
    fn leaf(&self, queries: &Queries<'_>, query: usize) -> usize {
        self.tree.leaf_of(self.place(queries, query) as usize).0
    }

    /// Splits `order` into bands of blocks. A block is a run of at most [`QUERIES`] queries of one leaf, with the leaf.
    fn bands<'o>(&self, queries: &Queries<'_>, order: &'o [u32]) -> Vec<Vec<(usize, &'o [u32])>> {
        let leaves: Vec<usize> =
            order.par_iter().map(|&query| self.leaf(queries, query as usize)).collect();
        let mut bands = Vec::new();
        let mut rest = order;
        for band in leaves.chunk_by(|a, b| a / BAND == b / BAND) {
            let mut blocks = Vec::new();
            for run in band.chunk_by(|a, b| a == b) {
                let (own, after) = rest.split_at(run.len());
                blocks.extend(own.chunks(QUERIES).map(|part| (run[0], part)));
                rest = after;
            }
            // One leaf may have very many queries, for example external ones. Then they form several bands.
            bands.extend(blocks.chunks(2 * BAND * LEAF / QUERIES).map(<[_]>::to_vec));
        }
        bands
    }

    fn limit(&self, queries: &Queries<'_>) -> Limit {
        // A repeated search must not depend on which queries share its band, so it has no leaf budget.
        let leaves = match self.sources.leaf_budget {
            0 => usize::MAX,
            _ if queries.are_asked_again() => usize::MAX,
            budget => budget,
        };
        Limit { work: u64::MAX, leaves }
    }

    /// Estimates the work of the join as a share of the work of a scan, from a sample of the queries. The estimate stops at
    /// twice the work of the scan.
    pub(super) fn share_of_scan(
        &self,
        queries: &Queries<'_>,
        order: &[u32],
        k: usize,
        monitor: &dyn Monitor,
    ) -> f64 {
        if self.sources.classes.are_given() {
            self.share_with_lists::<ClassLists>(queries, order, k, monitor)
        } else {
            self.share_with_lists::<MemberLists>(queries, order, k, monitor)
        }
    }

    /// Returns the work of a scan for this many queries, in multiply-adds.
    fn work_of_scan(&self, queries: usize) -> u64 {
        (queries * self.groups.len() * self.sources.columns()) as u64
    }

    fn share_with_lists<L: Lists>(
        &self,
        queries: &Queries<'_>,
        order: &[u32],
        k: usize,
        monitor: &dyn Monitor,
    ) -> f64 {
        let bands = self.bands(queries, order);
        let stride = bands.len().div_ceil(SAMPLE).max(1);
        let sample: Vec<_> = bands.iter().step_by(stride).map(|band| &band[..1]).collect();
        let arch = Arch::new();
        let (work, sampled) = sample
            .par_iter()
            .map(|blocks| {
                let count = blocks[0].1.len();
                let limit = Limit { work: 2 * self.work_of_scan(count), ..self.limit(queries) };
                let lists = PhantomData::<L>;
                let band = Band { join: self, queries, blocks, k, limit, monitor, lists };
                (arch.dispatch(band).work, count)
            })
            .reduce(|| (0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
        work as f64 / self.work_of_scan(sampled).max(1) as f64
    }

    /// Searches `order` with lists of this kind.
    fn search_lists<L: Lists>(
        &self,
        queries: &Queries<'_>,
        order: &[u32],
        found: &mut NeighborLists,
        monitor: &dyn Monitor,
    ) -> Result<(), KnnError> {
        let k = found.k();
        let arch = Arch::new();
        let bands = self.bands(queries, order);
        let pieces =
            found.pieces(bands.iter().map(|band| band.iter().map(|(_, run)| run.len()).sum()));
        pieces.zip(&bands).for_each(|(mut piece, blocks)| {
            if monitor.interrupted() {
                return;
            }
            let searched = arch.dispatch(Band {
                join: self,
                queries,
                blocks,
                k,
                limit: self.limit(queries),
                monitor,
                lists: PhantomData::<L>,
            });
            for (place, lists) in searched.lists.iter().enumerate() {
                piece.store(place, lists);
            }
            monitor.advance(searched.lists.len() as u64);
        });
        Ok(monitor.check()?)
    }
}

impl NeighborIndex for Join<'_> {
    /// Returns the queries in the order of the tree.
    fn order(&self, queries: &Queries<'_>) -> Vec<u32> {
        let mut placed: Vec<(u32, u32)> = (0..queries.len())
            .into_par_iter()
            .map(|query| (self.place(queries, query), query as u32))
            .collect();
        placed.par_sort_unstable();
        placed.into_iter().map(|(_, query)| query).collect()
    }

    fn search(
        &self,
        queries: &Queries<'_>,
        order: &[u32],
        found: &mut NeighborLists,
        monitor: &dyn Monitor,
    ) -> Result<(), KnnError> {
        if self.sources.classes.are_given() {
            self.search_lists::<ClassLists>(queries, order, found, monitor)
        } else {
            self.search_lists::<MemberLists>(queries, order, found, monitor)
        }
    }
}

#[cfg(test)]
mod tests {
    use calib_core::{Seed, Segments, Silent, States, TransitionIndex, Transitions};
    use calib_files::ScratchPlace;

    use super::*;
    use crate::{Blocks, Exclusion, Sources, index::at_every_level};

    /// Returns the neighbours of each query, for the first three members.
    fn lists(level: &block::Searched<MemberLists>) -> Vec<Vec<(TransitionIndex, f64)>> {
        (level.lists.iter())
            .map(|lists| (0..3).flat_map(|m| lists.of(m).collect::<Vec<_>>()).collect())
            .collect()
    }

    #[test]
    fn levels_do_not_change_a_list() {
        let rows = 2000;
        let columns = 40;
        let mut rng = Seed::new(8).rng();
        let loadings: Vec<f64> = (0..3 * columns).map(|_| rng.normal()).collect();
        let mut factors = [0.0; 3];
        let mut values: Vec<f32> = Vec::new();
        for row in 0..rows {
            if row % 7 == 3 {
                values.extend_from_within((row - 2) * columns..(row - 1) * columns);
                continue;
            }
            for factor in &mut factors {
                *factor = 0.95 * *factor + 0.3 * rng.normal();
            }
            for column in 0..columns {
                let mixed =
                    (0..3).map(|f| factors[f] * loadings[f * columns + column]).sum::<f64>();
                let spike = if row % 333 == 9 { 1e6 } else { 0.0 };
                values.push((mixed + 0.05 * rng.normal() + spike) as f32);
            }
        }
        let states = States::new(values, rows, columns).expect("finite");
        let transitions = Transitions::new(Segments::from_lengths([rows]).expect("valid"));
        let blocks = Blocks::new(&transitions, 3).expect("valid");
        let sources = Sources::new(&states, &transitions, &blocks).expect("valid");
        let queries =
            Queries::next_states(&sources, Exclusion { theiler: 4, ..Exclusion::default() });
        let join = Join::new(sources, &ScratchPlace::Memory, &Silent).expect("built");
        let join = join.expect("the values are small");
        assert_eq!(join.far.within(0.0..=0.0, f64::INFINITY).len(), 5);
        let order = join.order(&queries);
        for blocks in &join.bands(&queries, &order) {
            let (queries, limit) = (&queries, join.limit(&queries));
            let lists_of = PhantomData::<MemberLists>;
            let band = Band {
                join: &join,
                queries,
                blocks,
                k: 5,
                limit,
                monitor: &Silent,
                lists: lists_of,
            };
            let levels = at_every_level(band);
            for level in &levels[1..] {
                assert_eq!(lists(level), lists(&levels[0]));
            }
        }
    }
}
