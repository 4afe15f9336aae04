//! Images in leaves of near neighbours, and boxes over leaves, over pairs of leaves and so on.

use std::ops::Range;

use calib_core::Monitor;
use calib_files::{Scratch, ScratchPlace};
use rayon::prelude::*;

use crate::{KnnError, index::going_on};

/// Images side by side in a leaf.
pub(crate) const LEAF: usize = 128;
/// Images from which a node chooses its widest coordinate.
const SAMPLE: usize = 512;

/// One node: a box around the images below it.
#[derive(Debug)]
struct Node {
    /// The leaves below.
    leaves: Range<u32>,
    /// The second child; the first is the next node. Zero in leaves.
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
    /// Coordinates `[leaf, coordinate, lane]`; lanes without an image are zero.
    lanes: Scratch<f32>,
    nodes: Vec<Node>,
    /// Lower, then upper bounds of each node.
    boxes: Vec<f32>,
    /// The node of each leaf.
    leaf_nodes: Vec<u32>,
}

impl Tree {
    /// Sort `images`, `[n, width]`, into leaves; returns which image lies in which place. Progress counts each image twice.
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
        let leaves = count.div_ceil(LEAF).max(1);
        let mut order: Vec<u32> = (0..count as u32).collect();
        let starts = (0..=leaves).map(|leaf| boundary(count, leaves, leaf) as u32).collect();
        let spread = Spread { images, width, count, leaves, monitor };
        spread.arrange(&mut order, 0..leaves);
        going_on(monitor)?;
        let mut tree = Self {
            width,
            count,
            lanes: Scratch::zeroed(leaves * width * LEAF, place)?,
            starts,
            nodes: Vec::with_capacity(2 * leaves),
            boxes: Vec::new(),
            leaf_nodes: vec![0; leaves],
        };
        tree.fill_lanes(images, &order, monitor);
        going_on(monitor)?;
        tree.add_node(images, &order, 0..leaves as u32);
        Ok((tree, order))
    }

    fn fill_lanes(&mut self, images: &[f32], order: &[u32], monitor: &dyn Monitor) {
        let (starts, width) = (&self.starts, self.width);
        self.lanes.par_chunks_exact_mut(width * LEAF).enumerate().for_each(|(leaf, lanes)| {
            if monitor.interrupted() {
                return;
            }
            let members = &order[starts[leaf] as usize..starts[leaf + 1] as usize];
            for (lane, &image) in members.iter().enumerate() {
                let image = &images[image as usize * width..][..width];
                for (coordinate, &value) in image.iter().enumerate() {
                    lanes[coordinate * LEAF + lane] = value;
                }
            }
            monitor.advance(members.len() as u64);
        });
    }

    /// Append the node over `leaves` and all nodes below it; its box is known once they are.
    fn add_node(&mut self, images: &[f32], order: &[u32], leaves: Range<u32>) -> usize {
        let (number, width) = (self.nodes.len(), self.width);
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

    /// Number of leaves.
    pub(super) fn leaves(&self) -> usize {
        self.starts.len() - 1
    }

    /// The leaf that holds position `place` of the order, and the lane there.
    pub(super) fn leaf_of(&self, place: usize) -> (usize, usize) {
        // The last leaf whose boundary is not past the place.
        let (count, leaves) = (self.count as u64, self.leaves() as u64);
        let leaf = (((place as u64 + 1) * leaves).div_ceil(count) - 1) as usize;
        (leaf, place - self.starts[leaf] as usize)
    }

    /// The places of a leaf.
    pub(super) fn places(&self, leaf: usize) -> Range<u32> {
        self.starts[leaf]..self.starts[leaf + 1]
    }

    /// Coordinates of a leaf, `[coordinate, lane]`.
    pub(super) fn lanes(&self, leaf: usize) -> &[f32] {
        &self.lanes[leaf * self.width * LEAF..][..self.width * LEAF]
    }

    /// Lower and upper bounds of a node.
    pub(super) fn bounds(&self, node: usize) -> (&[f32], &[f32]) {
        self.boxes[2 * node * self.width..][..2 * self.width].split_at(self.width)
    }

    /// The node of a leaf.
    pub(super) fn node_of(&self, leaf: usize) -> usize {
        self.leaf_nodes[leaf] as usize
    }

    /// A leaf near `image`: at each node the child whose box is nearer.
    pub(super) fn nearest_leaf(&self, image: &[f32]) -> usize {
        let distance = |node: usize| {
            let (lower, upper) = self.bounds(node);
            let sides = image.iter().zip(lower.iter().zip(upper));
            sides.map(|(&x, (&l, &u))| (l - x).max(x - u).max(0.0).powi(2)).sum::<f32>()
        };
        let mut node = 0;
        loop {
            match self.below(node) {
                Below::Leaf(leaf) => return leaf,
                Below::Nodes([first, second]) => {
                    node = if distance(second) < distance(first) { second } else { first };
                }
            }
        }
    }

    /// The children of a node, or the leaf that it is.
    pub(super) fn below(&self, node: usize) -> Below {
        let Node { leaves, second } = &self.nodes[node];
        if *second == 0 {
            Below::Leaf(leaves.start as usize)
        } else {
            Below::Nodes([node + 1, *second as usize])
        }
    }
}

