//! Builds neighbour tables of a simulated plant of any length, and measures time and memory.
//!
//! ```text
//! plant_tables simulate ROWS PERIOD_SECS STATES.npy
//! plant_tables build STATES.npy [memory | disk [VERIFY [PARTS]]]
//! plant_tables as-found STATES.npy …
//! ```
//!
//! `simulate` streams the 142 live channels of a 480-channel plant, so that logs can be larger than memory. It scales each
//! channel to its range over the whole time. `build` maps the file and builds the tables of five members with k = 3. It checks
//! VERIFY rows of each member (20 by default) against brute force, and prints one line of JSON. `as-found` does the same with
//! `remove_traps = false`. `disk` puts images and tables in files beside the states. PARTS is a folder for partial results.

#![expect(clippy::print_stdout, reason = "a program prints")]
#![expect(clippy::disallowed_methods, reason = "a program that measures reads the clock")]

use std::{
    env,
    error::Error,
    fs::{self, File},
    io::{BufWriter, Write as _},
    path::Path,
    sync::{
        Arc,
        atomic::{AtomicBool, AtomicU64, Ordering},
    },
    thread,
    time::{Duration, Instant},
};

use calib_core::{Period, Seed, Segments, Silent, States, Transitions};
use calib_files::{ScratchPlace, map_npy};
use calib_knn::{KnnModel, MemoryNeed, ModelConfig, Parts, Workplace, verify};
use calib_plant::{Fate, Plant, PlantOptions};

/// Channels of the plant. 142 of them are live.
const CHANNELS: usize = 480;
/// Sampling period at which the ranges of the channels are found, in seconds.
const COARSE_SECS: f64 = 600.0;

type Outcome<T> = Result<T, Box<dyn Error>>;

fn main() -> Outcome<()> {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match arguments[..] {
        ["simulate", rows, period, path] => simulate(rows.parse()?, period.parse()?, path.as_ref()),
        [how @ ("build" | "as-found"), path] => {
            build(how, path.as_ref(), &Workplace::default(), 20)
        }
        [how @ ("build" | "as-found"), path, place, ref rest @ ..] => {
            let path: &Path = path.as_ref();
            let scratch = match place {
                "disk" => ScratchPlace::Disk(path.parent().ok_or("no folder")?.to_owned()),
                _ => ScratchPlace::Memory,
            };
            let sample = rest.first().map_or(Ok(20), |sample| sample.parse())?;
            let parts = rest.get(1).map(|folder| Parts::new(folder.into(), "plant"));
            build(how, path, &Workplace { scratch, parts }, sample)
        }
        // `cargo test` and `cargo bench` run examples without arguments.
        _ => {
            println!(
                "plant_tables simulate ROWS PERIOD_SECS STATES.npy | build STATES.npy [memory | disk [VERIFY [PARTS]]] | as-found STATES.npy …"
            );
            Ok(())
        }
    }
}

fn plant(rows: usize, period_secs: f64) -> Outcome<Plant> {
    let period = Period::from_secs(period_secs).ok_or("the period must be positive")?;
    // The simulation is a little longer, because outages of the historian drop rows.
    let days = rows as f64 * period_secs / 86_400.0 * 1.05 + 1.0;
    Ok(Plant::new(PlantOptions { channels: CHANNELS, period, days, ..PlantOptions::default() })?)
}

/// Returns the smallest and largest value of every channel.
fn ranges(rows: usize, period_secs: f64) -> Outcome<Vec<(f32, f32)>> {
    let coarse_rows = (rows as f64 * period_secs / COARSE_SECS).ceil() as usize;
    let plant = plant(coarse_rows, COARSE_SECS)?;
    let mut ranges = vec![(f32::INFINITY, f32::NEG_INFINITY); plant.schema().len()];
    for day in plant {
        for (range, column) in ranges.iter_mut().zip(&day.columns) {
            for value in column.iter().filter(|value| value.is_finite()) {
                *range = (range.0.min(*value), range.1.max(*value));
            }
        }
    }
    Ok(ranges)
}

