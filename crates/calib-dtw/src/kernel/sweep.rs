//! The sweep over all cells, strip by strip, for one or several patterns at once.

use std::ops::Range;

use super::boundary::Boundary;
use super::column::{ColumnInput, Columns, LocalInput, Mask};
use super::dispatch::{
    InstructionSet, LocalDispatch, PatternDispatch, local_dispatch, pattern_dispatch,
};
use super::lanes::{LANES, Pack};
use super::strip::{Strip, height_for};
use crate::{Branch, Series, Settings, StepPattern, Window};

/// Maximum size of the columns of a strip, in bytes: most of a first-level cache.
const COLUMN_BYTES: usize = 40 << 10;
/// Maximum rows per lane if only the distance is needed.
const DISTANCE_HEIGHT: usize = 64;
/// Maximum rows per lane if cells of a strip are stored for a while.
const PATH_HEIGHT: usize = 16;

/// Columns between two checks whether to stop: some milliseconds.
const COLUMNS_PER_LOOK: usize = 1 << 13;

/// A check whether to stop the computation.
pub(crate) type Stop<'a> = Option<&'a dyn Fn() -> bool>;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Purpose {
    Distance,
    Path,
}

/// The state of one pattern during the sweep.
pub(crate) struct Track {
    dispatch: PatternDispatch,
    pub(crate) halo: usize,
    pub(crate) cumulated: Columns,
    pub(crate) input: Boundary,
    output: Boundary,
}

impl Track {
    /// Stores the bottom of column `time` of the last lane for the next strip.
    #[inline]
    fn leave(&mut self, time: usize, height: usize) {
        let bottom = self.halo + height;
        for (back, value) in self.output.above_mut(time).iter_mut().enumerate() {
            *value = self.cumulated[0][bottom - 1 - back].0[LANES - 1];
        }
    }
}

/// One pair of series, and the buffers that are reused from strip to strip.
pub(crate) struct Sweep<'a> {
    pub(crate) query: Series<'a>,
    pub(crate) reference: Series<'a>,
    pub(crate) settings: Settings,
    pub(crate) patterns: Vec<Track>,
    stop: Stop<'a>,
    /// Whether the computation was stopped. Its result is then meaningless.
    pub(crate) is_stopped: bool,
    height: usize,
    local: LocalDispatch,
    local_halo: usize,
    local_columns: Columns,
    /// Longest advance of all patterns along the reference.
    reach: usize,
    /// The reversed reference, channel after channel, with a margin of lanes on either side.
    reversed: Vec<Vec<f64>>,
    packed_query: Vec<Pack>,
    low: Vec<Pack>,
    high: Vec<Pack>,
    unseeded: Vec<Pack>,
    seeded: Vec<Pack>,
}

fn columns(count: usize, rows: usize) -> Columns {
    vec![vec![Pack::splat(0.0); rows].into_boxed_slice(); count]
}

/// Returns the number of columns of cumulated distances that a pattern needs: the current one and those
/// that it reaches back to.
fn cumulated_columns(pattern: &StepPattern) -> usize {
    pattern.reach().1.max(1) + 1
}

/// Returns the column of each lane at a time.
#[inline]
fn columns_at(time: usize) -> Pack {
    Pack(std::array::from_fn(|lane| time as f64 - lane as f64))
}

/// Returns the boundary above the first strip, for a pattern with this halo.
pub(crate) fn entry(settings: Settings, halo: usize, reference: usize) -> Boundary {
    if settings.ends.open_begin() {
        Boundary::open(halo, reference)
    } else {
        Boundary::closed(halo)
    }
}

impl<'a> Sweep<'a> {
    /// Prepares a sweep. `query` and `reference` must be checked: finite, not empty, and with the same
    /// number of channels.
    pub(crate) fn new(
        set: InstructionSet,
        patterns: &[StepPattern],
        settings: Settings,
        query: Series<'a>,
        reference: Series<'a>,
        purpose: Purpose,
        stop: Stop<'a>,
    ) -> Self {
        let reaches = patterns.iter().map(StepPattern::reach);
        let (halo, reach) = reaches.fold((1, 1), |(a, b), (c, d)| (a.max(c), b.max(d)));
        let cells = patterns.iter().flat_map(StepPattern::branches).flat_map(Branch::cells);
        let local = cells.map(|cell| cell.reference + 1).fold(1, usize::max);
        let packs =
            local + query.channels() + patterns.iter().map(cumulated_columns).sum::<usize>();
        let most = match purpose {
            Purpose::Distance => DISTANCE_HEIGHT.min(COLUMN_BYTES / (packs * size_of::<Pack>())),
            Purpose::Path => PATH_HEIGHT,
        };
        let n = query.len();
        let m = reference.len();
        let height = height_for(n, m, settings.window, halo, most);
        let lanes = patterns.iter().map(|pattern| {
            let halo = pattern.reach().0;
            Track {
                dispatch: pattern_dispatch(set, pattern),
                halo,
                cumulated: columns(cumulated_columns(pattern), halo + height),
                input: Boundary::closed(halo),
                output: Boundary::closed(halo),
            }
        });
        let margin = LANES - 1;
        let reversed = (0..query.channels()).map(|channel| {
            let last = reference.sample(m - 1)[channel];
            let mut values = vec![last; margin];
            values.extend((0..m).rev().map(|j| reference.sample(j)[channel]));
            values.extend(vec![reference.sample(0)[channel]; margin]);
            values
        });
        let mut seeded = vec![Pack::splat(f64::INFINITY); height];
        seeded[0].0[0] = settings.local_distance.between(query.sample(0), reference.sample(0));
        Self {
            query,
            reference,
            settings,
            stop,
            is_stopped: false,
            height,
            local: local_dispatch(set, settings.local_distance, query.channels()),
            local_halo: halo,
            local_columns: columns(local, halo + height),
            reach,
            patterns: lanes.collect(),
            reversed: reversed.collect(),
            packed_query: Vec::new(),
            low: vec![Pack::splat(f64::NEG_INFINITY); height],
            high: vec![Pack::splat(f64::INFINITY); height],
            unseeded: vec![Pack::splat(f64::INFINITY); height],
            seeded,
        }
    }

