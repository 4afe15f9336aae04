use std::cmp::Reverse;

use calib_core::Monitor;
use calib_files::ScratchPlace;

use super::{
    Halt,
    graph::Graph,
    settle::{Shrinking, Verdict, settle},
};
use crate::{KnnError, bits::Bits, index::going_on};

/// Transitions from which the large component is looked for, at most.
const PROBES: u32 = 16;

/// A transition by which the graph of a member is taken apart: what leads to it can be told by a few sweeps through the table, and
/// closed classes that it does not lie in are among what does not.
#[derive(Clone, Debug)]
pub(super) struct Anchor {
    node: u32,
    /// What leads to it.
    pub(super) reaching: Bits,
    /// Transitions that lead to it and that it leads to: the size of its strongly connected component, at least.
    pub(super) component: usize,
}

impl Anchor {
    /// One in a component of `enough` transitions, or else the best of some that are spread over the member.
    pub(super) fn find(
        graph: &Graph<'_>,
        enough: usize,
        monitor: &dyn Monitor,
    ) -> Result<Self, KnnError> {
        let mut best: Option<Self> = None;
        // 1/2, 1/4, 3/4, 1/8, … (van der Corput's sequence): more and more evenly spread.
        let shares = (1..=PROBES).map(|n| f64::from(n.reverse_bits()) / 2_f64.powi(32));
        for share in shares {
            going_on(monitor)?;
            // Something leads to a neighbour.
            let node = graph.row(graph.at(share))[0];
            let anchor = Self::new(graph, node, monitor)?;
            if best.as_ref().is_none_or(|best| best.component < anchor.component) {
                best = Some(anchor);
            }
            if best.as_ref().is_some_and(|best| best.component >= enough) {
                break;
            }
        }
        Ok(best.unwrap_or_else(|| unreachable!("there is a first probe")))
    }

    /// The same anchor of a graph in which more leads to it.
    pub(super) fn in_graph(
        mut self,
        graph: &Graph<'_>,
        enough: usize,
        monitor: &dyn Monitor,
    ) -> Result<Self, KnnError> {
        if self.component < enough {
            return Self::find(graph, enough, monitor);
        }
        graph.reaching(&mut self.reaching, monitor)?;
        Ok(self)
    }

    fn new(graph: &Graph<'_>, node: u32, monitor: &dyn Monitor) -> Result<Self, KnnError> {
        let mut reaching = Bits::of(graph.len(), [node]);
        graph.reaching(&mut reaching, monitor)?;
        let component = graph.reached(node, monitor)?.common(&reaching);
        Ok(Self { node, reaching, component })
    }
}

/// Closed classes of a graph.
#[derive(Debug)]
pub(super) struct Classes {
    /// Number of transitions of each, the largest first.
    pub(super) sizes: Vec<usize>,
    /// The transitions of those that are traps, if any is, or else of all: where walks end.
    pub(super) ends: Bits,
}

impl Classes {
    /// How many have fewer than `enough` transitions.
    pub(super) fn traps(&self, enough: usize) -> usize {
        self.sizes.iter().filter(|&&size| size < enough).count()
    }
}

/// The closed classes of a graph; those of `enough` transitions are no traps.
pub(super) fn closed(
    graph: &Graph<'_>,
    anchor: &Anchor,
    enough: usize,
    place: &ScratchPlace,
    monitor: &dyn Monitor,
) -> Result<Classes, KnnError> {
    let (traps, others) = (Bits::new(graph.len()), Bits::new(graph.len()));
    let mut listing = Listing { graph, enough, sizes: Vec::new(), traps, others };
    let mut settled = anchor.reaching.clone();
    let nodes = graph.all().without(&settled);
    settle(&nodes, &mut settled, &mut listing, place, monitor).map_err(Halt::into_error)?;
    let reached = graph.reached(anchor.node, monitor)?;
    let size = reached.count();
    if reached.common(&anchor.reaching) == size {
        listing.add(size, reached.iter());
    }
    let Listing { mut sizes, traps, others, .. } = listing;
    sizes.sort_unstable_by_key(|&size| Reverse(size));
    Ok(Classes { sizes, ends: if traps.is_empty() { others } else { traps } })
}

/// A graph that nothing is left out of.
struct Listing<'a> {
    graph: &'a Graph<'a>,
    enough: usize,
    sizes: Vec<usize>,
    traps: Bits,
    others: Bits,
}

impl Listing<'_> {
    fn add(&mut self, size: usize, class: impl Iterator<Item = u32>) {
        self.sizes.push(size);
        let ends = if size < self.enough { &mut self.traps } else { &mut self.others };
        ends.extend(class);
    }
}

impl Shrinking for Listing<'_> {
    fn edges(&mut self, node: u32, edges: &mut Vec<u32>) -> Result<(), Halt> {
        self.graph.edges(node, edges);
        Ok(())
    }

    fn is_left_out(&self, _node: u32) -> bool {
        false
    }

    fn judge(&mut self, class: &[u32]) -> Result<Verdict, Halt> {
        self.add(class.len(), class.iter().copied());
        Ok(Verdict::Keeps)
    }
}
