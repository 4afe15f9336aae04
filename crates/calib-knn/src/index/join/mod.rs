use std::{marker::PhantomData, ops::RangeInclusive};

use calib_core::Monitor;
use calib_files::{Scratch, ScratchPlace};
use pulp::Arch;
use rayon::prelude::*;

mod block;
mod class_masks;
mod embedding;
mod far;
mod kernel;
mod spread;
mod tree;

use super::{NeighborIndex, NeighborLists, Queries, Sources, pending::Pool};
use crate::{
    KnnError, Lists, MemberLists, class_lists::ClassLists, distance::Margin, groups::Groups,
};
use block::{Band, Limit, QUERIES};
use class_masks::ClassMasks;
use embedding::Embedding;
pub(crate) use embedding::width as image_width;
use far::Far;

pub(crate) use spread::leaves;
use tree::{LEAF, Tree};

/// Sources between two checks for an interruption while the images are computed.
const CHUNK: usize = 1 << 12;
/// Leaves of a band. Its queries share what is read of other leaves.
const BAND: usize = 4;
/// Number of bands from which the work is estimated.
const SAMPLE: usize = 12;
/// Beyond this distance from the mean, f32 images could overflow.
const FARTHEST: f64 = 1e15;

/// The position of a transition that cannot be a neighbour.
const ELSEWHERE: u32 = u32::MAX;

/// An exact join of queries and sources, for data in which most sources can be ruled out unseen.
///
/// The distinct source states are mapped into at most 32 dimensions by an embedding that lengthens no distance. They are
/// sorted into leaves of near neighbours, with a tree of boxes above. Queries are searched in blocks of one leaf. A block
/// visits the nearest boxes first, until the next box is further than any query's `k`-th neighbour. Sources whose images are
/// near enough are compared in f32. Those within the f32 error margin are measured by the definition.
#[derive(Debug)]
pub struct Join<'a> {
    sources: Sources<'a>,
    /// Distinct states, in the order of the tree.
    groups: Groups,
    embedding: Embedding,
    tree: Tree,
    /// Empty if sources have no classes.
    masks: ClassMasks,
    /// Position of each transition's source in the order of the tree.
    place_of: Vec<u32>,
    image_margin: Margin,
    state_margin: Margin,
    /// The largest distance from the mean of a source in the tree.
    norm: f64,
    /// The sources that are not in the tree.
    far: Far,
}

impl<'a> Join<'a> {
    /// Maps and sorts the sources. Returns `None` if there are no columns, or if values are too large for images in f32. The
    /// images are stored in `place`. Progress counts four passes over the sources.
    ///
    /// # Errors
    /// If there is no place for the images, or the monitor interrupts.
    pub fn new(
        sources: Sources<'a>,
        place: &ScratchPlace,
        monitor: &dyn Monitor,
    ) -> Result<Option<Self>, KnnError> {
        if sources.columns() == 0 {
            return Ok(None);
        }
        monitor.begin("neighbour index", 4 * sources.len() as u64);
        let groups = Groups::new(&sources, monitor)?;
        let embedding = Embedding::new(&sources, &groups);
        let width = embedding.width();
        let mut images = Scratch::zeroed(groups.len() * width, place)?;
        let (mut norm, mut far) = map(&embedding, &sources, &groups, &mut images, monitor)?;
        if far.len() > Far::most(groups.len()) {
            norm = far.iter().fold(norm, |norm, &(own, _)| norm.max(own));
            far.clear();
        }
        if norm > FARTHEST {
            return Ok(None);
        }
        let near = keep_near(&mut images, width, &far);
        let count = near.as_ref().map_or(groups.len(), Vec::len);
        let (tree, mut order) = Tree::new(&images[..count * width], width, place, monitor)?;
        drop(images);
        if let Some(near) = near {
            for image in &mut order {
                *image = near[*image as usize];
            }
        }
        let first = order.len() as u32;
        far.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        order.extend(far.iter().map(|&(_, group)| group));
        let far = Far::new(first, far.into_iter().map(|(own, _)| own).collect());
        let groups = groups.in_order(&order);
        drop(order);
        let mut place_of = vec![ELSEWHERE; sources.len()];
        for place in 0..groups.len() {
            for &transition in groups.transitions(place) {
                place_of[transition as usize] = place as u32;
            }
        }
        let masks = match sources.classes {
            classes if classes.are_given() => ClassMasks::new(&tree, &groups, classes),
            _ => ClassMasks::default(),
        };
        let image_margin = Margin::new(width);
        let state_margin = Margin::new(sources.columns());
        Ok(Some(Self {
            sources,
            groups,
            embedding,
            tree,
            masks,
            place_of,
            image_margin,
            state_margin,
            norm,
            far,
        }))
    }

