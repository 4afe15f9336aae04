use std::path::Path;

use calib_base::{Context as _, StepError, artefact::write_table, ensure};
use calib_core::Timestamp;
use calib_data::table::{Table, read_parquet};
use calib_files::remove_file;
use calib_study::{Job, StepKind};

use super::{MEASURES, pair::Pair};
use crate::STEP_PATTERNS;

const DTW: &str = "dtw.parquet";
const OTHERS: &str = "measures.parquet";

/// The files of a comparison.
pub(crate) const FILES: [&str; 2] = [DTW, OTHERS];

/// Writes one row per rollout, sensor and step pattern, and one row per rollout and
/// sensor.
pub(crate) fn write(directory: &Path, pairs: &[Pair]) -> Result<(), StepError> {
    write_table(dtw(pairs), &directory.join(DTW))?;
    write_table(measures(pairs), &directory.join(OTHERS))
}

/// Removes the files of an earlier run, if nothing is compared any more.
pub(crate) fn remove(directory: &Path) -> Result<(), StepError> {
    for name in FILES {
        remove_file(&directory.join(name))?;
    }
    Ok(())
}

/// Reads the pairs that were written beside the rollouts of a job.
///
/// # Errors
/// If the tables cannot be read, or are not of one comparison.
pub fn read(job: &Job) -> Result<Vec<Pair>, StepError> {
    of_directory(&job.layout().rollout())
        .with_context(|| format!("run `{} --force`", job.command(StepKind::Rollout)))
}

fn of_directory(directory: &Path) -> Result<Vec<Pair>, StepError> {
    let dtw = directory.join(DTW);
    let others = directory.join(OTHERS);
    let pairs = from_tables(&read_parquet(&dtw)?, &read_parquet(&others)?);
    pairs.with_context(|| {
        format!("{} and {} are not those of one comparison", dtw.display(), others.display())
    })
}

/// Returns the columns that identify the pair of a row, with `rows` rows per pair.
fn of_pairs(pairs: &[Pair], rows: usize) -> Table {
    fn repeat<T: Clone>(values: impl Iterator<Item = T>, rows: usize) -> Vec<T> {
        values.flat_map(|value| std::iter::repeat_n(value, rows)).collect()
    }
    Table::new()
        .with("member", repeat(pairs.iter().map(|pair| pair.member), rows))
        .with("rollout", repeat(pairs.iter().map(|pair| pair.rollout), rows))
        .with("wanted_row", repeat(pairs.iter().map(|pair| pair.wanted), rows))
        .with("wanted_timestamp", repeat(pairs.iter().map(|pair| pair.start), rows))
        .with("sensor", repeat(pairs.iter().map(|pair| pair.sensor.clone()), rows))
        .with("steps", repeat(pairs.iter().map(|pair| pair.steps), rows))
}

fn dtw(pairs: &[Pair]) -> Table {
    let (raw, normalised): (Vec<f64>, Vec<Option<f64>>) =
        pairs.iter().flat_map(|pair| &pair.warping).copied().unzip();
    let patterns = pairs.iter().flat_map(|_| STEP_PATTERNS.map(str::to_owned));
    of_pairs(pairs, STEP_PATTERNS.len())
        .with("step_pattern", patterns.collect::<Vec<String>>())
        .with("distance", raw)
        .with_optional("normalized_distance", normalised)
}

fn measures(pairs: &[Pair]) -> Table {
    let mut table = of_pairs(pairs, 1);
    for (number, measure) in MEASURES.iter().enumerate() {
        let values: Vec<Option<f64>> = pairs.iter().map(|pair| pair.measures[number]).collect();
        table = table.with_optional(measure.column, values);
    }
    table
}

/// Returns the pairs of both tables, which have their rows in the same order.
fn from_tables(dtw: &Table, others: &Table) -> Result<Vec<Pair>, StepError> {
    let patterns = STEP_PATTERNS.len();
    ensure!(dtw.rows() == patterns * others.rows(), "there are not {patterns} rows for each");
    let names = dtw.column::<String>("step_pattern")?;
    ensure!(
        names.chunks_exact(patterns).all(|names| names == STEP_PATTERNS),
        "the step patterns are not {}",
        STEP_PATTERNS.join(", ")
    );
    let raw = dtw.column::<f64>("distance")?;
    let normalised = dtw.optional::<f64>("normalized_distance")?;
    let warping = raw.iter().copied().zip(normalised).collect::<Vec<_>>();
    let measures = MEASURES.iter().map(|measure| others.optional::<f64>(measure.column));
    let measures = measures.collect::<Result<Vec<_>, _>>()?;
    let members = others.column::<u32>("member")?;
    let rollouts = others.column::<u32>("rollout")?;
    let wanted = others.column::<u32>("wanted_row")?;
    let steps = others.column::<u32>("steps")?;
    let starts = others.column::<Timestamp>("wanted_timestamp")?;
    let sensors = others.column::<String>("sensor")?;
    let of_warping = [dtw.column::<u32>("member")?, dtw.column::<u32>("rollout")?];
    warping
        .chunks_exact(patterns)
        .enumerate()
        .map(|(row, warping)| {
            let same = [members, rollouts].map(|column| column[row]);
            ensure!(
                of_warping.map(|column| column[row * patterns]) == same,
                "row {row} is of another rollout"
            );
            Ok(Pair {
                member: members[row],
                rollout: rollouts[row],
                wanted: wanted[row],
                start: starts[row],
                sensor: sensors[row].clone(),
                steps: steps[row],
                warping: warping.to_vec(),
                measures: measures.iter().map(|column| column[row]).collect(),
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rollouts::comparison::pair::tests::pair;

    #[test]
    fn what_is_written_is_read() {
        let mut pairs = vec![pair(0, 5, 1.0), pair(1, 5, 3.0), pair(0, 90, 4.0)];
        pairs[1].measures[2] = None;
        pairs[2].warping[1].1 = None;
        let directory = tempfile::tempdir().expect("a directory");
        write(directory.path(), &pairs).expect("writable");
        assert_eq!(of_directory(directory.path()).expect("readable"), pairs);
        write(directory.path(), &[]).expect("writable");
        assert_eq!(of_directory(directory.path()).expect("readable"), []);
    }

    #[test]
    fn files_that_do_not_belong_together_are_refused() {
        let directory = tempfile::tempdir().expect("a directory");
        write(directory.path(), &[pair(0, 5, 1.0)]).expect("writable");
        measures(&[pair(0, 5, 1.0), pair(1, 5, 1.0)])
            .write_parquet(&directory.path().join(OTHERS))
            .expect("writable");
        let refused =
            format!("{}", of_directory(directory.path()).expect_err("one row is missing"));
        assert!(refused.contains("not those of one comparison"), "{refused}");
        measures(&[pair(1, 5, 1.0)])
            .write_parquet(&directory.path().join(OTHERS))
            .expect("writable");
        let refused = format!("{}", of_directory(directory.path()).expect_err("another member"));
        assert!(refused.contains("row 0 is of another rollout"), "{refused}");
        remove(directory.path()).expect("there");
        remove(directory.path()).expect("nothing to do");
        assert!(of_directory(directory.path()).is_err());
    }
}
