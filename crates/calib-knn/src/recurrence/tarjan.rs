use calib_core::Monitor;
use calib_files::{Scratch, ScratchPlace};

use super::Halt;
use crate::bits::Bits;

/// Transitions between two looks at the monitor.
const LOOK: u32 = 1 << 12;

/// What becomes of a closed class.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Verdict {
    /// It stays, and whatever leads to it is settled.
    Keep,
    /// It is left out: nothing leads to it any more.
    LeaveOut,
    /// One of its transitions leads elsewhere now.
    AddExit,
}

/// A graph whose edges change as closed classes are left out of it.
///
/// What is left out must not take an edge away that leads elsewhere, nor change a row that does not lead to it; and what leads out of a
/// class must not change a row outside.
pub(super) trait ShrinkingGraph {
    /// Put what `node` leads to now into `edges`; nothing that is left out.
    fn edges(&mut self, node: u32, edges: &mut Vec<u32>) -> Result<(), Halt>;

    fn is_left_out(&self, node: u32) -> bool;

    /// Decide on a closed class; what is to be left out is left out from here on.
    fn judge(&mut self, class: &[u32]) -> Result<Verdict, Halt>;
}

/// One transition on the path of the search.
struct Frame {
    node: u32,
    /// When it was found.
    found: u32,
    /// Edges that were followed, of those that there were after so many verdicts.
    followed: u32,
    verdicts: u32,
}

/// Show every closed class that lies among `nodes` to the graph, as the graph becomes without those that it leaves out.
///
/// `settled` are transitions that lead to a class that stays, whatever is left out; they gain those of the others that do. This is the
/// search for strongly connected components of Tarjan (1972), without recursion, with two differences. A component that is
/// finished without having met anything settled is closed: if it is left out, the transitions on the path go on with
/// what they lead to instead, so that a chain of traps, each of which opens the next one, is one search; if it is led out of, it is
/// visited anew. And as soon as anything settled is met, all that is under way leads there, and is settled too, so that each
/// transition is visited once, but for those that are led out of something.
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
    /// Number of nodes before each word of them.
    before: Vec<u32>,
    /// The earliest transition under way that each node is known to lead to, by when it was found; 0 of nodes that were not found.
    low: Scratch<u32>,
    found: u32,
    /// Closed classes that were left out or led out of, each of which may have changed where transitions lead.
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

    /// Visit all that `root` leads to, until it is settled.
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

    /// Follow the edges of the last transition of the path until one leads to something new.
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
                // Looked at again when it is done: it may lead back.
                self.note(number as u32);
                return Next::New(to);
            }
            self.low[slot] = self.low[slot].min(low);
        }
        Next::Done
    }

    /// Note that the last transition of the path has followed so many edges.
    fn note(&mut self, followed: u32) {
        if let Some(frame) = self.path.last_mut() {
            (frame.followed, frame.verdicts) = (followed, self.verdicts);
        }
    }

    /// Take the last transition off the path.
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

/// Where a search goes on.
enum Next {
    Settled,
    New(u32),
    Done,
}
