#![expect(
    clippy::inline_always,
    reason = "inner loops must take the instruction set of the function that calls them"
)]

mod kernel;

use std::{marker::PhantomData, ops::Range};

use super::{
    NeighborIndex, NeighborLists, Queries, Sources, in_blocks,
    pending::{Pending, Pool},
};
use crate::{
    KnnError, Lists, MemberLists, class_lists::ClassLists, distance::Margin, groups::Groups,
};
use calib_core::Monitor;
use kernel::{MOST_LANES, meets};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

/// Maximum number of queries in a block. Sources are laid out once for all of them.
const QUERIES: usize = 1024;
/// Strips per tile.
const STRIPS: usize = 8;
/// Beyond this squared distance from the centre, f32 products could overflow.
const FARTHEST: f32 = 1e30;

/// An exact blocked scan that compares every query with every source, for data in which no source can be ruled out unseen.
///
/// With all states moved by a common centre, `‖x − q‖² = ‖x‖² + ‖q‖² − 2 x·q`. Tiles of sources are multiplied with panels of queries in
/// f32, as in a matrix product. Unlike there, the sums leave the registers only if one of them is small enough to matter. By the usual
/// bounds on sums (Higham 2002, §3.1), sums and norms together err by at most `(3d + 16)·2⁻²⁴·(‖x‖² + ‖q‖²)`; the margin is
/// `(4d + 32)·2⁻²⁴`. Pairs that are near enough by that margin are treated as in the other structures.
#[derive(Debug)]
pub struct Scan<'a> {
    sources: Sources<'a>,
    /// The distinct states class by class, each class in the order of time.
    groups: Groups,
    /// The end of each class in the groups.
    ends: Vec<usize>,
    centre: Vec<f32>,
    margin: Margin,
}

impl<'a> Scan<'a> {
    /// Creates a scan that treats each source separately, for so few queries that grouping equal states does not pay.
    pub fn new(sources: Sources<'a>) -> Self {
        Self::of(sources, Groups::singletons(&sources))
    }

    /// Creates a scan that compares each distinct state once, however long a standstill repeats it. Progress counts sources.
    ///
    /// # Errors
    /// If the monitor interrupts.
    pub fn grouped(sources: Sources<'a>, monitor: &dyn Monitor) -> Result<Self, KnnError> {
        monitor.begin("neighbour index", sources.len() as u64);
        Ok(Self::of(sources, Groups::new(&sources, monitor)?))
    }

    pub(super) fn of(sources: Sources<'a>, groups: Groups) -> Self {
        let centre = centre(&sources);
        let margin = Margin::new(sources.columns());
        let (groups, ends) = if sources.classes.are_given() {
            groups.in_classes(sources.classes)
        } else {
            let end = groups.len();
            (groups, vec![end])
        };
        Self { sources, groups, ends, centre, margin }
    }

    fn pool(&self) -> Pool<'_> {
        Pool { sources: &self.sources, groups: &self.groups, margin: self.margin }
    }

    /// Returns the tiles of up to `size` groups, class by class, so that a tile has one limit per query.
    fn tiles(&self, size: usize) -> Vec<Tile> {
        let starts = std::iter::once(0).chain(self.ends.iter().copied());
        let classes = starts.zip(&self.ends).enumerate();
        let tiles = classes.flat_map(|(class, (first, &end))| {
            tile_starts(end - first, size).map(move |start| {
                let start = first + start;
                Tile { class, groups: start..(start + size).min(end) }
            })
        });
        tiles.collect()
    }

    /// Searches `order` with lists of this kind.
    fn search_lists<L: Lists>(
        &self,
        queries: &Queries<'_>,
        order: &[u32],
        found: &mut NeighborLists,
        monitor: &dyn Monitor,
    ) -> Result<(), KnnError> {
        let k = found.k();
        let arch = Arch::new();
        // Smaller blocks, if there would otherwise be too few for all threads.
        let size = order.len().div_ceil(4 * rayon::current_num_threads()).clamp(64, QUERIES);
        in_blocks(order, size, found, monitor, |order| {
            let lists = PhantomData::<L>;
            arch.dispatch(Block { scan: self, queries, order, k, monitor, lists })
        })
    }
}

/// Returns a state in the middle of the sources: the median of each column over up to 1000 of them. Any centre is correct. But the margin
/// of a pair grows with its distance from the centre, and a single extreme value moves a mean.
fn centre(sources: &Sources<'_>) -> Vec<f32> {
    let stride = sources.len().div_ceil(1000).max(1);
    let sampled: Vec<u32> = (0..sources.len() as u32).step_by(stride).collect();
    if sampled.is_empty() {
        return vec![0.0; sources.columns()];
    }
    (0..sources.columns())
        .into_par_iter()
        .map(|column: usize| {
            let mut values: Vec<f32> =
                sampled.iter().map(|&transition| sources.state(transition)[column]).collect();
            let middle = values.len() / 2;
            *values.select_nth_unstable_by(middle, f32::total_cmp).1
        })
        .collect()
}

