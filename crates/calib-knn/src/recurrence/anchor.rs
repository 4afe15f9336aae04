use calib_core::Monitor;
use calib_files::ScratchPlace;

use super::{graph::Graph, reaching::add_reaching};
use crate::{KnnError, bits::Bits};

/// Maximum number of transitions that are probed in search of a large component.
const PROBES: u32 = 16;

/// A transition that splits the graph of a member. A few sweeps through the table find most of the transitions that lead to it. Every
/// closed class that does not contain it lies among the others.
#[derive(Clone, Debug)]
pub(super) struct Anchor {
    pub(super) node: u32,
    /// The transitions that lead to the anchor.
    pub(super) reaching: Bits,
    /// Size of its strongly connected component: the transitions that lead to it and can be reached from it.
    pub(super) component: usize,
}

impl Anchor {
    /// Finds an anchor in a component of at least `enough` transitions, or else the probe with the largest component. Probes are
    /// spread over the member.
    pub(super) fn find(
        graph: &Graph<'_>,
        enough: usize,
        place: &ScratchPlace,
        monitor: &dyn Monitor,
    ) -> Result<Self, KnnError> {
        let mut best: Option<Self> = None;
        // 1/2, 1/4, 3/4, 1/8, … (van der Corput's sequence) cover the member more and more evenly.
        let shares = (1..=PROBES).map(|n| f64::from(n.reverse_bits()) / 2_f64.powi(32));
        for share in shares {
            monitor.check()?;
            // A neighbour has at least one transition that leads to it.
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

    /// Returns the same anchor in a graph that has changed, if its component still has `enough` transitions. Otherwise finds another
    /// one.
    pub(super) fn in_graph(
        self,
        graph: &Graph<'_>,
        enough: usize,
        place: &ScratchPlace,
        monitor: &dyn Monitor,
    ) -> Result<Self, KnnError> {
        if self.component >= enough {
            // Computed from the start: the old result may be invalid. Where tables store other distances than the search uses, a new
            // neighbour can be nearer, and another one is then never drawn.
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
