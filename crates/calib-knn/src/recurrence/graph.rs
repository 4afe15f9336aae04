use std::ops::Range;

use calib_core::Monitor;
use rayon::prelude::*;

use crate::{KnnError, Weights, bits::Bits};

/// Maximum number of sweeps through a set. Then another method finds the rest.
const SWEEPS: usize = 64;
const WORD: usize = u64::BITS as usize;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Sweep {
    Forwards,
    Backwards,
}

impl Sweep {
    /// Returns the index at this position of a sweep over `count` indices.
    fn of(self, position: usize, count: usize) -> usize {
        match self {
            Self::Forwards => position,
            Self::Backwards => count - 1 - position,
        }
    }
}

/// The graph of a member, with its transitions as nodes.
///
/// An edge leads from transition `i` to each neighbour in row `i` of the table that the weights of a step draw with a
/// probability above 0. (Linear weights never draw one neighbour of many that are all at distance 0.)
pub(crate) struct Graph<'a> {
    neighbors: &'a [u32],
    distances: &'a [f32],
    /// Number of neighbours per row.
    pub(super) k: usize,
    dropped: Range<u32>,
    pub(super) weights: Weights,
    /// Rows with a neighbour that is never drawn.
    doubtful: Bits,
}

impl<'a> Graph<'a> {
    /// Creates the graph of the member that lacks the transitions `dropped`.
    pub(crate) fn new(
        neighbors: &'a [u32],
        distances: &'a [f32],
        k: usize,
        dropped: Range<u32>,
        weights: Weights,
    ) -> Self {
        let rows = neighbors.len() / k;
        let doubtful = if matches!(weights, Weights::Uniform | Weights::Rank) {
            Bits::default()
        } else {
            Bits::from_words(
                distances
                    .par_chunks(WORD * k)
                    .map(|chunk: &[f32]| {
                        let rows = chunk.chunks_exact(k).enumerate();
                        rows.fold(0_u64, |word, (bit, row)| {
                            word | u64::from(!weights.draws_all(row)) << bit
                        })
                    })
                    .collect(),
                rows,
            )
        };
        Self { neighbors, distances, k, dropped, weights, doubtful }
    }

    /// Returns the number of transitions of the data.
    pub(crate) fn len(&self) -> usize {
        self.neighbors.len() / self.k
    }

    /// Returns the number of transitions of the member.
    pub(crate) fn nodes(&self) -> usize {
        self.len() - self.dropped.len()
    }

    /// Returns all transitions of the member.
    pub(crate) fn all(&self) -> Bits {
        let len = self.len() as u32;
        Bits::of(self.len(), (0..self.dropped.start).chain(self.dropped.end..len))
    }

    pub(crate) fn has(&self, node: u32) -> bool {
        (node as usize) < self.len() && !self.dropped.contains(&node)
    }

    /// Returns the transition at a relative position in the member, from 0 to 1.
    pub(crate) fn at(&self, share: f64) -> u32 {
        let position = (share * self.nodes() as f64) as u32;
        if position < self.dropped.start { position } else { position + self.dropped.len() as u32 }
    }

    pub(crate) fn row(&self, node: u32) -> &'a [u32] {
        &self.neighbors[node as usize * self.k..][..self.k]
    }

    /// Writes the successors of `node` into `edges`.
    pub(crate) fn edges(&self, node: u32, edges: &mut Vec<u32>) {
        edges.clear();
        let row = self.row(node);
        if self.doubtful.contains(node) {
            let distances = &self.distances[node as usize * self.k..][..self.k];
            let drawn = row.iter().zip(self.weights.possible(distances));
            edges.extend(drawn.filter(|(_, possible)| *possible).map(|(&to, _)| to));
        } else {
            edges.extend_from_slice(row);
        }
    }

    /// Adds transitions that lead to one in `known`, in one sweep through the table. Returns whether it added any.
    pub(super) fn sweep(
        &self,
        direction: Sweep,
        known: &mut Bits,
        monitor: &dyn Monitor,
    ) -> Result<bool, KnnError> {
        monitor.check()?;
        let mut edges = Vec::with_capacity(self.k);
        let words = known.words().len();
        let mut found = false;
        for position in 0..words {
            let word = direction.of(position, words);
            if known.words()[word] == !0 {
                continue;
            }
            for bit in 0..WORD {
                let node = (word * WORD + direction.of(bit, WORD)) as u32;
                if self.has(node) && !known.contains(node) && self.leads_to(node, known, &mut edges)
                {
                    known.insert(node);
                    found = true;
                }
            }
        }
        Ok(found)
    }

    fn leads_to(&self, node: u32, known: &Bits, edges: &mut Vec<u32>) -> bool {
        if self.doubtful.contains(node) {
            self.edges(node, edges);
            edges.iter().any(|&to| known.contains(to))
        } else {
            self.row(node).iter().any(|&to| known.contains(to))
        }
    }

    /// Returns every transition that can be reached from `node`, including `node`.
    pub(crate) fn reached(&self, node: u32, monitor: &dyn Monitor) -> Result<Bits, KnnError> {
        let mut known = Bits::of(self.len(), [node]);
        let mut followed = Bits::new(self.len());
        let mut edges = Vec::with_capacity(self.k);
        // The first sweep goes forwards, as most edges do. Each time that a path goes back needs one more sweep.
        for _ in 0..SWEEPS {
            monitor.check()?;
            let mut found = false;
            for word in 0..known.words().len() {
                loop {
                    let fresh = known.words()[word] & !followed.words()[word];
                    if fresh == 0 {
                        break;
                    }
                    let node = (word * WORD) as u32 + fresh.trailing_zeros();
                    followed.insert(node);
                    found = true;
                    self.edges(node, &mut edges);
                    known.extend(edges.iter().copied());
                }
            }
            if !found {
                return Ok(known);
            }
        }
        let mut open: Vec<u32> = known.iter().filter(|&node| !followed.contains(node)).collect();
        while let Some(node) = open.pop() {
            self.edges(node, &mut edges);
            open.extend(edges.iter().filter(|&&to| known.insert(to)));
        }
        Ok(known)
    }
}

#[cfg(test)]
mod tests {
    use calib_core::Silent;
    use proptest::prelude::*;

    use super::super::shapes::{Order, Shape, chain, shape};

    fn reached(shape: &Shape, start: u32) -> Vec<u32> {
        shape.graph().reached(start, &Silent).expect("not interrupted").iter().collect()
    }

    proptest! {
        #[test]
        fn all_is_found_that_a_node_leads_to(shape in shape(), at in any::<prop::sample::Index>()) {
            let start = *at.get(&shape.nodes());
            prop_assert_eq!(reached(&shape, start), shape.reached(start));
        }
    }

    #[test]
    fn a_path_that_no_sweep_follows_is_followed_to_its_end() {
        // 0 → 999 → 1 → 998 → …: half of the edges lead against the order.
        let shape = Shape::new(&chain(1000), Order::Zigzag, 0..0, |_| false);
        assert_eq!(reached(&shape, 0).len(), 1000);
        assert_eq!(reached(&shape, 500), [500]);
    }
}
