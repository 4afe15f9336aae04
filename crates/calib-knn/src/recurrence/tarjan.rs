use calib_core::Monitor;
use calib_files::{Scratch, ScratchPlace};

use super::halt::Halt;
use crate::bits::Bits;

/// Transitions between two checks for an interruption.
const LOOK: u32 = 1 << 12;

/// The decision about a closed class.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Verdict {
    /// The class stays, and every transition that leads to it is settled.
    Keep,
    /// The class is left out: nothing leads to it any more.
    LeaveOut,
    /// One of its transitions now leads elsewhere.
    AddExit,
}

/// A graph whose edges change while closed classes are left out of it.
///
/// Leaving a class out must not remove an edge that leads elsewhere, nor change a row that does not lead to the class. Giving a class
/// an exit must not change a row outside the class.
pub(super) trait ShrinkingGraph {
    /// Writes the current successors of `node` into `edges`, without those that are left out.
    fn edges(&mut self, node: u32, edges: &mut Vec<u32>) -> Result<(), Halt>;

    fn is_left_out(&self, node: u32) -> bool;

    /// Decides about a closed class. If the class is left out, this takes effect at once.
    fn judge(&mut self, class: &[u32]) -> Result<Verdict, Halt>;
}

/// One transition on the path of the search.
struct Frame {
    node: u32,
    /// The order in which it was found.
    found: u32,
    /// Number of edges that were followed, out of those that existed after `verdicts` verdicts.
    followed: u32,
    verdicts: u32,
}

/// Passes every closed class among `nodes` to the graph for a decision. The graph changes with each decision.
///
/// `settled` contains transitions that lead to a permanent class, whatever is left out; the search adds others that do. The method is
/// Tarjan's search for strongly connected components (1972), without recursion, with two differences.
///
/// First, a component that is finished without meeting a settled transition is closed. If it is left out, the transitions on the path
/// continue with their new successors. So a chain of traps, each of which opens the next, takes one search. If the component is given
/// an exit, it is visited again.
///
/// Second, as soon as the search meets a settled transition, all open transitions lead there, and become settled too. So each
/// transition is visited once, except those of components that are given an exit.
pub(super) fn settle(
    nodes: &Bits,
    settled: &mut Bits,
    graph: &mut impl ShrinkingGraph,
    place: &ScratchPlace,
    monitor: &dyn Monitor,
) -> Result<(), Halt> {
    let mut search = Search::new(nodes, place)?;
    for root in nodes.iter() {
        while !settled.contains(root) && !graph.is_left_out(root) && search.low(root) == 0 {
            monitor.check()?;
            search.from(root, settled, graph, monitor)?;
        }
    }
    Ok(())
}

struct Search<'a> {
    nodes: &'a Bits,
    /// Number of nodes before each word of `nodes`.
    before: Vec<u32>,
    /// For each node, the number of the earliest open transition that it is known to lead to; 0 for nodes that were not found.
    /// Transitions are numbered in the order in which they were found.
    low: Scratch<u32>,
    found: u32,
    /// Number of closed classes that were left out or given an exit. Each may have changed edges.
    verdicts: u32,
    path: Vec<Frame>,
    /// Nodes that were found, and are neither settled nor left out.
    open: Vec<u32>,
    edges: Vec<u32>,
}

impl<'a> Search<'a> {
    fn new(nodes: &'a Bits, place: &ScratchPlace) -> Result<Self, Halt> {
        let mut sum = 0;
        let before = nodes.words().iter().map(|word| {
            let start = sum;
            sum += word.count_ones();
            start
        });
        let before = before.collect();
        let low = Scratch::zeroed(sum as usize, place)?;
        let path = Vec::new();
        let open = Vec::new();
        let edges = Vec::new();
        Ok(Self { nodes, before, low, found: 0, verdicts: 0, path, open, edges })
    }

    fn slot(&self, node: u32) -> usize {
        let word = node as usize / 64;
        let bit = node % 64;
        let below = self.nodes.words()[word] & ((1 << bit) - 1);
        (self.before[word] + below.count_ones()) as usize
    }

    fn low(&self, node: u32) -> u32 {
        self.low[self.slot(node)]
    }

    fn find(&mut self, node: u32) {
        self.found += 1;
        let slot = self.slot(node);
        self.low[slot] = self.found;
        self.open.push(node);
        let verdicts = self.verdicts;
        self.path.push(Frame { node, found: self.found, followed: 0, verdicts });
    }

    /// Visits all transitions that `root` leads to, until it is settled.
    fn from(
        &mut self,
        root: u32,
        settled: &mut Bits,
        graph: &mut impl ShrinkingGraph,
        monitor: &dyn Monitor,
    ) -> Result<(), Halt> {
        self.find(root);
        while let Some(frame) = self.path.last() {
            let node = frame.node;
            let mut edges = std::mem::take(&mut self.edges);
            graph.edges(node, &mut edges)?;
            let next = self.follow(&edges, settled);
            self.edges = edges;
            match next {
                Next::Settled => {
                    settled.extend(self.open.drain(..));
                    self.path.clear();
                }
                Next::New(node) => {
                    self.find(node);
                    if self.found.is_multiple_of(LOOK) {
                        monitor.check()?;
                    }
                }
                Next::Done => self.finish(settled, graph)?,
            }
        }
        Ok(())
    }

    /// Follows the edges of the last transition of the path until one leads to a new node.
    fn follow(&mut self, edges: &[u32], settled: &Bits) -> Next {
        let Some(&Frame { node, followed, verdicts, .. }) = self.path.last() else {
            return Next::Done;
        };
        let slot = self.slot(node);
        let start = if verdicts == self.verdicts { followed } else { 0 };
        for (number, &to) in edges.iter().enumerate().skip(start as usize) {
            if settled.contains(to) {
                return Next::Settled;
            }
            let low = self.low(to);
            if low == 0 {
                // This edge is followed again when the new node is done, because that may lead back.
                self.note(number as u32);
                return Next::New(to);
            }
            self.low[slot] = self.low[slot].min(low);
        }
        Next::Done
    }

    /// Records how many edges the last transition of the path has followed.
    fn note(&mut self, followed: u32) {
        if let Some(frame) = self.path.last_mut() {
            (frame.followed, frame.verdicts) = (followed, self.verdicts);
        }
    }

    /// Removes the last transition from the path.
    fn finish(&mut self, settled: &mut Bits, graph: &mut impl ShrinkingGraph) -> Result<(), Halt> {
        let Some(Frame { node, found, .. }) = self.path.pop() else { return Ok(()) };
        if self.low(node) < found {
            return Ok(());
        }
        let start = self.open.iter().rposition(|&open| open == node).unwrap_or(0);
        match graph.judge(&self.open[start..])? {
            Verdict::Keep => settled.extend(self.open.drain(start..)),
            Verdict::LeaveOut => {
                self.open.truncate(start);
                self.verdicts += 1;
            }
            Verdict::AddExit => {
                for node in self.open.split_off(start) {
                    let slot = self.slot(node);
                    self.low[slot] = 0;
                }
                self.verdicts += 1;
            }
        }
        Ok(())
    }
}

/// The next action of a search.
enum Next {
    Settled,
    New(u32),
    Done,
}
