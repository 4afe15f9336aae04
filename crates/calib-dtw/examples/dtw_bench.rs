//! Times distances of series in raw files. The peer comparison in `scripts/peers/dtw.py` runs it.
//!
//! ```text
//! dtw_bench MODE REPEATS PATTERNS QUERY.f64 REFERENCE.f64 [LENGTH]
//! ```
//!
//! MODE is `distance` (each pattern alone), `table` (all patterns of a pair) or `align` (with the
//! path). With `:squared` the local distance is (x − y)² instead of |x − y|. PATTERNS are names,
//! separated by commas. The files contain little-endian `f64`. With LENGTH they contain many pairs
//! one after the other, with that many samples per series. Runs in one thread unless
//! `RAYON_NUM_THREADS` sets another number. Prints one line of JSON: wall seconds of each repeat,
//! mean processor seconds per repeat, cells per repeat, raw distances, peak memory in KiB.

use std::{error::Error, fs, time::Instant};

use calib_dtw::{Dtw, InstructionSet, LocalDistance, PatternSet, Series, Settings, StepPattern};

fn read(path: &str) -> Result<Vec<f64>, Box<dyn Error>> {
    let bytes = fs::read(path)?;
    let (values, rest) = bytes.as_chunks::<8>();
    if !rest.is_empty() {
        return Err(format!("{path} holds no whole number of f64").into());
    }
    Ok(values.iter().map(|bytes| f64::from_le_bytes(*bytes)).collect())
}

/// Returns the peak resident memory of this process in KiB, if the system reports it.
fn peak_kib() -> Option<u64> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmHWM:"))?;
    line.split_whitespace().nth(1)?.parse().ok()
}

/// Returns the processor seconds of this thread so far, if the system reports them.
fn processor_seconds() -> Option<f64> {
    let statistics = fs::read_to_string("/proc/thread-self/schedstat").ok()?;
    let nanoseconds: f64 = statistics.split_whitespace().next()?.parse().ok()?;
    Some(nanoseconds * 1e-9)
}

fn run(
    mode: &str,
    settings: Settings,
    patterns: &[StepPattern],
    pairs: &[(Series<'_>, Series<'_>)],
) -> Result<Vec<f64>, Box<dyn Error>> {
    let mut raw = Vec::new();
    if mode == "table" {
        let set = PatternSet::new(patterns, settings);
        for distances in set.distances_of_pairs(pairs) {
            for distance in distances? {
                raw.push(distance?.raw);
            }
        }
        return Ok(raw);
    }
    for pattern in patterns {
        let dtw = Dtw::with_settings(pattern.clone(), settings);
        if mode == "align" {
            for &(query, reference) in pairs {
                raw.push(dtw.align(query, reference)?.distance.raw);
            }
        } else {
            for distance in dtw.distances(pairs) {
                raw.push(distance?.raw);
            }
        }
    }
    Ok(raw)
}

#[expect(clippy::print_stdout, reason = "the result of this program")]
#[expect(clippy::disallowed_methods, reason = "a benchmark reads the clock")]
fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [mode, repeats, names, query, reference, length @ ..] = arguments.as_slice() else {
        return Err("usage: dtw_bench MODE REPEATS PATTERNS QUERY REFERENCE [LENGTH]".into());
    };
    if std::env::var_os("RAYON_NUM_THREADS").is_none() {
        rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread().build_global()?;
    }
    let (mode, local_distance) = match mode.split_once(':') {
        Some((mode, "squared")) => (mode, LocalDistance::Squared),
        Some((_, other)) => return Err(format!("unknown local distance {other}").into()),
        None => (mode.as_str(), LocalDistance::Absolute),
    };
    let settings = Settings { local_distance, ..Settings::default() };
    let patterns = names.split(',').map(str::parse).collect::<Result<Vec<StepPattern>, _>>()?;
    let query = read(query)?;
    let reference = read(reference)?;
    let length = match length.first() {
        Some(length) => length.parse()?,
        None => query.len().max(reference.len()),
    };
    let pairs: Vec<_> = query
        .chunks(length)
        .zip(reference.chunks(length))
        .map(|(query, reference)| (Series::new(query), Series::new(reference)))
        .collect();
    let cells: usize = pairs.iter().map(|(query, reference)| query.len() * reference.len()).sum();
    let repeats: u32 = repeats.parse()?;
    let mut seconds = Vec::new();
    let mut raw = Vec::new();
    let busy = processor_seconds();
    for _ in 0..repeats {
        let start = Instant::now();
        raw = run(mode, settings, &patterns, &pairs)?;
        seconds.push(start.elapsed().as_secs_f64());
    }
    // The processor clock is coarse, so the mean over all repeats is reported.
    let busy = processor_seconds().zip(busy).map(|(now, then)| now - then);
    let processor = busy.map_or(f64::NAN, |busy| busy / f64::from(repeats));
    println!(
        "{{\"seconds\": {seconds:?}, \"processor\": {processor}, \"cells\": {}, \"raw\": {raw:?}, \"peak_kib\": {}, \
         \"instructions\": \"{}\"}}",
        cells * patterns.len(),
        peak_kib().unwrap_or(0),
        InstructionSet::best(),
    );
    Ok(())
}
