//! The path of a distance.
//!
//! The first sweep stores the rows between some of the strips. Then the path is followed backwards.
//! Each group of strips between two stored rows is swept again and split, until a group is one
//! strip. Of a strip, the cells of a few columns are stored and followed backwards. If the path is
//! still inside the strip at the leftmost column, the strip is swept again up to there. So memory
//! grows with (N + M) log N, and no matrix is ever stored.

use std::ops::Range;

use crate::kernel::boundary::Boundary;
use crate::kernel::dispatch::InstructionSet;
use crate::kernel::lanes::{LANES, Pack};
use crate::kernel::strip::Strip;
use crate::kernel::sweep::{Purpose, Stop, Sweep, Track, entry};
use crate::{Alignment, Branch, Series, Settings, StepPattern};

/// Maximum number of parts into which a group of strips is split.
const MOST_PARTS: usize = 16;

/// The result of a path search.
pub(crate) enum Aligned {
    Found(Alignment),
    NoPath,
    /// There is not enough memory for a path of this many samples.
    NoRoom {
        cells: usize,
    },
    /// The caller stopped the computation.
    Stopped,
}

/// Returns the best path of a checked pair.
pub(crate) fn align(
    set: InstructionSet,
    pattern: &StepPattern,
    settings: Settings,
    query: Series<'_>,
    reference: Series<'_>,
    stop: Stop<'_>,
) -> Aligned {
    let patterns = std::slice::from_ref(pattern);
    // Memory is reserved before the long computation, so that a failure is reported early.
    let mut backwards = Vec::new();
    let longest = longest(query.len(), reference.len());
    if backwards.try_reserve_exact(longest).is_err() {
        return Aligned::NoRoom { cells: longest };
    }
    let mut sweep = Sweep::new(set, patterns, settings, query, reference, Purpose::Path, stop);
    let strips = sweep.strips();
    sweep.patterns[0].input = entry(settings, sweep.patterns[0].halo, reference.len());
    let mut borders = Borders::new(0..strips, sweep.patterns[0].input.clone());
    for number in 0..strips - 1 {
        sweep.run(number, reference.len(), |_, _| {});
        borders.offer(number, &sweep.patterns[0].input);
    }
    let distance = crate::distance::finish(&mut sweep, patterns).pop().flatten();
    if sweep.is_stopped {
        return Aligned::Stopped;
    }
    let Some(distance) = distance else { return Aligned::NoPath };
    let mut tracer = Tracer {
        branches: pattern.branches(),
        reach: pattern.reach(),
        sweep,
        at: Some((query.len() - 1, distance.end)),
        backwards,
        cells: Vec::new(),
    };
    tracer.through(borders);
    if tracer.sweep.is_stopped {
        return Aligned::Stopped;
    }
    tracer.backwards.reverse();
    let path = tracer.backwards;
    Aligned::Found(Alignment { distance, path })
}

/// Returns the maximum length of a path, in samples.
fn longest(query: usize, reference: usize) -> usize {
    query.saturating_add(reference)
}

/// Returns the maximum memory of a path search for these lengths, in bytes: the path and the rows
/// that are stored.
pub(crate) fn bytes(pattern: &StepPattern, query: usize, reference: usize) -> u64 {
    let path = size_of::<(usize, usize)>() as u64 * longest(query, reference) as u64;
    // Strips are divided into parts, those into smaller parts, and so on.
    let levels = 2 + u64::from((query as u64).max(1).ilog(MOST_PARTS as u64));
    let border = 8_u64.saturating_mul(pattern.reach().0 as u64).saturating_mul(reference as u64);
    let borders = border.saturating_mul(levels * (MOST_PARTS as u64 + 2));
    path.saturating_add(borders)
}

/// The rows above every part of a group of strips.
struct Borders {
    strips: Range<usize>,
    /// Strips per part; the last part may have fewer.
    size: usize,
    above: Vec<Boundary>,
}

impl Borders {
    fn new(strips: Range<usize>, above: Boundary) -> Self {
        let parts = strips.len().isqrt().clamp(2, MOST_PARTS);
        Self { size: strips.len().div_ceil(parts), above: vec![above], strips }
    }

    /// Stores the row below strip `number`, if a part begins there.
    fn offer(&mut self, number: usize, below: &Boundary) {
        if (number + 1 - self.strips.start).is_multiple_of(self.size) {
            self.above.push(below.clone());
        }
    }
}

/// The cells of one strip in its last columns.
struct Kept {
    strip: Strip,
    /// Times (columns of lane 0) that are stored.
    times: Range<usize>,
    /// Time of the first column of the strip. There are no paths before it.
    start: usize,
    /// `[capacity, height]` packs, time t in row t modulo the capacity.
    cells: Vec<Pack>,
    capacity: usize,
}

impl Kept {
    /// Creates an empty store. `cells` is memory of an earlier strip with the same height, for
    /// reuse.
    fn new(strip: Strip, reach: usize, mut cells: Vec<Pack>) -> Self {
        // Four times as wide as high. Most paths leave the strip within that width.
        let capacity = (4 * LANES * strip.height).max(2 * (LANES + reach));
        cells.resize(capacity * strip.height, Pack::splat(f64::INFINITY));
        Self { strip, times: 0..0, start: 0, cells, capacity }
    }