    /// Returns the distinct states, for use in a scan that is less work.
    pub(super) fn into_groups(self) -> Groups {
        self.groups
    }

    fn pool(&self) -> Pool<'_> {
        Pool { sources: &self.sources, groups: &self.groups, margin: self.state_margin }
    }

    /// Returns a position in the tree near the query: that of its own row if this is a source there.
    fn place(&self, queries: &Queries<'_>, query: usize) -> u32 {
        if let Some(transition) = queries.own_transition(query) {
            // For a transition that cannot be a neighbour, the last one before it that can.
            let transition = self.sources.candidates.near(transition);
            let place = self.place_of[transition as usize];
            if self.tree.has(place) {
                return place;
            }
        }
        let mut image = vec![0.0; self.embedding.width()];
        self.embedding.map(queries.states().row(queries.row(query)), &mut image);
        self.tree.places(self.tree.nearest_leaf(&image)).start
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
        let scan = |queries: usize| (queries * self.groups.len() * self.sources.columns()) as u64;
        let (work, sampled) = sample
            .par_iter()
            .map(|blocks| {
                let count = blocks[0].1.len();
                let limit = Limit { work: 2 * scan(count), ..self.limit(queries) };
                let lists = PhantomData::<L>;
                let band = Band { join: self, queries, blocks, k, limit, monitor, lists };
                (arch.dispatch(band).work, count)
            })
            .reduce(|| (0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
        work as f64 / scan(sampled).max(1) as f64
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

    /// Writes the image of a query; returns bounds on its distance from the mean.
    fn image(&self, queries: &Queries<'_>, query: usize, image: &mut [f32]) -> RangeInclusive<f64> {
        let place = queries.own_source(query).map(|own| self.place_of[own as usize]);
        if let Some(place) = place.filter(|&place| self.tree.has(place)) {
            let (leaf, lane) = self.tree.leaf_of(place as usize);
            self.tree.image(leaf, lane, image);
            return 0.0..=self.norm;
        }
        let norm = self.embedding.map(queries.states().row(queries.row(query)), image);
        norm..=norm
    }
}

/// Writes the image of every group. Returns the largest distance from the mean of the states that are not far, and the far
/// states with their distances. Progress counts groups.
fn map(
    embedding: &Embedding,
    sources: &Sources<'_>,
    groups: &Groups,
    images: &mut [f32],
    monitor: &dyn Monitor,
) -> Result<(f64, Vec<(f64, u32)>), KnnError> {
    let width = embedding.width();
    let chunks = images.par_chunks_mut(CHUNK * width).enumerate();
    let mapped = chunks.map(|(number, chunk)| {
        let mut norm = 0.0_f64;
        let mut far = Vec::new();
        if monitor.interrupted() {
            return (norm, far);
        }
        let images = chunk.chunks_exact_mut(width);
        let count = images.len() as u64;
        for (group, image) in (number * CHUNK..).zip(images) {
            let own = embedding.map(sources.states.row(groups.row(group)), image);
            if own > embedding.far() {
                far.push((own, group as u32));
            } else {
                norm = norm.max(own);
            }
        }
        monitor.advance(count);
        (norm, far)
    });
    let all = mapped.reduce(
        || (0.0, Vec::new()),
        |(a, mut far), (b, more)| {
            far.extend(more);
            (a.max(b), far)
        },
    );
    monitor.check()?;
    Ok(all)
}

/// Moves the images that are not far to the front, and returns their numbers. Returns `None` if no image is far.
fn keep_near(images: &mut [f32], width: usize, far: &[(f64, u32)]) -> Option<Vec<u32>> {
    let mut apart: Vec<u32> = far.iter().map(|&(_, group)| group).collect();
    apart.sort_unstable();
    let count = (images.len() / width) as u32;
    let near: Vec<u32> = (!apart.is_empty())
        .then(|| (0..count).filter(|group| apart.binary_search(group).is_err()).collect())?;
    for (to, &from) in near.iter().enumerate() {
        let from = from as usize * width;
        images.copy_within(from..from + width, to * width);
    }
    Some(near)
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

    use super::*;
    use crate::{Blocks, Exclusion, index::at_every_level};

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
