use std::ops::RangeInclusive;

use calib_core::Monitor;
use calib_files::{Scratch, ScratchPlace};
use rayon::prelude::*;

use super::{
    super::{Queries, Sources, pending::Pool},
    class_masks::ClassMasks,
    embedding::Embedding,
    far::Far,
    tree::Tree,
};
use crate::{KnnError, distance::Margin, groups::Groups};

/// Sources between two checks for an interruption while the images are computed.
const CHUNK: usize = 1 << 12;
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
    pub(super) sources: Sources<'a>,
    /// Distinct states, in the order of the tree.
    pub(super) groups: Groups,
    pub(super) embedding: Embedding,
    pub(super) tree: Tree,
    /// Empty if sources have no classes.
    pub(super) masks: ClassMasks,
    /// Position of each transition's source in the order of the tree.
    place_of: Vec<u32>,
    pub(super) image_margin: Margin,
    state_margin: Margin,
    /// The largest distance from the mean of a source in the tree.
    pub(super) norm: f64,
    /// The sources that are not in the tree.
    pub(super) far: Far,
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

    pub(super) fn pool(&self) -> Pool<'_> {
        Pool { sources: &self.sources, groups: &self.groups, margin: self.state_margin }
    }

    /// Returns a position in the tree near the query: that of its own row if this is a source there.
    pub(super) fn place(&self, queries: &Queries<'_>, query: usize) -> u32 {
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

    /// Writes the image of a query; returns bounds on its distance from the mean.
    pub(super) fn image(
        &self,
        queries: &Queries<'_>,
        query: usize,
        image: &mut [f32],
    ) -> RangeInclusive<f64> {
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
