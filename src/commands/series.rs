//! Series on the command line: `FILE` or `FILE:COLUMN`.

use std::path::{Path, PathBuf};

use calib_data::{
    most_cells, number_columns,
    table::{Table, read_parquet, read_parquet_columns},
};
use calib_files::{array_bytes, read_array, read_regular, regular_bytes};
use calib_pipeline::{Context as _, StepError, bail, check_table, require_memory};

/// Most columns that a message lists.
const LISTED: usize = 20;

/// Samples of one or several channels, sample by sample.
#[derive(Debug, PartialEq)]
pub(super) struct Samples {
    pub(super) values: Vec<f64>,
    pub(super) channels: usize,
}

impl Samples {
    fn of_column(values: Vec<f64>) -> Self {
        Self { values, channels: 1 }
    }
}

/// A file, and one of its columns if given.
#[derive(Debug, PartialEq)]
struct SeriesFile {
    path: PathBuf,
    format: Format,
    column: Option<String>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    Npy,
    Csv,
    Parquet,
}

impl Format {
    const ALL: [(Self, &'static str); 3] =
        [(Self::Npy, ".npy"), (Self::Csv, ".csv"), (Self::Parquet, ".parquet")];
}

/// Reads the series that `text` names.
pub(super) fn read(text: &str) -> Result<Samples, StepError> {
    let source = source(text)?;
    let path = &source.path;
    let column = source.column.as_deref();
    match source.format {
        Format::Npy => from_npy(path, column),
        Format::Csv => from_csv(path, column).map(Samples::of_column),
        Format::Parquet => from_parquet(path, column).map(Samples::of_column),
    }
}

/// Returns the file of the series that `text` names, or `text` itself if it names no series.
pub(super) fn path(text: &str) -> PathBuf {
    source(text).map_or_else(|_| text.into(), |source| source.path)
}

/// Splits at the colon after the file's extension. Both parts may contain other colons.
fn source(text: &str) -> Result<SeriesFile, StepError> {
    let lower = text.to_ascii_lowercase();
    for (format, extension) in Format::ALL {
        if lower.ends_with(extension) {
            return Ok(SeriesFile { path: text.into(), format, column: None });
        }
        if let Some(start) = lower.find(&format!("{extension}:")) {
            let (path, column) = text.split_at(start + extension.len());
            let column = Some(column[1..].to_owned());
            return Ok(SeriesFile { path: path.into(), format, column });
        }
    }
    bail!(
        "cannot tell what `{text}` is: expected FILE.npy, FILE.csv or FILE.parquet, and perhaps :COLUMN"
    )
}

/// Reads a series `[n]` or `[n, channels]`. The column is the number of a channel.
fn from_npy(path: &Path, column: Option<&str>) -> Result<Samples, StepError> {
    let what = format!("reading {}", path.display());
    require_memory(array_bytes(path)?, &what, "take fewer samples or channels of it")?;
    let array = read_array(path)?;
    let channels = match array.shape.as_slice() {
        [_] => 1,
        &[_, channels] => channels,
        shape => bail!("{} has the shape {shape:?}: expected [n] or [n, channels]", path.display()),
    };
    let Some(column) = column else { return Ok(Samples { values: array.values, channels }) };
    let number = column.parse::<usize>().ok().filter(|&number| number < channels);
    let number = number.with_context(|| {
        format!(
            "{}: there is no channel `{column}`; expected a number below {channels}",
            path.display()
        )
    })?;
    Ok(Samples::of_column(array.values.into_iter().skip(number).step_by(channels).collect()))
}

/// Refuses a CSV file for which so many bytes of memory do not suffice.
fn require_for_csv(path: &Path, bytes: u64) -> Result<(), StepError> {
    let what = format!("reading {}", path.display());
    Ok(require_memory(bytes, &what, "take fewer rows or columns of it")?)
}

fn from_csv(path: &Path, column: Option<&str>) -> Result<Vec<f64>, StepError> {
    require_for_csv(path, regular_bytes(path)?)?;
    let text = read_regular(path)?;
    // A number has eight bytes.
    require_for_csv(path, 8 * most_cells(&text) as u64)?;
    let mut columns = number_columns(&text).map_err(|reason| {
        StepError::message(format!("{} is not a usable CSV file: {reason}", path.display()))
    })?;
    let position = if let Some(name) = column {
        columns.iter().position(|column| column.name == name).with_context(|| {
            let names = columns.iter().map(|column| column.name.as_str());
            let columns = listed(names);
            format!("{} has no column `{name}`; its columns are: {columns}", path.display())
        })?
    } else if columns.len() == 1 {
        // The column's own error names the line of a cell that is not a number.
        0
    } else {
        let names = columns.iter().map(|column| (column.name.as_str(), column.is_numeric()));
        only_numeric(path, &names.collect::<Vec<_>>())?
    };
    let column = columns.swap_remove(position);
    column.numbers.with_context(|| format!("{}, column `{}`", path.display(), column.name))
}

fn from_parquet(path: &Path, column: Option<&str>) -> Result<Vec<f64>, StepError> {
    let context = path.display().to_string();
    if let Some(name) = column {
        check_table(path, Some(&[name])).context(&context)?;
        let table = read_parquet_columns(path, &[name]).context(&context)?;
        return table.numbers(name).context(&context);
    }
    check_table(path, None).context(&context)?;
    let table = read_parquet(path)?;
    let names: Vec<(&str, bool)> = table
        .names()
        .map(|name| {
            let values = Table::values(&table, name);
            (name, values.is_some_and(|values| values.numbers().is_some()))
        })
        .collect();
    let name = names[only_numeric(path, &names)?].0;
    table.numbers(name).context(&context)
}

/// Returns the position of the only numeric column.
fn only_numeric(path: &Path, columns: &[(&str, bool)]) -> Result<usize, StepError> {
    let mut numeric = columns.iter().enumerate().filter(|(_, (_, is_numeric))| *is_numeric);
    match (numeric.next(), numeric.next()) {
        (Some((position, _)), None) => Ok(position),
        (Some(_), Some(_)) => {
            let names = columns.iter().filter(|(_, is_numeric)| *is_numeric);
            bail!(
                "{} has several numeric columns; choose one as {}:COLUMN from: {}",
                path.display(),
                path.display(),
                listed(names.map(|(name, _)| *name)),
            )
        }
        (None, _) => bail!(
            "{} has no numeric column; its columns are: {}",
            path.display(),
            listed(columns.iter().map(|(name, _)| *name)),
        ),
    }
}

fn listed<'a>(names: impl Iterator<Item = &'a str>) -> String {
    let names: Vec<&str> = names.collect();
    let shown = names[..names.len().min(LISTED)].join(", ");
    match names.len().saturating_sub(LISTED) {
        0 => shown,
        more => format!("{shown} and {more} more"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn source_of(text: &str) -> Result<(PathBuf, Option<String>), StepError> {
        source(text).map(|source| (source.path, source.column))
    }

    #[test]
    fn a_column_follows_the_extension() {
        let plain = (PathBuf::from("a.b/x.npy"), None);
        assert_eq!(source_of("a.b/x.npy").expect("a file"), plain);
        let column = (PathBuf::from("C:\\logs\\x.CSV"), Some("flow: total".to_owned()));
        assert_eq!(source_of("C:\\logs\\x.CSV:flow: total").expect("a file"), column);
    }
}
