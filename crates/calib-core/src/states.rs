use std::{fmt, ops::Range, sync::Arc};

/// Normalised states, row-major `f32 [n, d]`, owned or memory-mapped, cheap to clone.
#[derive(Clone)]
pub struct States {
    values: Arc<dyn AsRef<[f32]> + Send + Sync>,
    /// Index of the first row in the storage.
    first: usize,
    rows: usize,
    columns: usize,
}

/// An error that prevents values from being a matrix of states.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum StatesError {
    /// The number of values is not rows × columns.
    #[error("expected {rows} x {columns} values, got {got}")]
    Shape {
        /// Expected rows.
        rows: usize,
        /// Expected columns.
        columns: usize,
        /// Number of values.
        got: usize,
    },
    /// A value is NaN or infinite.
    #[error("row {row}, column {column} is not finite")]
    NotFinite {
        /// Row of the first such value.
        row: usize,
        /// Column of the first such value.
        column: usize,
    },
}

impl States {
    /// Returns states that own `values`, row by row.
    ///
    /// # Errors
    /// If there are not `rows * columns` values, or one is not finite.
    pub fn new(values: Vec<f32>, rows: usize, columns: usize) -> Result<Self, StatesError> {
        Self::from_shared(Arc::new(values), rows, columns)
    }

    /// Returns the smallest and the largest value of each column; infinite without
    /// rows.
    pub fn extremes(&self) -> [Vec<f32>; 2] {
        let columns = self.columns;
        let mut lowest = vec![f32::INFINITY; columns];
        let mut highest = vec![f32::NEG_INFINITY; columns];
        for row in 0..self.rows {
            for (column, &value) in self.row(row).iter().enumerate() {
                lowest[column] = lowest[column].min(value);
                highest[column] = highest[column].max(value);
            }
        }
        [lowest, highest]
    }

    /// Returns states over shared storage, such as a mapped file.
    ///
    /// # Errors
    /// As [`States::new`].
    pub fn from_shared(
        values: Arc<dyn AsRef<[f32]> + Send + Sync>,
        rows: usize,
        columns: usize,
    ) -> Result<Self, StatesError> {
        let slice = (*values).as_ref();
        if rows.checked_mul(columns) != Some(slice.len()) {
            return Err(StatesError::Shape { rows, columns, got: slice.len() });
        }
        if let Some(position) = slice.iter().position(|value| !value.is_finite()) {
            return Err(StatesError::NotFinite {
                row: position / columns,
                column: position % columns,
            });
        }
        Ok(Self { values, first: 0, rows, columns })
    }

    /// Returns the number of rows `n`.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Returns the number of columns `d`.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Returns all values, row-major. Call this once outside a hot loop.
    pub fn as_slice(&self) -> &[f32] {
        &(*self.values).as_ref()[self.first * self.columns..][..self.rows * self.columns]
    }

    /// Returns some of the rows, over the same storage.
    ///
    /// # Panics
    /// If there are fewer rows.
    #[must_use]
    pub fn slice(&self, rows: Range<usize>) -> Self {
        assert!(rows.start <= rows.end && rows.end <= self.rows, "a slice lies inside");
        Self { first: self.first + rows.start, rows: rows.len(), ..self.clone() }
    }

    /// Returns one state.
    pub fn row(&self, row: usize) -> &[f32] {
        &self.as_slice()[row * self.columns..][..self.columns]
    }
}

impl fmt::Debug for States {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("States")
            .field("rows", &self.rows)
            .field("columns", &self.columns)
            .finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn extremes_are_of_each_column_of_the_rows_alone() {
        let states = States::new(vec![9.0, -9.0, 1.0, 5.0, 3.0, 4.0], 3, 2).unwrap();
        assert_eq!(states.slice(1..3).extremes(), [vec![1.0, 4.0], vec![3.0, 5.0]]);
    }

    #[test]
    fn rows_are_slices_of_the_values() {
        let states = States::new(vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0], 3, 2).expect("valid");
        assert_eq!(states.row(1), [3.0, 4.0]);
        assert_eq!((states.rows(), states.columns()), (3, 2));
        let tail = states.slice(1..3);
        assert_eq!((tail.rows(), tail.as_slice()), (2, &[3.0_f32, 4.0, 5.0, 6.0][..]));
        assert_eq!(tail.slice(1..2).row(0), [5.0, 6.0]);
    }

    #[test]
    fn bad_values_are_located() {
        let shape = States::new(vec![0.0; 5], 2, 3).expect_err("five values");
        assert_eq!(shape, StatesError::Shape { rows: 2, columns: 3, got: 5 });
        let nan = States::new(vec![0.0, 1.0, 2.0, f32::NAN], 2, 2).expect_err("NaN");
        assert_eq!(nan, StatesError::NotFinite { row: 1, column: 1 });
    }
}
