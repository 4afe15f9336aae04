//! Tidy tables: typed columns with optional values, and text metadata, in Parquet files.
//!
//! ```
//! use calib_data::table::{Table, read_parquet};
//!
//! # let directory = tempfile::tempdir()?;
//! let path = directory.path().join("runs.parquet");
//! Table::new()
//!     .with("step_size", vec![1e-4, 1e-3])
//!     .with("sensor", vec!["PIT300".to_owned(), "PIT300".to_owned()])
//!     .with_optional("nrmse", vec![Some(0.25), None])
//!     .with_metadata("format", "1")
//!     .write_parquet(&path)?;
//! let table = read_parquet(&path)?;
//! assert_eq!(table.column::<f64>("step_size")?, [1e-4, 1e-3]);
//! assert_eq!(table.optional::<f64>("nrmse")?, [Some(0.25), None]);
//! assert_eq!(table.metadata("format"), Some("1"));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod cells;
mod error;
mod lists;
mod log;
mod read;
mod write;

use std::collections::BTreeMap;

pub use cells::{Cell, Cells, Values};
pub use error::TableError;
pub use lists::{Lists, parquet_names, read_parquet_list};
pub use log::write_log;
pub use read::{declared_bytes, read_parquet, read_parquet_columns};
pub(crate) use write::write_frame;

/// Key of the metadata that marks a table as a result, which is not a log. A folder that is searched for logs may
/// contain results.
pub const RESULTS_KEY: &str = "calib.result";

/// Columns of equal length, in order, with text metadata.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Table {
    columns: Vec<(String, Values)>,
    metadata: BTreeMap<String, String>,
}

impl Table {
    /// Creates a table without columns.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a column without missing values.
    ///
    /// # Panics
    /// If the name is taken, or the other columns have another length.
    #[must_use]
    pub fn with<T: Cell>(self, name: impl Into<String>, values: Vec<T>) -> Self {
        self.with_values(name, T::wrap(Cells::Full(values)))
    }

    /// Adds a column in which values may be missing.
    ///
    /// # Panics
    /// As [`Table::with`].
    #[must_use]
    pub fn with_optional<T: Cell>(self, name: impl Into<String>, values: Vec<Option<T>>) -> Self {
        self.with_values(name, T::wrap(Cells::Optional(values)))
    }

    /// Adds a column of any type.
    ///
    /// # Panics
    /// As [`Table::with`].
    #[must_use]
    pub fn with_values(mut self, name: impl Into<String>, values: Values) -> Self {
        let name = name.into();
        assert!(self.values(&name).is_none(), "a table has one column called {name}");
        assert!(
            self.columns.is_empty() || values.len() == self.rows(),
            "column {name} has {} rows, the table has {}",
            values.len(),
            self.rows()
        );
        self.columns.push((name, values));
        self
    }

    /// Adds a metadata entry, which replaces an earlier one with the same key.
    #[must_use]
    pub fn with_metadata(mut self, key: impl Into<String>, value: impl Into<String>) -> Self {
        self.metadata.insert(key.into(), value.into());
        self
    }

    /// Returns the number of rows.
    pub fn rows(&self) -> usize {
        self.columns.first().map_or(0, |(_, values)| values.len())
    }

    /// Returns the names of the columns, in order.
    pub fn names(&self) -> impl ExactSizeIterator<Item = &str> {
        self.columns.iter().map(|(name, _)| name.as_str())
    }

    /// Returns the metadata under `key`.
    pub fn metadata(&self, key: &str) -> Option<&str> {
        self.metadata.get(key).map(String::as_str)
    }

    /// Returns the column called `name`, of any type.
    pub fn values(&self, name: &str) -> Option<&Values> {
        self.columns.iter().find_map(|(column, values)| (column == name).then_some(values))
    }

    /// Returns the values of a column without missing values.
    ///
    /// # Errors
    /// If there is no such column, it has another type, or a value is missing.
    pub fn column<T: Cell>(&self, name: &str) -> Result<&[T], TableError> {
        match self.cells(name)? {
            Cells::Full(values) => Ok(values),
            Cells::Optional(values) => Err(TableError::MissingValue {
                name: name.to_owned(),
                row: values.iter().position(Option::is_none).unwrap_or_default(),
            }),
        }
    }

    /// Returns the values of a column in which some may be missing.
    ///
    /// # Errors
    /// If there is no such column, or it has another type.
    pub fn optional<T: Cell>(&self, name: &str) -> Result<Vec<Option<T>>, TableError> {
        Ok(match self.cells::<T>(name)? {
            Cells::Full(values) => values.iter().cloned().map(Some).collect(),
            Cells::Optional(values) => values.clone(),
        })
    }

    /// Returns the values of a column of any number type as `f64`, NaN for missing ones.
    ///
    /// # Errors
    /// If there is no such column, or it does not hold numbers.
    pub fn numbers(&self, name: &str) -> Result<Vec<f64>, TableError> {
        let values = self.found(name)?;
        values.numbers().ok_or_else(|| TableError::wrong_type(name, "numbers", values))
    }

    fn cells<T: Cell>(&self, name: &str) -> Result<&Cells<T>, TableError> {
        let values = self.found(name)?;
        T::unwrap(values).ok_or_else(|| TableError::wrong_type(name, T::NAME, values))
    }

    fn found(&self, name: &str) -> Result<&Values, TableError> {
        self.values(name).ok_or_else(|| TableError::NoColumn {
            name: name.to_owned(),
            available: self.names().map(str::to_owned).collect(),
        })
    }
}

#[cfg(test)]
mod tests;