/// A block of queries against all sources.
struct Block<'a, L> {
    scan: &'a Scan<'a>,
    queries: &'a Queries<'a>,
    /// The numbers of the queries.
    order: &'a [u32],
    k: usize,
    /// The monitor. It is notified of every tile of sources, and asked whether to stop.
    monitor: &'a dyn Monitor,
    lists: PhantomData<L>,
}

/// Groups of one class that are compared together.
struct Tile {
    class: usize,
    groups: Range<usize>,
}

/// Panels of queries: `−2 (q − centre)` as `[panel, column, query]`, and the limits of the sums.
struct Panels {
    values: Vec<f32>,
    limits: Vec<f32>,
    /// Squared norms of the centred queries. It is `−∞` for a query so far away that sums could overflow; such a query is compared with
    /// every source.
    norms: Vec<f64>,
}

impl<L: Lists> WithSimd for Block<'_, L> {
    type Output = Vec<L>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Vec<L> {
        // As many sums as the registers can hold.
        if S::REGISTER_COUNT >= 32 { self.run::<S, 8>(simd) } else { self.run::<S, 4>(simd) }
    }
}

/// Reduces the offsets by the error of their sums. Sources that are too far for f32 sums are not ruled out: the definition decides. Their
/// values are set to zero, so that no product overflows.
#[inline(always)]
fn pass_far(lanes: &mut [f32], offsets: &mut [f32], columns: usize, strip: usize, error: f32) {
    for (source, offset) in offsets.iter_mut().enumerate() {
        // This is also false where the sum is NaN.
        let near = *offset <= FARTHEST;
        if columns == 0 || !near {
            let strip_of = &mut lanes[source / strip * strip * columns..];
            let column_of = strip_of[source % strip..].iter_mut().step_by(strip);
            column_of.take(columns).for_each(|value| *value = 0.0);
            *offset = f32::MIN;
        } else {
            *offset *= 1.0 - error;
        }
    }
}

impl<L: Lists> Block<'_, L> {
    #[inline(always)]
    fn run<S: Simd, const PANEL: usize>(self, simd: S) -> Vec<L> {
        let (scan, columns) = (self.scan, self.scan.sources.columns());
        let pool = scan.pool();
        let strip = kernel::strip::<S>();
        let error = (2.0 * columns as f64 + 16.0) * f64::from(f32::EPSILON);
        let tiny = (2.0 * columns as f64 + 16.0) * f64::from(f32::MIN_POSITIVE);
        let mut pending: Vec<Pending<'_, L>> = (self.order.iter())
            .map(|&query| Pending::new(simd, pool, self.queries, query as usize, self.k))
            .collect();
        let mut panels = self.panels::<PANEL>(&pending);
        let limit = |one: &Pending<'_, L>, class: usize, norm: f64| {
            one.radius_in(class).map_or(f32::NEG_INFINITY, |radius| {
                ((radius - norm * (1.0 - error) + tiny) as f32).next_up()
            })
        };
        let tile = STRIPS * strip;
        let mut lanes = vec![0.0; tile * columns.max(1)];
        let mut offsets = vec![0.0; tile];
        let mut sums = [0.0; 8 * MOST_LANES];
        let tiles = scan.tiles(tile);
        let mut begun = None;
        for (done, &Tile { class, ref groups }) in (0..).zip(&tiles) {
            if self.monitor.interrupted() {
                break;
            }
            if begun.replace(class) != Some(class) {
                let each = pending.iter().zip(&panels.norms).zip(&mut panels.limits);
                each.for_each(|((one, &norm), to)| *to = limit(one, class, norm));
            }
            let (start, width) = (groups.start, groups.len());
            let strips = lanes.chunks_exact_mut(strip * columns.max(1));
            for (number, (lanes, norms)) in strips.zip(offsets.chunks_mut(strip)).enumerate() {
                let first = (start + number * strip).min(start + width);
                let states = first..(first + strip).min(start + width);
                let states = states.map(|group| pool.state(group as u32));
                kernel::lay_strip(simd, states, &scan.centre, lanes, norms);
            }
            pass_far(&mut lanes, &mut offsets[..width], columns, strip, error as f32);
            offsets[width..].fill(f32::INFINITY);
            let strips = lanes.chunks_exact(strip * columns.max(1)).zip(offsets.chunks(strip));
            for (number, (lanes, offsets)) in strips.take(width.div_ceil(strip)).enumerate() {
                let each = panels.values.chunks_exact(PANEL * columns.max(1));
                for (panel, limits) in each.zip(panels.limits.chunks_exact_mut(PANEL)).enumerate() {
                    let (values, limits) = limits;
                    if !meets::<S, PANEL>(simd, lanes, offsets, values, limits, &mut sums) {
                        continue;
                    }
                    for (query, sums) in (panel * PANEL..).zip(sums.chunks_exact(strip)).take(PANEL)
                    {
                        let limit_of = &mut limits[query % PANEL];
                        let first = start + number * strip;
                        // Lanes past the last source are unused.
                        let sums = &sums[..strip.min(start + width - first)];
                        for (source, &sum) in (first as u32..).zip(sums) {
                            if sum <= *limit_of && pending[query].meet(simd, pool, source, class) {
                                *limit_of = limit(&pending[query], class, panels.norms[query]);
                            }
                        }
                    }
                }
            }
            // The number of queries to report: the share of the sources that all queries have been compared with.
            let [before, after] = [done, done + 1]
                .map(|done: u64| self.order.len() as u64 * done / tiles.len() as u64);
            if after > before {
                self.monitor.advance(after - before);
            }
        }
        if tiles.is_empty() {
            self.monitor.advance(self.order.len() as u64);
        }
        pending.into_iter().map(|one| one.finish(pool)).collect()
    }

    fn panels<const PANEL: usize>(&self, pending: &[Pending<'_, L>]) -> Panels {
        let centre = &self.scan.centre;
        let columns = self.scan.sources.columns().max(1);
        let padded = pending.len().next_multiple_of(PANEL);
        let mut panels = Panels {
            values: vec![0.0; padded * columns],
            limits: vec![f32::NEG_INFINITY; padded],
            norms: Vec::with_capacity(pending.len()),
        };
        for (query, one) in pending.iter().enumerate() {
            let norm = centred(one.state(), centre).map(|value| value * value).sum::<f32>();
            if norm <= FARTHEST {
                panels.norms.push(f64::from(norm));
                let panel = &mut panels.values[query / PANEL * PANEL * columns..];
                let column_of = panel[query % PANEL..].iter_mut().step_by(PANEL);
                column_of
                    .zip(centred(one.state(), centre))
                    .for_each(|(out, value)| *out = -2.0 * value);
            } else {
                panels.norms.push(f64::NEG_INFINITY);
            }
        }
        panels
    }
}

