use calib_core::Monitor;
use calib_files::ScratchPlace;

use super::{
    Halt,
    graph::{Graph, Sweep},
    tarjan::{ShrinkingGraph, Verdict, settle},
};
use crate::{KnnError, bits::Bits};

/// Sweeps through a table after which what is still missing is looked for by depth.
const SWEEPS: usize = 16;

/// Add to `known` every transition from which one of `known` can be reached.
///
/// Tables say what a transition leads to, not what leads to it. Most edges lead on by a row, so that a sweep against time finds nearly all,
/// and a few sweeps everything. Where each of them finds a little (a log that comes back by small steps: a tooth of a saw each), the
/// rest is searched by depth, once, so that the time is that of a bounded number of visits to each transition.
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

/// A graph without what is known to lead to nothing known: a component that is finished without having met any.
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
        // 0 → 999 → 1 → 998 → …: against the order half of the time.
        let shape = Shape::new(&chain(1000), Order::Zigzag, 0..0, |_| false);
        assert_eq!(reaching(&shape, 500).len(), 1000);
        assert_eq!(reaching(&shape, 0), [0]);
    }
}
