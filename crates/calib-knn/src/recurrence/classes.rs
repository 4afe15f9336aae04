use std::cmp::Reverse;

use calib_core::Monitor;
use calib_files::ScratchPlace;

use super::{
    anchor::Anchor,
    graph::Graph,
    halt::Halt,
    tarjan::{ShrinkingGraph, Verdict, settle},
};
use crate::{KnnError, bits::Bits};

/// A closed class of fewer than one in `SHARE` of the candidates is a trap, and no more candidates than that may be lost (our choice). A
/// rollout should be able to visit most of its member. A tenth of a log is a regime of the plant rather than a dead end.
pub(super) const SHARE: usize = 10;

/// Closed classes of a graph.
#[derive(Debug)]
pub(super) struct Classes {
    /// Number of transitions of each class, the largest first.
    pub(super) sizes: Vec<usize>,
    /// The transitions where rollouts end: those of all traps, or of all classes if there is no trap.
    pub(super) ends: Bits,
}

impl Classes {
    /// Returns the number of classes with fewer than `enough` transitions.
    pub(super) fn traps(&self, enough: usize) -> usize {
        self.sizes.iter().filter(|&&size| size < enough).count()
    }
}

/// Returns the closed classes of a graph. Those of at least `enough` transitions are not traps.
pub(super) fn closed(
    graph: &Graph<'_>,
    anchor: &Anchor,
    enough: usize,
    place: &ScratchPlace,
    monitor: &dyn Monitor,
) -> Result<Classes, KnnError> {
    let traps = Bits::new(graph.len());
    let others = Bits::new(graph.len());
    let mut listing = Listing { graph, enough, sizes: Vec::new(), traps, others };
    let mut settled = anchor.reaching.clone();
    let nodes = graph.all().without(&settled);
    settle(&nodes, &mut settled, &mut listing, place, monitor).map_err(Halt::into_error)?;
    // Every rollout can reach a closed class. The transitions that can be reached from the anchor form
    // one, unless they contain another.
    let reached = graph.reached(anchor.node, monitor)?;
    if reached.common(&listing.traps) + reached.common(&listing.others) == 0 {
        listing.add(reached.count(), reached.iter());
    }
    Ok(listing.into_classes())
}

/// A graph without exclusions, which collects its closed classes.
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

    fn into_classes(self) -> Classes {
        let Self { mut sizes, traps, others, .. } = self;
        assert!(
            !sizes.is_empty(),
            "from every transition of a member a rollout goes on, and comes to a closed class"
        );
        sizes.sort_unstable_by_key(|&size| Reverse(size));
        Classes { sizes, ends: if traps.is_empty() { others } else { traps } }
    }
}

impl ShrinkingGraph for Listing<'_> {
    fn edges(&mut self, node: u32, edges: &mut Vec<u32>) -> Result<(), Halt> {
        self.graph.edges(node, edges);
        Ok(())
    }

    fn is_left_out(&self, _node: u32) -> bool {
        false
    }

    fn judge(&mut self, class: &[u32]) -> Result<Verdict, Halt> {
        self.add(class.len(), class.iter().copied());
        Ok(Verdict::Keep)
    }
}

#[cfg(test)]
mod tests {
    use calib_core::Silent;
    use proptest::prelude::*;

    use super::{
        super::shapes::{Order, Shape, chain, rings, saw, shape},
        *,
    };

    fn check(shape: &Shape, enough: usize) -> Result<(), TestCaseError> {
        let graph = shape.graph();
        let anchor = Anchor::find(&graph, enough, &ScratchPlace::Memory, &Silent);
        let anchor = anchor.expect("not interrupted");
        let found = closed(&graph, &anchor, enough, &ScratchPlace::Memory, &Silent);
        let found = found.expect("not interrupted");
        let expected = shape.closed();
        let sizes: Vec<usize> = expected.iter().map(Vec::len).collect();
        prop_assert_eq!(&found.sizes, &sizes);
        let traps = sizes.iter().filter(|&&size| size < enough).count();
        prop_assert_eq!(found.traps(enough), traps);
        let ends = expected.iter().filter(|class| traps == 0 || class.len() < enough);
        let ends = Bits::of(graph.len(), ends.flatten().copied());
        prop_assert_eq!(found.ends, ends);
        let reaching = shape.reaching(anchor.node);
        prop_assert_eq!(anchor.reaching.iter().collect::<Vec<_>>(), reaching.clone());
        let back = shape.reached(anchor.node).into_iter().filter(|node| reaching.contains(node));
        prop_assert_eq!(anchor.component, back.count());
        Ok(())
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(1000))]

        #[test]
        fn they_are_the_components_that_nothing_leads_out_of(shape in shape(), share in 0_usize..12) {
            // From no trap at all to only traps.
            check(&shape, shape.nodes().len() * share / 10)?;
        }
    }

    #[test]
    fn they_are_found_where_each_sweep_finds_a_little() {
        let orders = [Order::Ascending, Order::Descending, Order::Zigzag, Order::Shuffled(5)];
        let edges = [saw(300, 30), rings(200, 7, true), rings(200, 7, false), chain(3000)];
        for (edges, order) in edges.iter().flat_map(|edges| orders.map(|order| (edges, order))) {
            let shape = Shape::new(edges, order, 500..1300, |_| false);
            check(&shape, edges.len().div_ceil(10)).unwrap_or_else(|error| panic!("{error}"));
        }
    }
}
