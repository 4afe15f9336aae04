//! Test tables of many shapes, and the properties of their graphs by definition.

use std::{cmp::Reverse, iter, ops::Range};

use calib_core::Seed;
use proptest::prelude::*;

use super::graph::Graph;
use crate::Weights;

/// A table, and which rows of the data are outside the member.
#[derive(Clone, Debug)]
pub(super) struct Shape {
    neighbors: Vec<u32>,
    distances: Vec<f32>,
    k: usize,
    dropped: Range<u32>,
}

/// The order in which the nodes of a shape are numbered. Sweeps through a table depend on it; classes do not.
#[derive(Clone, Copy, Debug)]
pub(super) enum Order {
    Ascending,
    Descending,
    /// The first, the last, the second, the last but one, …
    Zigzag,
    Shuffled(u64),
}

impl Order {
    /// Returns the number of each of `count` nodes.
    fn numbers(self, count: usize) -> Vec<u32> {
        let mut numbers: Vec<u32> = (0..count as u32).collect();
        match self {
            Self::Ascending => {}
            Self::Descending => numbers.reverse(),
            Self::Zigzag => {
                let last = count as u32 - 1;
                numbers = (0..=last)
                    .map(
                        |node: u32| if node.is_multiple_of(2) { node / 2 } else { last - node / 2 },
                    )
                    .collect();
            }
            Self::Shuffled(seed) => {
                let mut rng = Seed::new(seed).rng();
                for node in (1..count).rev() {
                    numbers.swap(node, rng.below(node + 1));
                }
            }
        }
        numbers
    }
}

/// Returns `count` teeth of `length` rows. Each tooth rises row by row. Its last row leads to the first row of the next tooth or of the
/// previous one. So a rollout goes back one tooth at a time.
pub(super) fn saw(count: usize, length: usize) -> Vec<Vec<u32>> {
    (0..count)
        .flat_map(|tooth: usize| {
            let top = tooth * length + length - 1;
            let rise = (tooth * length..top).map(|node| vec![node as u32 + 1]);
            let next = (tooth + 1).min(count - 1) * length;
            rise.chain([vec![next as u32, (tooth.saturating_sub(1) * length) as u32]])
        })
        .collect()
}

/// Returns `count` rings of `length` nodes. Each ring leads to the next; the last one leads to itself, or to the first if `closes`.
pub(super) fn rings(count: usize, length: usize, closes: bool) -> Vec<Vec<u32>> {
    (0..count)
        .flat_map(|ring: usize| {
            let start = ring * length;
            let after =
                if ring + 1 < count { start + length } else { start * usize::from(!closes) };
            let turn = (0..length).map(move |at| start + (at + 1) % length);
            turn.enumerate().map(move |(at, next)| {
                if at + 1 == length { vec![next as u32, after as u32] } else { vec![next as u32] }
            })
        })
        .collect()
}

/// Returns nodes in a row, the last of which leads to itself.
pub(super) fn chain(count: usize) -> Vec<Vec<u32>> {
    (1..=count as u32).map(|next| vec![next.min(count as u32 - 1)]).collect()
}

impl Shape {
    /// Creates the table of these edges. In the rows that are `partly` drawn, the last neighbour is never drawn.
    pub(super) fn new(
        edges: &[Vec<u32>],
        order: Order,
        dropped: Range<u32>,
        partly: impl Fn(usize) -> bool,
    ) -> Self {
        let k = edges.iter().map(Vec::len).max().unwrap_or(1);
        let missing = dropped.len() as u32;
        let numbers: Vec<u32> = order
            .numbers(edges.len())
            .into_iter()
            .map(|node: u32| if node < dropped.start { node } else { node + missing })
            .collect();
        let rows = edges.len() + dropped.len();
        let mut neighbors = vec![u32::MAX; rows * k];
        let mut distances = vec![f32::INFINITY; rows * k];
        for (node, row) in edges.iter().enumerate() {
            let start = numbers[node] as usize * k;
            for at in 0..k {
                // A row with fewer edges repeats its last one.
                neighbors[start + at] = numbers[row[at.min(row.len() - 1)] as usize];
                let last = f32::from(u8::from(at + 1 == k));
                distances[start + at] = if partly(node) { last } else { 1.0 + last };
            }
        }
        Self { neighbors, distances, k, dropped }
    }

