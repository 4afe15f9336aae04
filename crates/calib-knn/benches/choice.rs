//! Measures the tables by which `"auto"` chooses between the k-d tree and the join. The documentation of `Sources::index` shows
//! them.
//!
//! ```text
//! cargo bench -p calib-knn --bench choice [-- ROUNDS]
//! ```
//!
//! A cell is the processor seconds of a build with two threads: the minimum over several rounds. Each round measures every cell
//! once, so that other work on the machine affects all cells alike. Without `--bench` all data are small.

#![expect(clippy::print_stdout, reason = "a bench prints what it measured")]
#![expect(clippy::disallowed_methods, reason = "a bench reads the clock")]

mod data;

use std::{fs, time::Instant};

use calib_core::{Segments, Silent, States, Transitions};
use calib_knn::{Blocks, Exclusion, IndexKind, build_tables};
use data::{plant, uniform};

/// One cell of a table: what is built, and the minimum of its seconds so far.
struct Cell<'a> {
    states: &'a States,
    kind: IndexKind,
    theiler: u32,
    least: f64,
}

/// Returns the processor seconds of this process so far, or wall-clock seconds if the system does not report them.
fn processor_seconds(since: Instant) -> f64 {
    let ticks = fs::read_to_string("/proc/self/stat").ok().and_then(|stat| {
        // The program's name is in parentheses and may contain spaces.
        let fields: Vec<&str> = stat.rsplit_once(')')?.1.split_whitespace().collect();
        Some(fields.get(11)?.parse::<f64>().ok()? + fields.get(12)?.parse::<f64>().ok()?)
    });
    ticks.map_or_else(|| since.elapsed().as_secs_f64(), |ticks| ticks / 100.0)
}

impl Cell<'_> {
    fn measure(&mut self) {
        let rows = self.states.rows();
        let transitions = Transitions::new(Segments::from_lengths([rows]).expect("valid"));
        let blocks = Blocks::new(&transitions, 5).expect("valid");
        let exclusion = Exclusion { theiler: self.theiler, ..Exclusion::default() };
        let start = Instant::now();
        let before = processor_seconds(start);
        build_tables(self.states, &transitions, &blocks, 3, exclusion, self.kind, &Silent)
            .expect("built");
        self.least = self.least.min(processor_seconds(start) - before);
    }
}

/// Returns both data sets with `rows` rows, for each number of columns.
fn data(rows: usize, columns: &[usize]) -> Vec<(usize, [States; 2])> {
    columns
        .iter()
        .map(|&columns| (columns, [uniform(rows, columns), plant(rows, columns)]))
        .collect()
}

/// Returns unmeasured cells, one for each kind of index.
fn cells<'a>(states: &'a States, kinds: &[IndexKind], theiler: u32) -> Vec<Cell<'a>> {
    kinds.iter().map(|&kind| Cell { states, kind, theiler, least: f64::INFINITY }).collect()
}

fn seconds(cells: &[Cell<'_>]) -> String {
    cells.iter().map(|cell| format!("{:.2}", cell.least)).collect::<Vec<_>>().join(", ")
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let small = !arguments.iter().any(|argument| argument == "--bench");
    let rounds = arguments.iter().find_map(|argument| argument.parse().ok()).unwrap_or(3);
    let (rows, windowed_rows) = if small { (600, 600) } else { (100_000, 20_000) };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().expect("a pool");

    let by_columns = data(rows, &[1, 2, 3, 4, 6, 8]);
    let windowed = data(windowed_rows, &[1, 2, 3]);
    let tree = IndexKind::KdTree;
    let join = IndexKind::Join;
    let auto = IndexKind::Auto;
    // Each entry is the start of a line and the groups of cells that follow.
    let mut first: Vec<(String, [Vec<Cell<'_>>; 2])> = (by_columns.iter())
        .map(|(columns, states)| {
            (columns.to_string(), [0, 1].map(|set| cells(&states[set], &[tree, join], 0)))
        })
        .collect();
    let mut second = Vec::new();
    for (columns, states) in &windowed {
        for theiler in [0, 60, 3600].map(|window: u32| window.min(windowed_rows as u32 / 5)) {
            let groups = [0, 1].map(|set| cells(&states[set], &[tree, join, auto], theiler));
            second.push((format!("{columns} | {theiler}"), groups));
        }
    }
    for _ in 0..if small { 1 } else { rounds } {
        for (_, groups) in first.iter_mut().chain(&mut second) {
            groups.iter_mut().flatten().for_each(|cell| pool.install(|| cell.measure()));
        }
    }
    println!("{rows} rows, k = 3, five members, processor seconds, least of {rounds}\n");
    println!("| columns | uniform: tree, join | simulated plant: tree, join |\n|---|---|---|");
    for (line, [uniform, plant]) in &first {
        println!("| {line} | {} | {} |", seconds(uniform), seconds(plant));
    }
    println!("\n{windowed_rows} rows with a Theiler window\n");
    println!(
        "| columns | window | uniform: tree, join, auto | simulated plant: tree, join, auto |"
    );
    println!("|---|---|---|---|");
    for (line, [uniform, plant]) in &second {
        println!("| {line} | {} | {} |", seconds(uniform), seconds(plant));
    }
}
