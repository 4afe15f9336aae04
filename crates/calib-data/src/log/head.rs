//! Recognises a file of the log by its first rows.

use std::{fs::File, io::Read as _, path::Path};

use super::{
    file::{FieldKind, LogFile},
    partitioned_file::PartitionedFile,
    values::each_label,
};
use crate::{
    DataConfig, DataError,
    text::{Candidates, Decimal, Notation, TextFile, is_annotated, parse_number},
};

/// An opened file, of which only the head was read.
pub(crate) enum Head {
    Parquet(Box<LogFile>),
    Text(Box<TextFile>),
    /// Annotated CSV of InfluxDB, whose tables have headers of their own.
    Annotated(PartitionedFile, u64),
}

#[derive(Clone, Debug)]
pub(crate) struct HeadColumn {
    pub(crate) name: String,
    pub(crate) kind: FieldKind,
}

impl Head {
    pub(crate) fn open(source: PartitionedFile, data: &DataConfig) -> Result<Self, DataError> {
        if is_parquet(&source.path)? {
            return Ok(Self::Parquet(Box::new(LogFile::open(source)?)));
        }
        if is_annotated(&source.path)? {
            let bytes = crate::text::size(&source.path)?;
            return Ok(Self::Annotated(source, bytes));
        }
        Ok(Self::Text(Box::new(TextFile::open(&source.path, data)?)))
    }

    pub(crate) fn path(&self) -> &Path {
        match self {
            Self::Parquet(file) => file.path(),
            Self::Text(file) => &file.path,
            Self::Annotated(source, _) => &source.path,
        }
    }

    pub(crate) fn columns(&self) -> Vec<HeadColumn> {
        match self {
            Self::Parquet(file) => {
                let columns = file.fields.iter();
                columns
                    .map(|field| HeadColumn { name: field.name.clone(), kind: field.kind })
                    .collect()
            }
            Self::Text(file) => (0..file.columns().len())
                .map(|column| HeadColumn {
                    name: file.columns()[column].name.clone(),
                    kind: if column == 0 && file.dialect.has_row_names {
                        FieldKind::Other
                    } else if file.no_channels.contains(&column) {
                        FieldKind::Time
                    } else {
                        kind_of(&file.dialect.cells(column))
                    },
                })
                .collect(),
            Self::Annotated(..) => Vec::new(),
        }
    }

    /// Returns the first non-empty cells of a column, as text.
    pub(crate) fn sample(&self, column: usize) -> Result<Vec<String>, DataError> {
        match self {
            Self::Parquet(file) => {
                let rows = 0..file.rows.min(SAMPLE);
                if rows.is_empty() || column >= file.fields.len() {
                    return Ok(Vec::new());
                }
                let column = file.read(&[column], &rows)?.swap_remove(0);
                let mut labels = Vec::new();
                each_label(&column, |label| labels.extend(label.map(str::to_owned)))
                    .map_err(|error| file.damaged(&error))?;
                Ok(labels)
            }
            Self::Text(file) => {
                Ok(file.dialect.cells(column).into_iter().map(str::to_owned).collect())
            }
            Self::Annotated(..) => Ok(Vec::new()),
        }
    }

    /// The cells of two columns in the first rows that have both, as text.
    pub(super) fn pairs(&self, one: usize, other: usize) -> Result<Vec<[String; 2]>, DataError> {
        let file = match self {
            Self::Parquet(file) => file,
            Self::Text(file) => {
                let pairs = file.dialect.pairs(one, other).into_iter();
                return Ok(pairs.map(|pair| pair.map(str::to_owned)).collect());
            }
            Self::Annotated(..) => return Ok(Vec::new()),
        };
        let rows = 0..file.rows.min(SAMPLE);
        if rows.is_empty() {
            return Ok(Vec::new());
        }
        let mut read: [Vec<Option<String>>; 2] = Default::default();
        for (labels, column) in read.iter_mut().zip(file.read(&[one, other], &rows)?) {
            each_label(&column, |label| labels.push(label.map(str::to_owned)))
                .map_err(|error| file.damaged(&error))?;
        }
        let [first, second] = read;
        let pairs = first.into_iter().zip(second);
        Ok(pairs.filter_map(|(one, other)| Some([one?, other?])).collect())
    }
}

/// Number of rows of a Parquet file that are examined.
const SAMPLE: usize = 10_000;

/// Whether there are cells and all satisfy a condition, except for one in 20, which may be damaged.
pub(super) fn mostly(cells: &[&str], is: impl Fn(&str) -> bool) -> bool {
    let mut others = cells.iter().filter(|cell| !is(cell));
    !cells.is_empty() && others.nth(cells.len() / 20).is_none()
}

/// Returns the kind of a text column. A column without cells may become numbers.
fn kind_of(cells: &[&str]) -> FieldKind {
    if mostly(cells, is_time) {
        FieldKind::Time
    } else if cells.is_empty() || cells.iter().any(|cell| is_number(cell)) {
        FieldKind::Number
    } else {
        FieldKind::Text
    }
}

fn is_number(cell: &str) -> bool {
    [Decimal::Point, Decimal::Comma].iter().any(|&decimal| parse_number(cell, decimal).is_some())
}

/// Whether a cell is a time that is not a number.
fn is_time(cell: &str) -> bool {
    !is_number(cell)
        && Candidates::of(&[cell], None)
            .left
            .first()
            .is_some_and(|notation| !matches!(notation, Notation::Number(_)))
}

/// Whether a file is Parquet: by its name, or otherwise by its first bytes.
fn is_parquet(path: &Path) -> Result<bool, DataError> {
    if super::source::is_parquet(path) {
        return Ok(true);
    }
    let mut magic = Vec::new();
    let file: File = calib_files::open_regular(path)?;
    file.take(4)
        .read_to_end(&mut magic)
        .map_err(|source| calib_files::FileError::io("read", path, source))?;
    Ok(magic == b"PAR1" || magic.is_empty() && !super::source::is_text(path))
}
