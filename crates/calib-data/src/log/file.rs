//! One Parquet file of the log.

use std::{
    collections::BTreeSet,
    ops::Range,
    path::Path,
    sync::{Arc, Mutex},
};

use calib_core::locked;
use calib_files::{FileError, HeldFile};
use pl::SerReader as _;
use polars::prelude as pl;
use rayon::prelude::*;

use super::{
    partitioned_file::PartitionedFile,
    store::Stored,
    values::{RawColumn, each_label},
};
use crate::{
    DataConfig, DataError, Description,
    catch_panic::catch_panic,
    checksums, statistics,
    table::RESULTS_KEY,
    text::{TextFile, is_value},
};

/// Number of rows that are read at a time, unless a row group has more. It bounds the memory that is
/// held twice.
const SLICE_ROWS: usize = 1 << 20;

/// A file whose footer has been read.
pub(crate) struct LogFile {
    pub(crate) source: PartitionedFile,
    pub(crate) fields: Vec<Field>,
    pub(crate) rows: usize,
    pub(crate) bytes: u64,
    /// Whether calib wrote the file as a result, not as a log.
    pub(crate) is_result: bool,
    /// Columns that are not channels: parts of times, and row names.
    pub(crate) no_channels: Vec<usize>,
    content: Content,
}

/// Location of the columns.
enum Content {
    Parquet(Parquet),
    /// Columns of a text file, which lie in a store.
    Stored(Stored),
}

struct Parquet {
    /// Handle that is opened once for all columns and threads.
    file: HeldFile,
    metadata: Arc<pl::FileMetadata>,
    /// Fields whose pages have been checked.
    checked: Mutex<BTreeSet<usize>>,
}

#[derive(Clone, Debug)]
pub(crate) struct Field {
    pub(crate) name: String,
    pub(crate) kind: FieldKind,
    /// Name of the type for users.
    pub(crate) type_name: String,
    /// Description from the header.
    pub(crate) description: Description,
}

/// The kind of data in a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum FieldKind {
    /// Numbers and booleans.
    Number,
    /// Text, which may hold numbers.
    Text,
    /// Dates and instants.
    Time,
    /// No supported type.
    Other,
}

impl LogFile {
    pub(crate) fn open(source: PartitionedFile) -> Result<Self, DataError> {
        let file = HeldFile::open(&source.path)?;
        let footer = file.file()?;
        let bytes =
            footer.metadata().map_err(|error| FileError::io("read", &source.path, error))?.len();
        if bytes == 0 {
            return Err(DataError::not_parquet(&source.path, "it is empty".to_owned()));
        }
        let (metadata, schema) = catch_panic(|| {
            let mut reader = pl::ParquetReader::new(footer);
            Ok((Arc::clone(reader.get_metadata()?), reader.schema()?))
        })
        .map_err(|reason| DataError::not_parquet(&source.path, reason))?;
        let groups = metadata.row_groups.iter();
        let rows = groups.fold(0_usize, |rows, group| rows.saturating_add(group.num_rows()));
        if rows != metadata.num_rows {
            let declared = metadata.num_rows;
            let reason = format!("it declares {declared} rows and has {rows}");
            return Err(DataError::not_parquet(&source.path, reason));
        }
        let fields = schema
            .iter()
            .map(|(name, field)| {
                let (kind, type_name) = classify(field.dtype());
                Field {
                    name: name.to_string(),
                    kind,
                    type_name,
                    description: Description::default(),
                }
            })
            .collect();
        let is_result =
            metadata.key_value_metadata.iter().flatten().any(|entry| entry.key == RESULTS_KEY);
        let content = Content::Parquet(Parquet { file, metadata, checked: Mutex::default() });
        Ok(Self { source, fields, rows, bytes, is_result, no_channels: Vec::new(), content })
    }

    /// Creates a text file that was read into `stored`.
    pub(crate) fn stored(
        source: PartitionedFile,
        fields: Vec<Field>,
        file: &TextFile,
        stored: Stored,
    ) -> Self {
        let rows = stored.columns.rows;
        let content = Content::Stored(stored);
        let bytes = file.bytes;
        let no_channels = file.no_channels.clone();
        Self { source, fields, rows, bytes, is_result: false, no_channels, content }
    }

