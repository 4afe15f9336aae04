//! Neighbour lists straight from the definition of distance, without a search structure. One pass over the states serves
//! many lists.

use calib_core::{Monitor, TransitionIndex};
use rayon::prelude::*;

use crate::{KnnError, KnnModel};

/// A row of a table: member and transition.
pub(crate) type Cell = (usize, TransitionIndex);

/// Number of sources in a strip. Every cell sees a whole strip before any cell sees the next one. The monitor is asked once
/// per strip.
const STRIP: usize = 8192;
/// Sources that a task lays side by side and compares with all of its cells.
const TILE: usize = 32;
/// Sources whose distances are summed at once.
const LANES: usize = 8;
/// Columns between two checks whether any source can still be near.
const COLUMNS: usize = 16;
/// Memory for the states of the cells of one pass, in bytes.
const QUERIES: usize = 64 << 20;
/// Minimum number of cells of a pass.
const CELLS: usize = 1024;

/// Returns the `k` nearest sources of each cell, nearest first and ties by row: squared distance and transition.
///
/// Every source is measured by the definition, `Σ_c (a_c − b_c)²` in f64 in column order. Terms are not negative, and
/// rounding keeps the order of sums. So a source is dropped as soon as its partial sum exceeds the `k`-th nearest distance.
/// One pass over the states serves all cells if their own states fit in 64 MiB: 59 000 cells at 142 columns, and never
/// fewer than 1024. Otherwise there are as many passes as necessary. Progress counts sources.
pub(crate) fn by_definition(
    model: &KnnModel,
    cells: &[Cell],
    monitor: &dyn Monitor,
) -> Result<Vec<Vec<(f64, u32)>>, KnnError> {
    let columns = model.states().columns();
    let sources = model.transitions().len();
    let at_once = (QUERIES / (8 * columns.max(1))).max(CELLS);
    let passes = cells.len().div_ceil(at_once);
    monitor.begin("comparing with brute force", (passes * sources) as u64);
    let mut lists = Vec::with_capacity(cells.len());
    for cells in cells.chunks(at_once) {
        let mut searched: Vec<Search> =
            cells.par_iter().map(|&cell| Search::new(model, cell)).collect();
        let task = cells.len().div_ceil(2 * rayon::current_num_threads()).max(LANES);
        for start in (0..sources).step_by(STRIP) {
            monitor.check()?;
            let end = sources.min(start + STRIP);
            searched.par_chunks_mut(task).for_each(|searches| {
                see_strip(model, searches, start..end);
            });
            monitor.advance((end - start) as u64);
        }
        lists.extend(searched.into_iter().map(|search| search.nearest));
    }
    Ok(lists)
}

/// The search for the list of one cell.
struct Search {
    member: usize,
    /// The row of the table.
    row: u32,
    /// The state whose neighbours are searched.
    state: Vec<f64>,
    forbidden: std::ops::Range<u32>,
    k: usize,
    nearest: Vec<(f64, u32)>,
}

impl Search {
    fn new(model: &KnnModel, (member, transition): Cell) -> Self {
        let query = model.transitions().next(transition);
        let state = model.states().row(query.get());
        Self {
            member,
            row: transition.0,
            state: state.iter().copied().map(f64::from).collect(),
            forbidden: model.exclusion().forbidden(model.transitions(), query),
            k: model.k(),
            nearest: Vec::with_capacity(model.k()),
        }
    }

    /// Returns the squared distance beyond which no source can enter the list.
    fn bound(&self) -> f64 {
        if self.nearest.len() < self.k {
            f64::INFINITY
        } else {
            self.nearest.last().map_or(f64::NEG_INFINITY, |&(squared, _)| squared)
        }
    }

    /// Offers a source to the list. Sources come in row order, so that of equal distances the earlier row stays first.
    fn offer(&mut self, model: &KnnModel, squared: f64, transition: u32) {
        let place = self.nearest.partition_point(|&(other, _)| other <= squared);
        if place < self.k
            && !self.forbidden.contains(&transition)
            && model.blocks().contains(self.member, TransitionIndex(transition))
            && !model.left_out(self.member).bars(self.row, transition)
        {
            self.nearest.truncate(self.k - 1);
            self.nearest.insert(place, (squared, transition));
        }
    }
}