fn simulate(rows: usize, period_secs: f64, path: &Path) -> Outcome<()> {
    let ranges = ranges(rows, period_secs)?;
    let plant = plant(rows, period_secs)?;
    let alive: Vec<usize> =
        (0..ranges.len()).filter(|&c| plant.schema()[c].fate == Fate::Alive).collect();
    let mut last = vec![0.5_f32; alive.len()];
    let mut left = rows;
    let dictionary =
        format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({rows}, {}), }}", alive.len());
    let mut file = BufWriter::with_capacity(1 << 22, File::create(path)?);
    file.write_all(b"\x93NUMPY\x01\x00\xf6\x00")?;
    writeln!(file, "{dictionary:<245}")?;
    for day in plant {
        for row in 0..day.timestamps.len().min(left) {
            for (last, &channel) in last.iter_mut().zip(&alive) {
                let value = day.columns[channel][row];
                let (low, high) = ranges[channel];
                if value.is_finite() {
                    *last = (value - low) / (high - low).max(f32::MIN_POSITIVE);
                }
                file.write_all(&last.to_le_bytes())?;
            }
        }
        left -= day.timestamps.len().min(left);
        if left == 0 {
            break;
        }
    }
    file.flush()?;
    if left > 0 {
        return Err(format!("the plant ended {left} rows early").into());
    }
    Ok(())
}

/// Records the memory of this process.
struct Watch {
    peak_anonymous_kib: AtomicU64,
    peak_mapped_kib: AtomicU64,
    done: AtomicBool,
}

fn status_kib(key: &str) -> u64 {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix(key)?.strip_prefix(':'));
    line.and_then(|line| line.split_whitespace().next()?.parse().ok()).unwrap_or(0)
}

impl Watch {
    fn run(&self) {
        while !self.done.load(Ordering::Relaxed) {
            self.peak_anonymous_kib.fetch_max(status_kib("RssAnon"), Ordering::Relaxed);
            self.peak_mapped_kib.fetch_max(status_kib("RssFile"), Ordering::Relaxed);
            thread::sleep(Duration::from_millis(100));
        }
    }
}

/// Returns the processor seconds of this process so far.
fn processor_secs() -> f64 {
    let text = fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields: Vec<&str> =
        text.rsplit(')').next().unwrap_or_default().split_whitespace().collect();
    let ticks = fields.iter().skip(11).take(2).filter_map(|field| field.parse::<f64>().ok());
    ticks.sum::<f64>() / 100.0
}

fn build(how: &str, path: &Path, workplace: &Workplace, sample: usize) -> Outcome<()> {
    let mapped = map_npy::<f32>(path)?;
    let rows = mapped.rows();
    let columns = mapped.columns();
    let watch = Watch {
        peak_anonymous_kib: 0.into(),
        peak_mapped_kib: 0.into(),
        done: AtomicBool::new(false),
    };
    thread::scope(|scope| {
        scope.spawn(|| watch.run());
        let result = (|| -> Outcome<()> {
            let states = States::from_shared(Arc::new(mapped), rows, columns)?;
            let transitions = Transitions::new(Segments::from_lengths([rows])?);
            let clock = Instant::now();
            let processor = processor_secs();
            let config = ModelConfig { remove_traps: how == "build", ..ModelConfig::default() };
            let need = MemoryNeed::predict(rows, columns, &config, rayon::current_num_threads());
            let (model, built) =
                KnnModel::build_in(states, transitions, &config, workplace, &Silent)?;
            let wall = clock.elapsed().as_secs_f64();
            let processor = processor_secs() - processor;
            let verification = verify(&model, sample, Seed::new(0), &Silent)?;
            println!(
                "{{\"rows\": {rows}, \"columns\": {columns}, \"wall_secs\": {wall:.2}, \"processor_secs\": {processor:.2}, \
                 \"peak_kib\": {}, \"peak_anonymous_kib\": {}, \"peak_mapped_kib\": {}, \"verified\": {}, \"different\": {}, \"predicted_kib\": {}, \"index\": \"{}\"}}",
                status_kib("VmHWM"),
                watch.peak_anonymous_kib.load(Ordering::Relaxed),
                watch.peak_mapped_kib.load(Ordering::Relaxed),
                verification.rows,
                verification.different.len(),
                need.peak() / 1024,
                built.choice,
            );
            Ok(())
        })();
        watch.done.store(true, Ordering::Relaxed);
        result
    })
}
