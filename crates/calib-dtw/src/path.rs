//! The path that belongs to a distance.
//!
//! The first sweep keeps the rows between some of the strips. Backwards, each group of strips
//! between two kept rows is swept again and split in turn, until a group is one strip. Of a strip
//! the cells of a few columns are kept and walked backwards; if the path is still inside the strip
//! at the leftmost of them, the strip is swept again up to there. So memory grows with
//! (N + M) log N, and no matrix is ever stored.

use std::ops::Range;

use crate::dtw::Alignment;
use crate::kernel::boundary::Boundary;
use crate::kernel::dispatch::InstructionSet;
use crate::kernel::lanes::{LANES, Pack};
use crate::kernel::strip::Strip;
use crate::kernel::sweep::{Purpose, Stop, Sweep, Track, entry};
use crate::{Branch, Series, Settings, StepPattern};

/// Most parts a group of strips is split into.
const MOST_PARTS: usize = 16;

/// What became of a path.
pub(crate) enum Aligned {
    Found(Alignment),
    NoPath,
    /// There is no memory for so many samples of it.
    NoRoom {
        cells: usize,
    },
    /// Nobody waits for it any more.
    Stopped,
}

/// The best path of a checked pair.
pub(crate) fn align(
    set: InstructionSet,
    pattern: &StepPattern,
    settings: Settings,
    query: Series<'_>,
    reference: Series<'_>,
    stop: Stop<'_>,
) -> Aligned {
    let patterns = std::slice::from_ref(pattern);
    // Before the long work, and not after it.
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

/// Samples of the longest path that there can be.
fn longest(query: usize, reference: usize) -> usize {
    query.saturating_add(reference)
}

/// Bytes that a path of these lengths takes, at most, with what is kept to find it again.
pub(crate) fn bytes(pattern: &StepPattern, query: usize, reference: usize) -> u64 {
    let path = size_of::<(usize, usize)>() as u64 * longest(query, reference) as u64;
    // Strips are divided into parts, these into parts, and so on.
    let levels = 2 + u64::from((query as u64).max(1).ilog(MOST_PARTS as u64));
    let border = 8_u64.saturating_mul(pattern.reach().0 as u64).saturating_mul(reference as u64);
    let borders = border.saturating_mul(levels * (MOST_PARTS as u64 + 2));
    path.saturating_add(borders)
}

/// The rows above every part of a group of strips.
struct Borders {
    strips: Range<usize>,
    /// Strips of a part; the last part may have fewer.
    size: usize,
    above: Vec<Boundary>,
}

impl Borders {
    fn new(strips: Range<usize>, above: Boundary) -> Self {
        let parts = strips.len().isqrt().clamp(2, MOST_PARTS);
        Self { size: strips.len().div_ceil(parts), above: vec![above], strips }
    }

    /// Keeps what lies below strip `number`, if a part begins there.
    fn offer(&mut self, number: usize, below: &Boundary) {
        if (number + 1 - self.strips.start).is_multiple_of(self.size) {
            self.above.push(below.clone());
        }
    }
}

/// Cells of one strip in its last columns.
struct Kept {
    strip: Strip,
    /// Times (columns of lane 0) that were kept.
    times: Range<usize>,
    /// Time of the first column of the strip: before it there are no paths.
    start: usize,
    /// `[capacity, height]` packs, time t in row t modulo the capacity.
    cells: Vec<Pack>,
    capacity: usize,
}

impl Kept {
    /// Keeps nothing yet; `cells` is memory to use again, of an earlier strip of the same height.
    fn new(strip: Strip, reach: usize, mut cells: Vec<Pack>) -> Self {
        // Four times as wide as high: most paths are through by then.
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

    /// Whether all cells a branch into row `i`, column `j` may come from are kept.
    fn covers(&self, i: usize, j: usize, reach: (usize, usize)) -> bool {
        let first = i.saturating_sub(reach.0).max(self.strip.first);
        let earliest = j.saturating_sub(reach.1) + self.strip.place(first).0;
        earliest >= self.times.start || self.times.start == self.start
    }

    /// Cumulated distance of cell (i, j) of the strip.
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
    /// The cell still to be explained; `None` once the path has reached its begin.
    at: Option<(usize, usize)>,
    backwards: Vec<(usize, usize)>,
    cells: Vec<Pack>,
}

impl Tracer<'_> {
    /// Walks the path back through a group of strips, last part first.
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

    /// Walks the path back through one strip.
    fn walk(&mut self, number: usize, above: &Boundary) {
        let strip = self.sweep.strip(number);
        while let Some((_, j)) = self.at.filter(|(i, _)| *i >= strip.first) {
            let mut kept = Kept::new(strip, self.reach.1, std::mem::take(&mut self.cells));
            self.sweep.patterns[0].input = above.clone();
            self.sweep.run(number, j + 1, |time, tracks| kept.keep(time, &tracks[0]));
            if self.sweep.is_stopped {
                // What is known of the strip is not what the path stands on.
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

    /// Explains cell (i, j): the first branch that attains its cumulated distance.
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
        // No branch leads here: this is the cell where paths start.
        self.backwards.push((i, j));
        self.at = None;
    }

    /// Local distance `up` rows above (i, j); zero in the virtual row.
    fn local(&self, i: usize, up: usize, j: usize) -> f64 {
        let Some(i) = i.checked_sub(up) else { return 0.0 };
        let x = self.sweep.query.sample(i);
        let y = self.sweep.reference.sample(j);
        self.sweep.settings.local_distance.between(x, y)
    }
}
