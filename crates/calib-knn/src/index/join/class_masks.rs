//! Which classes occur in which part of the tree.

use super::tree::{Below, STRIP, STRIPS, Tree};
use crate::{classes::Classes, groups::Groups};

/// A set of classes. Classes whose numbers are equal modulo 64 share a bit.
#[derive(Clone, Copy, Debug)]
pub(super) struct Mask(u64);

impl Mask {
    const NONE: Self = Self(0);

    fn include(&mut self, other: Self) {
        self.0 |= other.0;
    }

    /// Whether the set may contain a class.
    fn has(self, class: usize) -> bool {
        self.0 >> (class % 64) & 1 == 1
    }

    /// Returns the values, one per class, that belong to classes of the set.
    pub(super) fn own<T>(self, values: &[T]) -> impl Iterator<Item = &T> {
        let own = values.iter().enumerate().filter(move |&(class, _)| self.has(class));
        own.map(|(_, value)| value)
    }

    /// Returns the largest of the values, one per class, that belong to classes of the set. Values are at least −1.
    pub(super) fn most(self, values: impl Iterator<Item = f32>) -> f32 {
        let own = values.enumerate().filter(|&(class, _)| self.has(class));
        own.fold(-1.0, |most, (_, value)| most.max(value))
    }
}

/// The classes of the sources in each strip and below each node, so that a search skips those without a class that it needs. Where
/// actions follow from states, most parts of the tree have one class.
#[derive(Debug, Default)]
pub(super) struct ClassMasks {
    /// The class of the group at each position of the tree, and of those outside.
    groups: Vec<u16>,
    strips: Vec<Mask>,
    nodes: Vec<Mask>,
}

impl ClassMasks {
    /// Finds the classes of the groups, which are in the order of the tree.
    pub(super) fn new(tree: &Tree, groups: &Groups, classes: Classes<'_>) -> Self {
        let classes: Vec<u16> =
            (0..groups.len() as u32).map(|group| groups.class(group, classes) as u16).collect();
        let mut strips = vec![Mask::NONE; tree.leaves() * STRIPS];
        let mut nodes = vec![Mask::NONE; tree.nodes()];
        for leaf in 0..tree.leaves() {
            for (lane, place) in tree.places(leaf).enumerate() {
                let class = Mask(1 << (classes[place as usize] % 64));
                strips[leaf * STRIPS + lane / STRIP].include(class);
            }
            let node = &mut nodes[tree.node_of(leaf)];
            strips[leaf * STRIPS..][..STRIPS].iter().for_each(|&strip| node.include(strip));
        }
        // Children come after their node.
        for node in (0..nodes.len()).rev() {
            if let Below::Nodes(children) = tree.below(node) {
                for child in children {
                    let below = nodes[child];
                    nodes[node].include(below);
                }
            }
        }
        Self { groups: classes, strips, nodes }
    }

    /// Returns the class of a group.
    pub(super) fn class(&self, group: u32) -> usize {
        usize::from(self.groups[group as usize])
    }

    /// Returns the classes in a strip of a leaf.
    pub(super) fn strip(&self, leaf: usize, strip: usize) -> Mask {
        self.strips[leaf * STRIPS + strip]
    }

    /// Returns the classes below a node.
    pub(super) fn node(&self, node: usize) -> Mask {
        self.nodes[node]
    }
}