    pub(crate) fn strips(&self) -> usize {
        self.query.len().div_ceil(LANES * self.height)
    }

    pub(crate) fn strip(&self, number: usize) -> Strip {
        Strip { first: number * LANES * self.height, height: self.height, query: self.query.len() }
    }

    /// Returns the number of the strip that contains query sample `index`.
    pub(crate) fn strip_of(&self, index: usize) -> usize {
        index / (LANES * self.height)
    }

    /// Resets the buffers for a new strip.
    fn begin(&mut self, strip: &Strip, columns: &Range<usize>) {
        let window = self.settings.window;
        if window != Window::None {
            strip.limits(window, self.reference.len(), &mut self.low, &mut self.high);
        }
        strip.load(self.query, self.local_halo, &mut self.packed_query);
        for pattern in &mut self.patterns {
            pattern.output.reset(columns.clone());
            for column in &mut pattern.cumulated {
                column.fill(Pack::splat(f64::INFINITY));
            }
        }
    }

    /// Sweeps one strip up to reference sample `limit` (exclusive). Reads each pattern's `input`, and
    /// replaces it by the boundary for the next strip. `visit` is called at every time step, when lane l
    /// has its column `time − l` in `cumulated[0]`.
    pub(crate) fn run(
        &mut self,
        number: usize,
        limit: usize,
        mut visit: impl FnMut(usize, &[Track]),
    ) {
        if self.is_stopped {
            return;
        }
        let strip = self.strip(number);
        let m = self.reference.len();
        let window = self.settings.window;
        let columns = strip.columns(window, m, limit);
        if columns.is_empty() {
            self.patterns.iter_mut().for_each(|pattern| pattern.input.reset(0..0));
            return;
        }
        // Branches may start a little to the left of the first open cell.
        let start = columns.start.saturating_sub(self.reach);
        let columns = start..columns.end;
        let windowed = window != Window::None;
        self.begin(&strip, &columns);
        let last_strip = number + 1 == self.strips();
        let open_begin = self.settings.ends.open_begin();
        let margin = LANES - 1;
        let mut reference: Vec<&[f64; LANES]> = Vec::with_capacity(self.reversed.len());
        for time in start..columns.end + strip.last_lane() {
            if time.is_multiple_of(COLUMNS_PER_LOOK) && self.stop.is_some_and(|stop| stop()) {
                self.is_stopped = true;
                return;
            }
            reference.clear();
            reference.extend(
                self.reversed
                    .iter()
                    .filter_map(|channel| channel[m + margin - 1 - time..].first_chunk::<LANES>()),
            );
            self.local_columns.rotate_right(1);
            self.local.run(&mut LocalInput {
                query: &self.packed_query,
                reference: &reference,
                out: &mut self.local_columns[0],
            });
            if open_begin && number == 0 {
                // The virtual row above the first has no cost.
                self.local_columns[0][self.local_halo - 1].0[0] = 0.0;
            }
            let seeds = number == 0 && time == 0 && !open_begin;
            let use_mask = windowed || seeds;
            let at = if use_mask { columns_at(time) } else { Pack::splat(0.0) };
            for pattern in &mut self.patterns {
                pattern.cumulated.rotate_right(1);
                let mut input = ColumnInput {
                    cumulated: &mut pattern.cumulated,
                    halo: pattern.halo,
                    local: &self.local_columns,
                    local_halo: self.local_halo,
                    height: self.height,
                    above: pattern.input.above(time),
                    weights: &pattern.dispatch.weights,
                    branches: &pattern.dispatch.branches,
                    mask: Mask {
                        at: &at,
                        low: &self.low,
                        high: &self.high,
                        seed: if seeds { &self.seeded } else { &self.unseeded },
                    },
                };
                pattern.dispatch.run(use_mask, &mut input);
                if !last_strip && time >= start + margin {
                    pattern.leave(time - margin, self.height);
                }
            }
            visit(time, &self.patterns);
        }
        for pattern in &mut self.patterns {
            std::mem::swap(&mut pattern.input, &mut pattern.output);
        }
    }
}
