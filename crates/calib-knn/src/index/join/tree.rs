//! Images in leaves of near neighbours, with boxes over leaves, over pairs of leaves and so on.

use std::ops::Range;

use calib_core::Monitor;
use calib_files::{Scratch, ScratchPlace};
use rayon::prelude::*;

use super::spread::{Spread, boundary};
use crate::KnnError;

/// Maximum number of images in a leaf.
pub(super) const LEAF: usize = STRIPS * STRIP;
/// Number of images that are compared together. They are near each other and have a box of their own.
pub(super) const STRIP: usize = 16;
/// Strips per leaf.
pub(super) const STRIPS: usize = 16;
/// Number of leading coordinates in which strips have boxes.
pub(super) const SIDES: usize = 16;
/// Number of values that bound the strips of a leaf.
const STRIP_BOXES: usize = SIDES * 2 * STRIPS;

/// A node of the tree: a box around the images below it.
#[derive(Debug)]
struct Node {
    /// The leaves below the node.
    leaves: Range<u32>,
    /// The second child; the first is the next node. Zero for a leaf.
    second: u32,
}

/// Images sorted into leaves, with a binary tree of boxes.
#[derive(Debug)]
pub(super) struct Tree {
    width: usize,
    /// Number of images.
    count: usize,
    /// Start of each leaf in the order of the tree, and the end of the last.
    starts: Vec<u32>,
    /// Coordinates, `[leaf, strip, coordinate, lane]`; lanes without an image are zero.
    strips: Scratch<f32>,
    /// Boxes of the strips, `[leaf, coordinate, lower or upper, strip]`, in the leading coordinates.
    strip_boxes: Scratch<f32>,
    nodes: Vec<Node>,
    /// The lower bounds of each node, then its upper bounds.
    boxes: Vec<f32>,
    leaf_nodes: Vec<u32>,
}

impl Tree {
    /// Sorts `images`, `[n, width]`, into leaves. Also returns the image at each position. Progress counts each image
    /// twice.
    ///
    /// # Errors
    /// If there is no place for the sorted images, or the monitor interrupts.
    pub(super) fn new(
        images: &[f32],
        width: usize,
        place: &ScratchPlace,
        monitor: &dyn Monitor,
    ) -> Result<(Self, Vec<u32>), KnnError> {
        let count = images.len() / width;
        let leaves = (images.len() / width).div_ceil(LEAF).max(1);
        let mut order: Vec<u32> = (0..count as u32).collect();
        let starts = (0..=leaves).map(|leaf| boundary(count, leaves, leaf) as u32).collect();
        let spread = Spread { images, width, count, leaves, strip: STRIP, monitor };
        spread.arrange(&mut order, 0..leaves);
        monitor.check()?;
        let mut tree = Self {
            width,
            count,
            strips: Scratch::zeroed(leaves * width * LEAF, place)?,
            strip_boxes: Scratch::zeroed(leaves * STRIP_BOXES, place)?,
            starts,
            nodes: Vec::with_capacity(2 * leaves),
            boxes: Vec::new(),
            leaf_nodes: vec![0; leaves],
        };
        tree.fill_strips(images, &order, monitor);
        monitor.check()?;
        tree.add_node(images, &order, 0..leaves as u32);
        Ok((tree, order))
    }

    fn fill_strips(&mut self, images: &[f32], order: &[u32], monitor: &dyn Monitor) {
        let starts = &self.starts;
        let width = self.width;
        let strips = self.strips.par_chunks_exact_mut(width * LEAF);
        let boxes = self.strip_boxes.par_chunks_exact_mut(STRIP_BOXES);
        strips.zip(boxes).enumerate().for_each(|(leaf, (strips, boxes))| {
            if monitor.interrupted() {
                return;
            }
            for side in boxes.chunks_exact_mut(2 * STRIPS) {
                side[..STRIPS].fill(f32::INFINITY);
                side[STRIPS..].fill(f32::NEG_INFINITY);
            }
            let members = &order[starts[leaf] as usize..starts[leaf + 1] as usize];
            for (lane, &image) in members.iter().enumerate() {
                let image = &images[image as usize * width..][..width];
                let strip = lane / STRIP;
                let lane = lane % STRIP;
                let lanes = strips[strip * width * STRIP + lane..].iter_mut().step_by(STRIP);
                for (to, &value) in lanes.zip(image) {
                    *to = value;
                }
                for (side, &value) in boxes.chunks_exact_mut(2 * STRIPS).zip(image) {
                    let (lower, upper) = side.split_at_mut(STRIPS);
                    lower[strip] = lower[strip].min(value);
                    upper[strip] = upper[strip].max(value);
                }
            }
            monitor.advance(members.len() as u64);
        });
    }

