//! Runs calib beside Python packages, for `scripts/peers/knn.py`. Prints one line of JSON per run:
//!
//! ```text
//! knn_peers calib STATES.npy ROWS QUERIES.npy OUT.npy K
//! knn_peers graph STATES.npy ROWS QUERIES.npy OUT.npy K
//! knn_peers kiddo STATES.npy ROWS QUERIES.npy OUT.npy K BUDGET_SECS
//! ```
//!
//! The first ROWS rows of STATES are one unbroken log.
//!
//! - `calib` builds the tables of all five members.
//! - `graph` finds the neighbours of every row of member 0. It treats the rows as points without time.
//! - `kiddo` builds a k-d tree over the sources of member 0. It stops when the budget is spent, and reports how many queries it answered,
//!   in their order.
//!
//! A query is the number of a row that is a next state in member 0. OUT receives the K nearest sources in that member, other than the row
//! itself, as row numbers.

#![expect(clippy::print_stdout, reason = "a program prints")]
#![expect(clippy::disallowed_methods, reason = "a program that measures reads the clock")]

use std::{env, error::Error, fs, num::NonZero, ops::Range, path::Path, sync::Arc, time::Instant};

use calib_core::{Segments, Silent, States, TransitionIndex, Transitions};
use calib_files::{MappedNpy, map_npy, write_npy};
use calib_knn::{IndexKind, KnnModel, ModelConfig, Points, SelfMatch};
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;

type Outcome<T> = Result<T, Box<dyn Error>>;

fn main() -> Outcome<()> {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match arguments[..] {
        ["calib", states, rows, queries, out, k] => {
            calib(open(states, rows)?, &read_rows(queries)?, out.as_ref(), k.parse()?)
        }
        ["graph", states, rows, queries, out, k] => {
            graph(&open(states, rows)?, &read_rows(queries)?, out.as_ref(), k.parse()?)
        }
        ["kiddo", states, rows, queries, out, k, budget] => {
            let log = open(states, rows)?;
            let queries = read_rows(queries)?;
            kiddo(&log, &queries, out.as_ref(), k.parse()?, budget.parse()?)
        }
        // `cargo test` and `cargo bench` run examples without arguments.
        _ => {
            println!(
                "knn_peers calib|graph|kiddo STATES.npy ROWS QUERIES.npy OUT.npy K [BUDGET_SECS]"
            );
            Ok(())
        }
    }
}

/// The first rows of a mapped file.
struct Log {
    file: MappedNpy<f32>,
    rows: usize,
}

impl AsRef<[f32]> for Log {
    fn as_ref(&self) -> &[f32] {
        &self.file.as_slice()[..self.rows * self.file.columns()]
    }
}

impl Log {
    fn row(&self, row: usize) -> &[f32] {
        &self.as_ref()[row * self.file.columns()..][..self.file.columns()]
    }

    /// Returns the rows that are sources of member 0: those after the first of five blocks and after the row that follows it.
    fn sources(&self) -> Range<usize> {
        let transitions = self.rows - 1;
        transitions / 5 + 1..transitions
    }
}

fn open(path: &str, rows: &str) -> Outcome<Log> {
    let file = map_npy::<f32>(path.as_ref())?;
    let rows = rows.parse()?;
    if file.rows() < rows {
        return Err(format!("{path} has {} rows, expected {rows}", file.rows()).into());
    }
    Ok(Log { file, rows })
}

fn read_rows(path: &str) -> Outcome<Vec<usize>> {
    let rows = map_npy::<u32>(path.as_ref())?;
    Ok(rows.as_slice().iter().map(|&row| row as usize).collect())
}

fn peak_kib() -> u64 {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    line.and_then(|line| line.split_whitespace().next()?.parse().ok()).unwrap_or(0)
}