    fn keep(&mut self, time: usize, track: &Track) {
        if self.times.is_empty() {
            self.times = time..time;
            self.start = time;
        }
        let height = self.strip.height;
        let row = time % self.capacity * height;
        self.cells[row..row + height].copy_from_slice(&track.cumulated[0][track.halo..]);
        self.times.end = time + 1;
        self.times.start = self.times.start.max(self.times.end.saturating_sub(self.capacity));
    }

    /// Whether all cells are stored from which a branch into row `i`, column `j` may come.
    fn covers(&self, i: usize, j: usize, reach: (usize, usize)) -> bool {
        let first = i.saturating_sub(reach.0).max(self.strip.first);
        let earliest = j.saturating_sub(reach.1) + self.strip.place(first).0;
        earliest >= self.times.start || self.times.start == self.start
    }

    /// Returns the cumulated distance of cell (i, j) of the strip.
    fn cumulated(&self, i: usize, j: usize) -> f64 {
        let (lane, row) = self.strip.place(i);
        let time = j + lane;
        if !self.times.contains(&time) {
            return f64::INFINITY;
        }
        self.cells[time % self.capacity * self.strip.height + row].0[lane]
    }
}

struct Tracer<'a> {
    branches: &'a [Branch],
    reach: (usize, usize),
    sweep: Sweep<'a>,
    /// The cell whose branch is searched next; `None` once the path has reached its begin.
    at: Option<(usize, usize)>,
    backwards: Vec<(usize, usize)>,
    cells: Vec<Pack>,
}

impl Tracer<'_> {
    /// Follows the path back through a group of strips, last part first.
    fn through(&mut self, borders: Borders) {
        let Borders { strips, size, above } = borders;
        for (part, above) in above.into_iter().enumerate().rev() {
            let first = strips.start + part * size;
            let inside = self.at.filter(|(i, _)| self.sweep.strip_of(*i) >= first);
            let Some((i, j)) = inside else { continue };
            let last = self.sweep.strip_of(i);
            if last == first {
                self.walk(first, &above);
                continue;
            }
            let mut borders = Borders::new(first..last + 1, above.clone());
            self.sweep.patterns[0].input = above;
            for number in first..last {
                self.sweep.run(number, j + 1, |_, _| {});
                borders.offer(number, &self.sweep.patterns[0].input);
            }
            if self.sweep.is_stopped {
                return;
            }
            self.through(borders);
        }
    }

    /// Follows the path back through one strip.
    fn walk(&mut self, number: usize, above: &Boundary) {
        let strip = self.sweep.strip(number);
        while let Some((_, j)) = self.at.filter(|(i, _)| *i >= strip.first) {
            let mut kept = Kept::new(strip, self.reach.1, std::mem::take(&mut self.cells));
            self.sweep.patterns[0].input = above.clone();
            self.sweep.run(number, j + 1, |time, tracks| kept.keep(time, &tracks[0]));
            if self.sweep.is_stopped {
                // The sweep is incomplete, so its cells say nothing about the path.
                self.at = None;
                return;
            }
            while let Some((i, j)) = self.at.filter(|(i, _)| *i >= strip.first)
                && kept.covers(i, j, self.reach)
            {
                self.step_back(&kept, above, i, j);
            }
            self.cells = kept.cells;
        }
    }

    /// Steps back from cell (i, j) along the first branch that attains its cumulated distance.
    fn step_back(&mut self, kept: &Kept, above: &Boundary, i: usize, j: usize) {
        let open_begin = self.sweep.settings.ends.open_begin();
        let first = kept.strip.first;
        let target = kept.cumulated(i, j);
        for branch in self.branches {
            let (a, b) = branch.origin();
            // With an open begin there is a virtual row of zeros before the first.
            let virtual_row = open_begin && i + 1 == a;
            if j < b || (i < a && !virtual_row) {
                continue;
            }
            let origin = match i.checked_sub(a) {
                None => 0.0,
                Some(row) if row < first => above.above(j - b)[first - 1 - row],
                Some(row) => kept.cumulated(row, j - b),
            };
            let cost = branch
                .cells()
                .map(|cell| cell.weight * self.local(i, cell.query, j - cell.reference))
                .reduce(|cost, paid| cost + paid);
            if origin < f64::INFINITY && cost.is_some_and(|cost| origin + cost == target) {
                let cells = branch.cells().filter(|cell| cell.query <= i);
                let cells = cells.map(|cell| (i - cell.query, j - cell.reference));
                let from = self.backwards.len();
                self.backwards.extend(cells);
                self.backwards[from..].reverse();
                self.at = i.checked_sub(a).map(|row| (row, j - b));
                return;
            }
        }
        // No branch leads here, so the path begins in this cell.
        self.backwards.push((i, j));
        self.at = None;
    }

    /// Returns the local distance `up` rows above (i, j); zero in the virtual row.
    fn local(&self, i: usize, up: usize, j: usize) -> f64 {
        let Some(i) = i.checked_sub(up) else { return 0.0 };
        let x = self.sweep.query.sample(i);
        let y = self.sweep.reference.sample(j);
        self.sweep.settings.local_distance.between(x, y)
    }
}