    /// Appends the node over `leaves`, then all nodes below it. Its box is set after theirs.
    fn add_node(&mut self, images: &[f32], order: &[u32], leaves: Range<u32>) -> usize {
        let number = self.nodes.len();
        let width = self.width;
        self.nodes.push(Node { leaves: leaves.clone(), second: 0 });
        self.boxes.extend(std::iter::repeat_n(f32::INFINITY, width));
        self.boxes.extend(std::iter::repeat_n(f32::NEG_INFINITY, width));
        if leaves.len() == 1 {
            self.leaf_nodes[leaves.start as usize] = number as u32;
            let bounds = &mut self.boxes[2 * number * width..];
            let (lower, upper) = bounds.split_at_mut(width);
            let leaf = leaves.start as usize;
            for &image in &order[self.starts[leaf] as usize..self.starts[leaf + 1] as usize] {
                let image = &images[image as usize * width..][..width];
                for ((lower, upper), &value) in lower.iter_mut().zip(&mut *upper).zip(image) {
                    *lower = lower.min(value);
                    *upper = upper.max(value);
                }
            }
            return number;
        }
        let middle = leaves.start + (leaves.len() / 2) as u32;
        let first = self.add_node(images, order, leaves.start..middle);
        let second = self.add_node(images, order, middle..leaves.end);
        self.nodes[number].second = second as u32;
        for child in [first, second] {
            let (above, below) = self.boxes.split_at_mut(2 * child * width);
            let above = &mut above[2 * number * width..][..2 * width];
            let (lower, upper) = above.split_at_mut(width);
            for (bound, &value) in lower.iter_mut().zip(&below[..width]) {
                *bound = bound.min(value);
            }
            for (bound, &value) in upper.iter_mut().zip(&below[width..2 * width]) {
                *bound = bound.max(value);
            }
        }
        number
    }

    pub(super) fn leaves(&self) -> usize {
        self.starts.len() - 1
    }

    pub(super) fn nodes(&self) -> usize {
        self.nodes.len()
    }

    /// Whether some leaf contains position `place` of the order.
    pub(super) fn has(&self, place: u32) -> bool {
        (place as usize) < self.count
    }

    /// Returns the leaf that contains position `place` of the order, and the lane in it.
    pub(super) fn leaf_of(&self, place: usize) -> (usize, usize) {
        // The last leaf whose boundary is not past the position.
        let count = self.count as u64;
        let leaves = self.leaves() as u64;
        let leaf = (((place as u64 + 1) * leaves).div_ceil(count) - 1) as usize;
        (leaf, place - self.starts[leaf] as usize)
    }

    pub(super) fn places(&self, leaf: usize) -> Range<u32> {
        self.starts[leaf]..self.starts[leaf + 1]
    }

    /// Returns the coordinates of a strip of a leaf, `[coordinate, lane]`.
    pub(super) fn strip(&self, leaf: usize, strip: usize) -> &[f32] {
        let size = self.width * STRIP;
        &self.strips[(leaf * STRIPS + strip) * size..][..size]
    }

    /// Returns the boxes of a leaf's strips, `[coordinate, lower or upper, strip]`. Strips without images have empty boxes.
    pub(super) fn strip_boxes(&self, leaf: usize) -> &[f32] {
        &self.strip_boxes[leaf * STRIP_BOXES..][..STRIP_BOXES]
    }

    /// Writes the image in position `lane` of a leaf.
    pub(super) fn image(&self, leaf: usize, lane: usize, image: &mut [f32]) {
        let lanes = self.strip(leaf, lane / STRIP).iter().skip(lane % STRIP).step_by(STRIP);
        for (coordinate, &value) in image.iter_mut().zip(lanes) {
            *coordinate = value;
        }
    }