fn calib(log: Log, queries: &[usize], out: &Path, k: usize) -> Outcome<()> {
    let rows = log.rows;
    let columns = log.file.columns();
    let clock = Instant::now();
    let states = States::from_shared(Arc::new(log), rows, columns)?;
    let transitions = Transitions::new(Segments::from_lengths([rows])?);
    // The peers only find neighbours. Removing traps is an additional search.
    let config = ModelConfig {
        neighbors: k,
        exclude_self: true,
        remove_traps: false,
        ..ModelConfig::default()
    };
    let model = KnnModel::build(states, transitions, &config, &Silent)?;
    let seconds = clock.elapsed().as_secs_f64();
    let found: Vec<u32> = queries
        .iter()
        .flat_map(|&row| model.member(0).neighbors(TransitionIndex(row as u32 - 1)).0)
        .map(|&neighbor| model.transitions().source(TransitionIndex(neighbor)).get() as u32)
        .collect();
    println!(
        "{{\"build\": 0, \"query\": {seconds}, \"answered\": {}, \"peak_kib\": {}}}",
        rows - rows / 5,
        peak_kib()
    );
    Ok(write_npy(out, &found, queries.len(), k)?)
}

/// Builds a neighbour graph as other packages define it. Its points are the sources of member 0 and the row after them, and each gets its
/// nearest other points.
fn graph(log: &Log, queries: &[usize], out: &Path, k: usize) -> Outcome<()> {
    let sources = log.sources();
    let columns = log.file.columns();
    let values = log.as_ref()[sources.start * columns..(sources.end + 1) * columns].to_vec();
    let clock = Instant::now();
    let points = Points::new(values, columns)?;
    // The row after the sources is a point but no source, so one more neighbour is needed.
    let found = points.join(k + 1, SelfMatch::Excluded, IndexKind::Auto, &Silent)?;
    let seconds = clock.elapsed().as_secs_f64();
    let nearest: Vec<u32> = queries
        .iter()
        .flat_map(|&row| {
            let own = &found.neighbors[(row - sources.start) * (k + 1)..][..=k];
            let own = own.iter().map(|&place| place as usize + sources.start);
            own.filter(|&row| row < sources.end).take(k).map(|row| row as u32)
        })
        .collect();
    println!(
        "{{\"build\": {seconds}, \"query\": 0, \"answered\": {}, \"peak_kib\": {}}}",
        sources.len(),
        peak_kib()
    );
    Ok(write_npy(out, &nearest, queries.len(), k)?)
}

fn kiddo(log: &Log, queries: &[usize], out: &Path, k: usize, budget: f64) -> Outcome<()> {
    match log.file.columns() {
        2 => tree::<2>(log, queries, out, k, budget),
        3 => tree::<3>(log, queries, out, k, budget),
        4 => tree::<4>(log, queries, out, k, budget),
        8 => tree::<8>(log, queries, out, k, budget),
        12 => tree::<12>(log, queries, out, k, budget),
        16 => tree::<16>(log, queries, out, k, budget),
        64 => tree::<64>(log, queries, out, k, budget),
        142 => tree::<142>(log, queries, out, k, budget),
        144 => tree::<144>(log, queries, out, k, budget),
        columns => Err(format!("compiled without trees of {columns} columns").into()),
    }
}

fn point<const D: usize>(row: &[f32]) -> [f32; D] {
    std::array::from_fn(|column| row[column])
}

fn tree<const D: usize>(
    log: &Log,
    queries: &[usize],
    out: &Path,
    k: usize,
    budget: f64,
) -> Outcome<()> {
    let sources = log.sources();
    let clock = Instant::now();
    let points: Vec<[f32; D]> = sources.clone().map(|row| point(log.row(row))).collect();
    let tree: ImmutableKdTree<f32, D> =
        ImmutableKdTree::new_from_slice(&points).map_err(|error| format!("{error:?}"))?;
    let build = clock.elapsed().as_secs_f64();
    let one_more = NonZero::new(k + 1).ok_or("k is zero")?;
    let clock = Instant::now();
    let mut found: Vec<Vec<u32>> = vec![];
    for batch in queries.chunks(256) {
        found.par_extend(batch.par_iter().map(|&query| -> Vec<u32> {
            let state = point::<D>(log.row(query));
            let near = tree.query(&state).nearest_n::<SquaredEuclidean<f32>>(one_more).execute();
            let rows = near.into_iter().map(|found| (sources.start + found.item as usize) as u32);
            rows.filter(|&row| row as usize != query).take(k).collect()
        }));
        if clock.elapsed().as_secs_f64() > budget {
            break;
        }
    }
    let query = clock.elapsed().as_secs_f64();
    println!(
        "{{\"build\": {build}, \"query\": {query}, \"answered\": {}, \"peak_kib\": {}}}",
        found.len(),
        peak_kib()
    );
    Ok(write_npy(out, &found.concat(), found.len(), k)?)
}