    /// Returns the timestamps of a file that was text.
    pub(crate) fn stored_times(&self) -> Option<Vec<i64>> {
        match &self.content {
            Content::Parquet(_) => None,
            Content::Stored(stored) => Some(stored.times.clone()),
        }
    }

    pub(crate) fn path(&self) -> &Path {
        &self.source.path
    }

    /// Returns for each of some rows whether `data.where` selects it; `None` without such a filter.
    pub(crate) fn chosen(
        &self,
        rows: &Range<usize>,
        data: &DataConfig,
    ) -> Result<Option<Vec<bool>>, DataError> {
        if data.only.is_empty() {
            return Ok(None);
        }
        let mut chosen = vec![true; rows.len()];
        for (name, value) in &data.only {
            let names = self.fields.iter().map(|field| field.name.as_str());
            let field = self.field(name);
            let field = field.ok_or_else(|| DataError::where_column(self.path(), name, names))?;
            let column = self.read(&[field], rows)?.swap_remove(0);
            let mut flags = chosen.iter_mut();
            each_label(&column, |label| {
                if let Some(flag) = flags.next() {
                    *flag &= label.is_some_and(|label| is_value(label, value));
                }
            })
            .map_err(|error| self.damaged(&error))?;
        }
        Ok(Some(chosen))
    }

    /// Returns the position of the column called `name`.
    pub(crate) fn field(&self, name: &str) -> Option<usize> {
        self.fields.iter().position(|field| field.name == name)
    }

    /// Returns slices of whole row groups that cover `rows`, cut to `rows`.
    pub(crate) fn slices(&self, rows: &Range<usize>) -> Vec<Range<usize>> {
        let groups: Vec<usize> = match &self.content {
            Content::Parquet(parquet) => {
                let mut groups = Vec::new();
                for group in &parquet.metadata.row_groups {
                    groups.push(group.num_rows());
                }
                groups
            }
            Content::Stored(_) => (0..self.rows)
                .step_by(SLICE_ROWS)
                .map(|from| SLICE_ROWS.min(self.rows - from))
                .collect(),
        };
        let mut slices: Vec<Range<usize>> = Vec::new();
        let mut start = 0;
        for group in groups {
            let end = start + group;
            let inside = start.max(rows.start)..end.min(rows.end);
            start = end;
            match slices.last_mut() {
                _ if inside.is_empty() => {}
                Some(last) if inside.end - last.start <= SLICE_ROWS => last.end = inside.end,
                _ => slices.push(inside),
            }
        }
        slices
    }

    /// Reads some columns of some rows, one column for each of `fields`.
    pub(crate) fn read(
        &self,
        fields: &[usize],
        rows: &Range<usize>,
    ) -> Result<Vec<RawColumn>, DataError> {
        match &self.content {
            Content::Parquet(parquet) => {
                let columns = self.read_parquet(parquet, fields, rows)?;
                Ok(columns.into_iter().map(RawColumn::Polars).collect())
            }
            Content::Stored(Stored { columns, store, .. }) => fields
                .iter()
                .map(|&field| {
                    let cells = columns.read(field, rows, store)?;
                    Ok(RawColumn::Cells(cells, Arc::clone(store)))
                })
                .collect(),
        }
    }

