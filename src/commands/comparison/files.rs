use std::{fs, io, path::Path};

use anyhow::Context as _;
use calib_data::table::Table;

use super::{MEASURES, Pair};
use crate::cli::STEP_PATTERNS;

const DTW: &str = "dtw.parquet";
const OTHERS: &str = "measures.parquet";

/// Write one row a rollout, sensor and step pattern, and one row a rollout and sensor.
pub(in crate::commands) fn write(
    directory: &Path,
    pairs: &[Pair],
    sensors: &[(String, usize)],
) -> anyhow::Result<()> {
    dtw(pairs, sensors).write_parquet(&directory.join(DTW))?;
    measures(pairs, sensors).write_parquet(&directory.join(OTHERS))?;
    Ok(())
}

/// Remove what an earlier run wrote, where nothing is compared any more.
pub(in crate::commands) fn remove(directory: &Path) -> anyhow::Result<()> {
    for name in [DTW, OTHERS] {
        let path = directory.join(name);
        match fs::remove_file(&path) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => {
                return Err(error).with_context(|| format!("cannot remove {}", path.display()));
            }
            _ => {}
        }
    }
    Ok(())
}

/// The columns that say which pair a row is about; `rows` rows a pair.
fn of_pairs(pairs: &[Pair], sensors: &[(String, usize)], rows: usize) -> Table {
    fn repeat<T: Clone>(values: impl Iterator<Item = T>, rows: usize) -> Vec<T> {
        values.flat_map(|value| std::iter::repeat_n(value, rows)).collect()
    }
    let name = |pair: &Pair| sensors[pair.sensor].0.clone();
    Table::new()
        .with("member", repeat(pairs.iter().map(|pair| pair.member as u32), rows))
        .with("rollout", repeat(pairs.iter().map(|pair| pair.rollout as u32), rows))
        .with("sensor", repeat(pairs.iter().map(name), rows))
        .with("steps", repeat(pairs.iter().map(|pair| pair.steps as u32), rows))
}

fn dtw(pairs: &[Pair], sensors: &[(String, usize)]) -> Table {
    let distances = || pairs.iter().flat_map(|pair| &pair.distances);
    let patterns = pairs.iter().flat_map(|_| STEP_PATTERNS.map(str::to_owned));
    let found = |distance: &calib_dtw::Distance| distance.normalised;
    of_pairs(pairs, sensors, STEP_PATTERNS.len())
        .with("step_pattern", patterns.collect::<Vec<String>>())
        .with_optional(
            "distance",
            distances().map(|of| of.as_ref().ok().map(|of| of.raw)).collect::<Vec<Option<f64>>>(),
        )
        .with_optional(
            "normalized_distance",
            distances().map(|of| of.as_ref().ok().and_then(found)).collect::<Vec<Option<f64>>>(),
        )
}

fn measures(pairs: &[Pair], sensors: &[(String, usize)]) -> Table {
    let mut table = of_pairs(pairs, sensors, 1);
    for (number, measure) in MEASURES.iter().enumerate() {
        let values: Vec<Option<f64>> = pairs.iter().map(|pair| pair.measures[number]).collect();
        table = table.with_optional(measure.column, values);
    }
    table
}