    pub(super) fn graph(&self) -> Graph<'_> {
        let Self { neighbors, distances, k, dropped } = self;
        Graph::new(neighbors, distances, *k, dropped.clone(), Weights::Linear)
    }

    /// Returns the transitions of the member.
    pub(super) fn nodes(&self) -> Vec<u32> {
        let rows = (self.neighbors.len() / self.k) as u32;
        (0..rows).filter(|node| !self.dropped.contains(node)).collect()
    }

    /// Returns the successors of each row.
    fn edges(&self) -> Vec<Vec<u32>> {
        let mut edges = vec![Vec::new(); self.neighbors.len() / self.k];
        for node in self.nodes() {
            let range = node as usize * self.k..(node as usize + 1) * self.k;
            let drawn = Weights::Linear.probabilities(&self.distances[range.clone()]);
            let drawn = self.neighbors[range].iter().zip(drawn).filter(|(_, share)| *share > 0.0);
            edges[node as usize] = drawn.map(|(&to, _)| to).collect();
        }
        edges
    }

    /// Returns the nodes that can be reached from `start`, including it, ascending.
    pub(super) fn reached(&self, start: u32) -> Vec<u32> {
        closure(&self.edges(), start)
    }

    /// Returns the nodes from which `end` can be reached, including it, ascending.
    pub(super) fn reaching(&self, end: u32) -> Vec<u32> {
        closure(&against(&self.edges()), end)
    }

    /// Returns the closed classes, the largest first: strongly connected components (Kosaraju's search, after Sharir 1981) without an
    /// edge that leads out.
    pub(super) fn closed(&self) -> Vec<Vec<u32>> {
        let edges = self.edges();
        let nodes = self.nodes();
        let mut seen = vec![false; edges.len()];
        let mut done = Vec::new();
        for &root in &nodes {
            visit(&edges, root, &mut seen, &mut done);
        }
        let back = against(&edges);
        let mut class = vec![usize::MAX; edges.len()];
        let mut classes = Vec::new();
        let mut seen = vec![false; edges.len()];
        for &root in done.iter().rev() {
            let mut members = Vec::new();
            visit(&back, root, &mut seen, &mut members);
            for &node in &members {
                class[node as usize] = classes.len();
            }
            classes.push(members);
        }
        classes.retain(|members| {
            !members.is_empty()
                && members.iter().all(|node| {
                    edges[*node as usize]
                        .iter()
                        .all(|&to| class[to as usize] == class[*node as usize])
                })
        });
        classes.sort_by_key(|members| Reverse(members.len()));
        classes
    }
}

/// Returns the graph with every edge reversed.
fn against(edges: &[Vec<u32>]) -> Vec<Vec<u32>> {
    let mut back = vec![Vec::new(); edges.len()];
    for (node, row) in edges.iter().enumerate() {
        for &to in row {
            back[to as usize].push(node as u32);
        }
    }
    back
}

fn closure(edges: &[Vec<u32>], start: u32) -> Vec<u32> {
    let mut seen = vec![false; edges.len()];
    let mut found = Vec::new();
    visit(edges, start, &mut seen, &mut found);
    found.sort_unstable();
    found
}

/// Appends the unseen nodes that can be reached from `root` in post-order: each after all nodes that it leads to first.
fn visit(edges: &[Vec<u32>], root: u32, seen: &mut [bool], done: &mut Vec<u32>) {
    if std::mem::replace(&mut seen[root as usize], true) {
        return;
    }
    let mut path = vec![(root, 0)];
    while let Some((node, followed)) = path.last_mut() {
        match edges[*node as usize].get(*followed) {
            None => {
                done.push(*node);
                path.pop();
            }
            Some(&to) => {
                *followed += 1;
                if !std::mem::replace(&mut seen[to as usize], true) {
                    path.push((to, 0));
                }
            }
        }
    }
}

/// Generates chains, saws, rings and random rows, numbered in any order, with some extra edges.
pub(super) fn shape() -> impl Strategy<Value = Shape> {
    let sizes = (1_usize..60, 1_usize..12);
    let edges = prop_oneof![
        (1_usize..400).prop_map(chain),
        sizes.clone().prop_map(|(count, length)| saw(count, length)),
        (sizes, any::<bool>()).prop_map(|((count, length), closes)| rings(count, length, closes)),
        proptest::collection::vec(proptest::collection::vec(any::<u32>(), 1..4), 1..200),
        // Most rows lead to the next.
        proptest::collection::vec(proptest::option::weighted(0.1, any::<u32>()), 1..400).prop_map(
            |jumps| {
                (jumps.into_iter().enumerate())
                    .map(|(node, jump)| iter::once(node as u32 + 1).chain(jump).collect())
                    .collect()
            }
        ),
    ];
    let order = prop_oneof![
        Just(Order::Ascending),
        Just(Order::Descending),
        Just(Order::Zigzag),
        any::<u64>().prop_map(Order::Shuffled)
    ];
    let besides = proptest::collection::vec((any::<usize>(), any::<u32>()), 0..4);
    let partly = prop_oneof![Just(usize::MAX), 2_usize..9];
    (edges, order, besides, partly, 0_usize..100, 0_usize..300).prop_map(
        |(mut edges, order, besides, partly, before, missing)| {
            let count = edges.len();
            for (node, to) in besides {
                edges[node % count].push(to);
            }
            edges.iter_mut().flatten().for_each(|to| *to %= count as u32);
            let before = before.min(count) as u32;
            let dropped = before..before + missing as u32;
            Shape::new(&edges, order, dropped, |node| node % partly == 1)
        },
    )
}