    fn read_parquet(
        &self,
        parquet: &Parquet,
        fields: &[usize],
        rows: &Range<usize>,
    ) -> Result<Vec<pl::Column>, DataError> {
        self.check_pages(parquet, fields)?;
        let file = parquet.file.file()?;
        let columns = catch_panic(|| {
            let mut reader = pl::ParquetReader::new(file);
            reader.set_metadata(Arc::clone(&parquet.metadata));
            let frame = reader
                .with_projection(Some(fields.to_vec()))
                .with_slice(Some((rows.start, rows.len())))
                .read_parallel(pl::ParallelStrategy::Columns)
                .finish()?;
            let names = fields.iter().map(|&field| &self.fields[field].name);
            names.map(|name| frame.column(name).cloned()).collect::<pl::PolarsResult<Vec<_>>>()
        })
        .map_err(|reason| self.not_parquet(reason))?;
        if columns.iter().any(|column| column.len() != rows.len()) {
            return Err(self.not_parquet(format!("fewer rows than the {} it declares", self.rows)));
        }
        fields.par_iter().zip(&columns).try_for_each(|(&field, column)| {
            statistics::verify(&parquet.metadata, &self.fields[field].name, rows, column)
                .map_err(|reason| self.not_parquet(reason))
        })?;
        Ok(columns)
    }

    /// Checks the pages of `fields` that have not been checked yet: the reader ignores their checksums.
    fn check_pages(&self, parquet: &Parquet, fields: &[usize]) -> Result<(), DataError> {
        let mut checked = locked(&parquet.checked);
        let left: BTreeSet<&str> = fields
            .iter()
            .filter(|field| !checked.contains(field))
            .map(|&field| self.fields[field].name.as_str())
            .collect();
        if !left.is_empty() {
            checksums::verify(self.path(), &parquet.file, &parquet.metadata, |name| {
                left.contains(name)
            })?
            .map_err(|reason| self.not_parquet(reason))?;
            checked.extend(fields);
        }
        Ok(())
    }

    pub(crate) fn damaged(&self, error: &pl::PolarsError) -> DataError {
        self.not_parquet(error.to_string())
    }

    fn not_parquet(&self, reason: String) -> DataError {
        DataError::not_parquet(self.path(), reason)
    }
}

pub(crate) fn classify(dtype: &pl::ArrowDataType) -> (FieldKind, String) {
    use pl::ArrowDataType as D;
    match dtype {
        D::Boolean => (FieldKind::Number, "bool".to_owned()),
        D::Float16 | D::Float32 | D::Float64 => number("f", dtype, "Float"),
        D::Int8 | D::Int16 | D::Int32 | D::Int64 => number("i", dtype, "Int"),
        D::UInt8 | D::UInt16 | D::UInt32 | D::UInt64 => number("u", dtype, "UInt"),
        D::Decimal(..) | D::Decimal32(..) | D::Decimal64(..) | D::Decimal256(..) => {
            (FieldKind::Number, "decimal".to_owned())
        }
        D::Utf8 | D::LargeUtf8 | D::Utf8View => (FieldKind::Text, "text".to_owned()),
        D::Dictionary(_, values, _) => match classify(values) {
            (FieldKind::Text, _) => (FieldKind::Text, "category".to_owned()),
            _ => (FieldKind::Other, format!("{dtype:?}").to_lowercase()),
        },
        D::Date32 | D::Date64 => (FieldKind::Time, "date".to_owned()),
        D::Timestamp(_, None) => (FieldKind::Time, "datetime".to_owned()),
        D::Timestamp(_, Some(zone)) => (FieldKind::Time, format!("datetime in {zone}")),
        D::List(_) | D::LargeList(_) | D::FixedSizeList(..) => {
            (FieldKind::Other, "list".to_owned())
        }
        D::Struct(_) | D::Map(..) => (FieldKind::Other, "struct".to_owned()),
        D::Binary | D::LargeBinary | D::BinaryView | D::FixedSizeBinary(_) => {
            (FieldKind::Other, "binary".to_owned())
        }
        D::Duration(_) => (FieldKind::Other, "duration".to_owned()),
        D::Time32(_) | D::Time64(_) => (FieldKind::Other, "time of day".to_owned()),
        other => (FieldKind::Other, format!("{other:?}").to_lowercase()),
    }
}

/// Shortens the name of a type: `Float32` becomes f32.
fn number(prefix: &str, dtype: &pl::ArrowDataType, arrow: &str) -> (FieldKind, String) {
    let name = format!("{dtype:?}").replace(arrow, prefix);
    (FieldKind::Number, name)
}