    /// Returns the lower and upper bounds of a node.
    pub(super) fn bounds(&self, node: usize) -> (&[f32], &[f32]) {
        self.boxes[2 * node * self.width..][..2 * self.width].split_at(self.width)
    }

    pub(super) fn node_of(&self, leaf: usize) -> usize {
        self.leaf_nodes[leaf] as usize
    }

    /// Returns a leaf near `image`: at each node it descends to the child with the nearer box.
    pub(super) fn nearest_leaf(&self, image: &[f32]) -> usize {
        let mut node = 0;
        loop {
            match self.below(node) {
                Below::Leaf(leaf) => return leaf,
                Below::Nodes([first, second]) => {
                    let [to_first, to_second] =
                        [first, second].map(|child| self.distance_to_box(child, image));
                    node = if to_second < to_first { second } else { first };
                }
            }
        }
    }

    /// Returns the squared distance of `image` from the box of a node.
    #[inline]
    fn distance_to_box(&self, node: usize, image: &[f32]) -> f32 {
        let (lower, upper) = self.bounds(node);
        let sides = image.iter().zip(lower.iter().zip(upper));
        sides.map(|(&x, (&l, &u))| (l - x).max(x - u).max(0.0).powi(2)).sum()
    }

    /// Returns the children of a node, or its leaf.
    pub(super) fn below(&self, node: usize) -> Below {
        let Node { leaves, second } = &self.nodes[node];
        if *second == 0 {
            Below::Leaf(leaves.start as usize)
        } else {
            Below::Nodes([node + 1, *second as usize])
        }
    }
}

#[derive(Clone, Copy, Debug)]
pub(super) enum Below {
    Leaf(usize),
    Nodes([usize; 2]),
}

#[cfg(test)]
mod tests {
    use calib_core::{Seed, Silent};

    use super::*;

    #[test]
    fn boxes_hold_their_images() {
        let count = 1000;
        let width = 16;
        let mut rng = Seed::new(5).rng();
        let images: Vec<f32> = (0..count * width).map(|_| rng.normal() as f32).collect();
        let (tree, order) =
            Tree::new(&images, width, &ScratchPlace::Memory, &Silent).expect("built");
        assert_eq!(tree.leaves(), count.div_ceil(LEAF));
        let mut seen = vec![false; count];
        let mut open = vec![(0, Vec::new())];
        while let Some((node, mut above)) = open.pop() {
            above.push(node);
            match tree.below(node) {
                Below::Nodes(children) => open.extend(children.map(|child| (child, above.clone()))),
                Below::Leaf(leaf) => {
                    assert_eq!(tree.node_of(leaf), node);
                    assert!(tree.places(leaf).len() <= LEAF);
                    for (lane, place) in tree.places(leaf).enumerate() {
                        let image = order[place as usize];
                        assert_eq!(tree.leaf_of(place as usize), (leaf, lane));
                        assert!(!std::mem::replace(&mut seen[image as usize], true));
                        let image = &images[image as usize * width..][..width];
                        let mut stored = [0.0; 16];
                        tree.image(leaf, lane, &mut stored);
                        assert_eq!(stored, image);
                        for (c, &value) in image.iter().enumerate() {
                            let side = &tree.strip_boxes(leaf)[2 * c * STRIPS..][..2 * STRIPS];
                            let strip = lane / STRIP;
                            assert!(side[strip] <= value && value <= side[STRIPS + strip]);
                            for &node in &above {
                                let (lower, upper) = tree.bounds(node);
                                assert!(lower[c] <= value && value <= upper[c]);
                            }
                        }
                    }
                }
            }
        }
        assert!(seen.into_iter().all(|seen| seen));
    }

    #[test]
    fn one_image_is_one_leaf() {
        let (tree, order) =
            Tree::new(&[0.5; 16], 16, &ScratchPlace::Memory, &Silent).expect("built");
        assert_eq!((tree.leaves(), tree.places(0), order), (1, 0..1, vec![0]));
        assert!(matches!(tree.below(0), Below::Leaf(0)));
    }
}