/// Compares each of these cells with each source of the strip.
fn see_strip(model: &KnnModel, searches: &mut [Search], strip: std::ops::Range<usize>) {
    let columns = model.states().columns();
    let mut tile = vec![[0.0_f64; LANES]; TILE / LANES * columns];
    let arch = pulp::Arch::new();
    for start in strip.clone().step_by(TILE) {
        let sources = &model.transitions().sources()[start..strip.end.min(start + TILE)];
        for (number, &row) in sources.iter().enumerate() {
            let first = number / LANES * columns;
            let lane = number % LANES;
            let state = model.states().row(row as usize);
            for (out, &value) in tile[first..].iter_mut().zip(state) {
                out[lane] = f64::from(value);
            }
        }
        for search in &mut *searches {
            for (group, sources) in sources.chunks(LANES).enumerate() {
                let lanes = &tile[group * columns..][..columns];
                let bound = search.bound();
                let seen = arch.dispatch(
                    #[inline(always)]
                    || within(&search.state, lanes, bound),
                );
                let Some(squared) = seen else { continue };
                for (lane, &squared) in squared[..sources.len()].iter().enumerate() {
                    let transition = (start + group * LANES + lane) as u32;
                    search.offer(model, squared, transition);
                }
            }
        }
    }
}

/// Returns the squared distances of sources that lie side by side, unless all exceed `bound`.
#[expect(clippy::inline_always, reason = "it must take the instruction set of its caller")]
#[inline(always)]
fn within(state: &[f64], lanes: &[[f64; LANES]], bound: f64) -> Option<[f64; LANES]> {
    let mut sums = [0.0; LANES];
    for (state, lanes) in state.chunks(COLUMNS).zip(lanes.chunks(COLUMNS)) {
        for (&a, b) in state.iter().zip(lanes) {
            for (sum, b) in sums.iter_mut().zip(b) {
                let difference = a - b;
                *sum += difference * difference;
            }
        }
        if sums.iter().all(|&sum| sum > bound) {
            return None;
        }
    }
    Some(sums)
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU64, Ordering};

    use calib_core::{Seed, Segments, States, Transitions};

    use super::*;
    use crate::{ModelConfig, distance::squared};

    /// Counts progress, and interrupts after some of it.
    struct Counting {
        done: AtomicU64,
        stop_at: u64,
    }

    impl Counting {
        fn new(stop_at: u64) -> Self {
            Self { done: 0.into(), stop_at }
        }
    }

    impl Monitor for Counting {
        fn begin(&self, _task: &str, _total: u64) {}

        fn advance(&self, units: u64) {
            self.done.fetch_add(units, Ordering::SeqCst);
        }

        fn interrupted(&self) -> bool {
            self.done.load(Ordering::SeqCst) >= self.stop_at
        }
    }

    fn model(rows: usize, columns: usize) -> KnnModel {
        let mut rng = Seed::new(4).rng();
        // The few different values make ties everywhere.
        let values = (0..rows * columns).map(|_| rng.below(3) as f32).collect();
        let states = States::new(values, rows, columns).expect("finite");
        let transitions = Transitions::new(Segments::from_lengths([60, rows - 60]).expect("two"));
        let config =
            ModelConfig { theiler: 2, members: 3, remove_traps: false, ..ModelConfig::default() };
        KnnModel::build(states, transitions, &config, &calib_core::Silent).expect("built")
    }

    #[test]
    fn one_pass_finds_what_every_pair_says() {
        for (rows, columns) in [(150, 1), (151, 20), (9000, 3)] {
            let model = model(rows, columns);
            let transitions = model.transitions();
            let cells: Vec<Cell> = (0..3)
                .flat_map(|m| {
                    (0..model.member(m).len())
                        .step_by(rows / 50)
                        .map(move |at| (m, at))
                        .collect::<Vec<_>>()
                })
                .map(|(m, at)| (m, model.member(m).nth(at)))
                .collect();
            let monitor = Counting::new(u64::MAX);
            let lists = by_definition(&model, &cells, &monitor).expect("compared");
            assert_eq!(monitor.done.into_inner(), transitions.len() as u64, "one pass for all");
            for (&(member, cell), list) in cells.iter().zip(&lists) {
                let query = transitions.next(cell);
                let forbidden = model.exclusion().forbidden(transitions, query);
                let mut all: Vec<(f64, u32)> = model
                    .blocks()
                    .transitions_of(member)
                    .filter(|j| !forbidden.contains(&j.0))
                    .map(|j| {
                        let source = model.states().row(transitions.source(j).get());
                        (squared(model.states().row(query.get()), source), j.0)
                    })
                    .collect();
                all.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
                assert_eq!(list[..], all[..3]);
            }
        }
    }

    #[test]
    fn it_stops_when_it_is_told_to() {
        let model = model(20_000, 2);
        let cells = [(0, model.member(0).nth(7))];
        let monitor = Counting::new(1);
        let stopped = by_definition(&model, &cells, &monitor);
        assert!(matches!(stopped, Err(KnnError::Cancelled(_))));
        assert_eq!(monitor.done.into_inner(), STRIP as u64, "after the strip that it was in");
    }
}
