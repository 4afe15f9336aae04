use calib_core::Monitor;
use calib_files::ScratchPlace;

use super::{
    graph::{Graph, Sweep},
    halt::Halt,
    tarjan::{ShrinkingGraph, Verdict, settle},
};
use crate::{KnnError, bits::Bits};

/// Maximum number of sweeps through a table. Then a depth-first search finds the rest.
const SWEEPS: usize = 16;

/// Adds to `known` every transition from which one in `known` can be reached.
///
/// Tables store successors, not predecessors. Most edges lead to the next row, so a sweep against time finds nearly all transitions, and a
/// few sweeps find all. In some logs each sweep finds only a few, as where the log returns by one tooth of a saw at a time. Then one
/// depth-first search finds the rest. So each transition is visited a bounded number of times.
pub(super) fn add_reaching(
    known: &mut Bits,
    graph: &Graph<'_>,
    place: &ScratchPlace,
    monitor: &dyn Monitor,
) -> Result<(), KnnError> {
    let directions = [Sweep::Backwards, Sweep::Forwards].into_iter().cycle();
    for direction in directions.take(SWEEPS) {
        if !graph.sweep(direction, known, monitor)? {
            return Ok(());
        }
    }
    let rest = graph.all().without(known);
    let mut pruned = Pruned { graph, pruned: Bits::new(graph.len()) };
    settle(&rest, known, &mut pruned, place, monitor).map_err(Halt::into_error)
}

/// A graph that prunes the transitions that lead to nothing known: components that are finished without meeting any.
struct Pruned<'a> {
    graph: &'a Graph<'a>,
    pruned: Bits,
}

impl ShrinkingGraph for Pruned<'_> {
    fn edges(&mut self, node: u32, edges: &mut Vec<u32>) -> Result<(), Halt> {
        self.graph.edges(node, edges);
        edges.retain(|&to| !self.pruned.contains(to));
        Ok(())
    }

    fn is_left_out(&self, node: u32) -> bool {
        self.pruned.contains(node)
    }

    fn judge(&mut self, class: &[u32]) -> Result<Verdict, Halt> {
        self.pruned.extend(class.iter().copied());
        Ok(Verdict::LeaveOut)
    }
}

#[cfg(test)]
mod tests {
    use calib_core::Silent;
    use proptest::prelude::*;

    use super::{
        super::shapes::{Order, Shape, chain, shape},
        *,
    };

    fn reaching(shape: &Shape, end: u32) -> Vec<u32> {
        let graph = shape.graph();
        let mut known = Bits::of(graph.len(), [end]);
        add_reaching(&mut known, &graph, &ScratchPlace::Memory, &Silent).expect("not interrupted");
        known.iter().collect()
    }

    proptest! {
        #[test]
        fn all_is_found_that_leads_to_a_node(shape in shape(), at in any::<prop::sample::Index>()) {
            let end = *at.get(&shape.nodes());
            prop_assert_eq!(reaching(&shape, end), shape.reaching(end));
        }
    }

    #[test]
    fn a_path_that_no_sweep_follows_is_followed_to_its_start() {
        // 0 → 999 → 1 → 998 → …: half of the edges lead against the order.
        let shape = Shape::new(&chain(1000), Order::Zigzag, 0..0, |_| false);
        assert_eq!(reaching(&shape, 500).len(), 1000);
        assert_eq!(reaching(&shape, 0), [0]);
    }
}
