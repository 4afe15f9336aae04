//! The path that belongs to a distance.
//!
//! Only the rows between strips are kept, at the borders of up to eight groups of strips; the
//! group the path runs through is then swept again and split in turn, until a group is one strip,
//! whose cells are kept and walked backwards.

use std::ops::Range;

use crate::kernel::boundary::Boundary;
use crate::kernel::dispatch::InstructionSet;
use crate::kernel::lanes::Pack;
use crate::kernel::strip::Strip;
use crate::kernel::sweep::{Purpose, Sweep, entry};
use crate::{Branch, Series, Settings, StepPattern};

/// Parts a group of strips is split into.
const PARTS: usize = 8;

/// Cells of the best path that ends in the last query sample and reference sample `end`.
pub(crate) fn trace(
    set: InstructionSet,
    pattern: &StepPattern,
    settings: Settings,
    query: Series<'_>,
    reference: Series<'_>,
    end: usize,
) -> Vec<(usize, usize)> {
    let patterns = std::slice::from_ref(pattern);
    let sweep = Sweep::new(set, patterns, settings, query, reference, Purpose::Path);
    let first = entry(settings, sweep.patterns[0].halo, reference.len());
    let strips = 0..sweep.strips();
    let mut tracer = Tracer {
        branches: pattern.branches(),
        sweep,
        at: Some((query.len() - 1, end)),
        backwards: Vec::new(),
    };
    tracer.descend(strips, first);
    tracer.backwards.reverse();
    tracer.backwards
}

struct Tracer<'a> {
    branches: &'a [Branch],
    sweep: Sweep<'a>,
    /// The cell still to be explained; `None` once the path has reached its begin.
    at: Option<(usize, usize)>,
    backwards: Vec<(usize, usize)>,
}

/// Every cell of one strip.
struct Kept {
    strip: Strip,
    /// Time of the first column.
    start: usize,
    /// `[times, height]` packs.
    cells: Vec<Pack>,
    above: Boundary,
}

impl Kept {
    /// Cumulated distance of cell (i, j) of the strip, or of the rows just above it.
    fn cumulated(&self, i: usize, j: usize) -> f64 {
        if i < self.strip.first {
            return self.above.above(j)[self.strip.first - 1 - i];
        }
        let (lane, row) = self.strip.place(i);
        let Some(time) = (j + lane).checked_sub(self.start) else {
            return f64::INFINITY;
        };
        self.cells[time * self.strip.height + row].0[lane]
    }
}

impl Tracer<'_> {
    /// Walks the path back to the first row of `strips`; `above` are the rows before them.
    fn descend(&mut self, strips: Range<usize>, above: Boundary) {
        if strips.len() == 1 {
            return self.walk(strips.start, above);
        }
        let Some((i, j)) = self.at else { return };
        let size = strips.len().div_ceil(PARTS);
        let part_of = |number: usize| (number - strips.start) / size;
        let last = part_of(self.sweep.strip_of(i));
        let mut borders = vec![above.clone()];
        self.sweep.patterns[0].input = above;
        for part in 0..last {
            for number in (0..size).map(|n| strips.start + part * size + n) {
                self.sweep.run(number, j + 1, |_, _| {});
            }
            borders.push(self.sweep.patterns[0].input.clone());
        }
        for (part, border) in borders.into_iter().enumerate().rev() {
            let first = strips.start + part * size;
            let inside = self.at.is_some_and(|(i, _)| self.sweep.strip_of(i) >= first);
            if inside {
                self.descend(first..(first + size).min(strips.end), border);
            }
        }
    }

    /// Walks the path back through one strip.
    fn walk(&mut self, number: usize, above: Boundary) {
        let Some((_, j)) = self.at else { return };
        let strip = self.sweep.strip(number);
        let halo = self.sweep.patterns[0].halo;
        self.sweep.patterns[0].input = above.clone();
        let (mut start, mut cells) = (None, Vec::new());
        self.sweep.run(number, j + 1, |time, tracks| {
            start.get_or_insert(time);
            cells.extend_from_slice(&tracks[0].cumulated[0][halo..]);
        });
        let kept = Kept { strip, start: start.unwrap_or(0), cells, above };
        while let Some((i, j)) = self.at.filter(|(i, _)| *i >= strip.first) {
            self.step_back(&kept, i, j);
        }
    }

    /// Explains cell (i, j): the first branch that attains its cumulated distance.
    fn step_back(&mut self, kept: &Kept, i: usize, j: usize) {
        let open_begin = self.sweep.settings.ends.open_begin();
        let target = kept.cumulated(i, j);
        for branch in self.branches {
            let (a, b) = branch.origin();
            // With an open begin there is a virtual row of zeros before the first.
            let virtual_row = open_begin && i + 1 == a;
            if j < b || (i < a && !virtual_row) {
                continue;
            }
            let origin = if virtual_row { 0.0 } else { kept.cumulated(i - a, j - b) };
            let cost = branch
                .cells()
                .map(|cell| cell.weight * self.local(i, cell.query, j - cell.reference))
                .reduce(|cost, paid| cost + paid);
            if cost.is_some_and(|cost| origin + cost == target) && target < f64::INFINITY {
                let cells = branch.cells().filter(|cell| cell.query <= i);
                let mut cells: Vec<_> =
                    cells.map(|cell| (i - cell.query, j - cell.reference)).collect();
                cells.reverse();
                self.backwards.extend(cells);
                self.at = if virtual_row { None } else { Some((i - a, j - b)) };
                return;
            }
        }
        // No branch leads here: this is the cell where paths start.
        self.backwards.push((i, j));
        self.at = None;
    }

    fn local(&self, i: usize, up: usize, j: usize) -> f64 {
        let Some(i) = i.checked_sub(up) else { return 0.0 };
        let (x, y) = (self.sweep.query.sample(i), self.sweep.reference.sample(j));
        self.sweep.settings.local_distance.between(x, y)
    }
}
