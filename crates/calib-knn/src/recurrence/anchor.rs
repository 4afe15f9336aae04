use calib_core::Monitor;
use calib_files::ScratchPlace;

use super::{graph::Graph, reaching::add_reaching};
use crate::{KnnError, bits::Bits};

/// Transitions from which the large component is looked for, at most.
const PROBES: u32 = 16;

/// A transition by which the graph of a member is taken apart: what leads to it is mostly found by a few sweeps through the
/// table, and closed classes that it does not lie in are among what does not.
#[derive(Clone, Debug)]
pub(super) struct Anchor {
    pub(super) node: u32,
    /// What leads to it.
    pub(super) reaching: Bits,
    /// Transitions that lead to it and that it leads to: the size of its strongly connected component.
    pub(super) component: usize,
}

impl Anchor {
    /// One in a component of `enough` transitions, or else the best of some that are spread over the member.
    pub(super) fn find(
        graph: &Graph<'_>,
        enough: usize,
        place: &ScratchPlace,
        monitor: &dyn Monitor,
    ) -> Result<Self, KnnError> {
        let mut best: Option<Self> = None;
        // 1/2, 1/4, 3/4, 1/8, … (van der Corput's sequence): more and more evenly spread.
        let shares = (1..=PROBES).map(|n| f64::from(n.reverse_bits()) / 2_f64.powi(32));
        for share in shares {
            monitor.check()?;
            // Something leads to a neighbour.
            let node = graph.row(graph.at(share))[0];
            let anchor = Self::new(graph, node, place, monitor)?;
            if best.as_ref().is_none_or(|best| best.component < anchor.component) {
                best = Some(anchor);
            }
            if best.as_ref().is_some_and(|best| best.component >= enough) {
                break;
            }
        }
        Ok(best.unwrap_or_else(|| unreachable!("there is a first probe")))
    }

    /// The same anchor in a graph that has changed, if its component still has `enough` transitions.
    pub(super) fn in_graph(
        self,
        graph: &Graph<'_>,
        enough: usize,
        place: &ScratchPlace,
        monitor: &dyn Monitor,
    ) -> Result<Self, KnnError> {
        if self.component >= enough {
            // From the start: where tables hold other distances than are searched by, what comes in for a neighbour can be nearer, and
            // another one is never drawn any more.
            let anchor = Self::new(graph, self.node, place, monitor)?;
            if anchor.component >= enough {
                return Ok(anchor);
            }
        }
        Self::find(graph, enough, place, monitor)
    }

    fn new(
        graph: &Graph<'_>,
        node: u32,
        place: &ScratchPlace,
        monitor: &dyn Monitor,
    ) -> Result<Self, KnnError> {
        let mut reaching = Bits::of(graph.len(), [node]);
        add_reaching(&mut reaching, graph, place, monitor)?;
        let component = graph.reached(node, monitor)?.common(&reaching);
        Ok(Self { node, reaching, component })
    }
}