/// Returns the values of a state, less those of the centre.
#[inline]
fn centred(state: &[f32], centre: &[f32]) -> impl Iterator<Item = f32> {
    state.iter().zip(centre).map(|(value, centre)| value - centre)
}

/// Returns the starts of the tiles in an order that samples all parts of the data early: halves, then quarters and so on (van der Corput's
/// sequence). In time order, the member that lacks the first block would have no neighbours, and so no radius, during that whole block.
/// Nearly every source of the block would have to be looked at.
fn tile_starts(total: usize, tile: usize) -> impl Iterator<Item = usize> {
    let tiles = total.div_ceil(tile);
    let bits = tiles.next_power_of_two().trailing_zeros();
    (0..1_usize << bits)
        .map(move |number| number.reverse_bits().unbounded_shr(usize::BITS - bits))
        .filter(move |&number| number < tiles)
        .map(move |number| number * tile)
}

impl NeighborIndex for Scan<'_> {
    fn search(
        &self,
        queries: &Queries<'_>,
        order: &[u32],
        found: &mut NeighborLists,
        monitor: &dyn Monitor,
    ) -> Result<(), KnnError> {
        if self.sources.classes.are_given() {
            self.search_lists::<ClassLists>(queries, order, found, monitor)
        } else {
            self.search_lists::<MemberLists>(queries, order, found, monitor)
        }
    }
}

#[cfg(test)]
mod tests {
    use calib_core::{Segments, States, Transitions};

    use super::*;
    use crate::Blocks;

    #[test]
    fn wild_values_do_not_move_the_centre() {
        let rows = 4000;
        let columns = 3;
        let transitions = Transitions::new(Segments::from_lengths([rows]).expect("valid"));
        let blocks = Blocks::new(&transitions, 2).expect("valid");
        for wild in [false, true] {
            let values = (0..rows * columns)
                .map(|i: usize| if wild && (i / columns).is_multiple_of(1000) { 1e30 } else { 5.0 })
                .collect();
            let states = States::new(values, rows, columns).expect("finite");
            let sources = Sources::new(&states, &transitions, &blocks).expect("valid");
            assert_eq!(centre(&sources), [5.0; 3]);
        }
    }

    #[test]
    fn every_tile_has_its_turn() {
        const TILE: usize = 384;
        assert_eq!(
            tile_starts(5 * TILE, TILE).map(|s| s / TILE).collect::<Vec<_>>(),
            [0, 4, 2, 1, 3]
        );
        for total in [0, 1, TILE, TILE + 1, 100 * TILE - 3] {
            let mut starts: Vec<usize> = tile_starts(total, TILE).collect();
            starts.sort_unstable();
            assert_eq!(starts, (0..total).step_by(TILE).collect::<Vec<_>>());
        }
    }
}