/// What is below a node.
#[derive(Clone, Copy, Debug)]
pub(super) enum Below {
    /// A leaf.
    Leaf(usize),
    /// Two nodes.
    Nodes([usize; 2]),
}

/// Start of each leaf and the end of the last, and which image lies in which place: [`Tree::new`] without the tree.
///
/// # Errors
/// If there is no place for the sorted images, or the monitor interrupts.
pub(crate) fn leaves(
    images: &[f32],
    width: usize,
    place: &ScratchPlace,
    monitor: &dyn Monitor,
) -> Result<(Vec<u32>, Vec<u32>), KnnError> {
    let (tree, order) = Tree::new(images, width, place, monitor)?;
    Ok((tree.starts, order))
}

/// The first position of `leaf` when `count` images are spread evenly over `leaves`.
fn boundary(count: usize, leaves: usize, leaf: usize) -> usize {
    (leaf as u128 * count as u128 / leaves as u128) as usize
}

/// How images are spread over leaves.
struct Spread<'a> {
    images: &'a [f32],
    width: usize,
    count: usize,
    leaves: usize,
    monitor: &'a dyn Monitor,
}

impl Spread<'_> {
    /// Put the images of `order`, which fill `leaves`, into the order of the leaves: halve along the coordinate
    /// of largest variance.
    fn arrange(&self, order: &mut [u32], leaves: Range<usize>) {
        if leaves.len() <= 1 {
            self.monitor.advance(order.len() as u64);
            return;
        }
        if self.monitor.interrupted() {
            return;
        }
        let (images, width) = (self.images, self.width);
        let coordinate = widest(images, width, order);
        let middle = leaves.start + leaves.len() / 2;
        let boundary = |leaf| boundary(self.count, self.leaves, leaf);
        let at = boundary(middle) - boundary(leaves.start);
        let value = |image: &u32| images[*image as usize * width + coordinate];
        order.select_nth_unstable_by(at, |a, b| value(a).total_cmp(&value(b)).then(a.cmp(b)));
        let (left, right) = order.split_at_mut(at);
        rayon::join(
            || self.arrange(left, leaves.start..middle),
            || self.arrange(right, middle..leaves.end),
        );
    }
}

/// The coordinate of largest variance over a sample of the images.
fn widest(images: &[f32], width: usize, order: &[u32]) -> usize {
    let stride = order.len().div_ceil(SAMPLE);
    let (mut sums, mut squares) = (vec![0.0_f64; width], vec![0.0_f64; width]);
    let mut sampled = 0.0;
    for &image in order.iter().step_by(stride) {
        sampled += 1.0;
        let image = &images[image as usize * width..][..width];
        for ((sum, square), &value) in sums.iter_mut().zip(&mut squares).zip(image) {
            let value = f64::from(value);
            *sum += value;
            *square += value * value;
        }
    }
    let variance = |c: usize| squares[c] - sums[c] * sums[c] / sampled;
    (0..width).max_by(|&a, &b| variance(a).total_cmp(&variance(b)).then(b.cmp(&a))).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use calib_core::{Seed, Silent};

    use super::*;

    #[test]
    fn boxes_hold_their_images() {
        let (count, width) = (1000, 16);
        let mut rng = Seed::new(5).rng();
        let images: Vec<f32> = (0..count * width).map(|_| rng.normal() as f32).collect();
        let (tree, order) =
            Tree::new(&images, width, &ScratchPlace::Memory, &Silent).expect("built");
        assert_eq!(tree.leaves(), 8);
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
                        for (c, &value) in image.iter().enumerate() {
                            assert_eq!(tree.lanes(leaf)[c * LEAF + lane], value);
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
