//! A table of any content.

use std::fmt;

use calib_core::{count, number, percent};

/// Rows and columns with a title; the first column names the rows.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Table {
    /// Title above it.
    pub title: String,
    /// Explanation of the table in one or two sentences.
    pub caption: String,
    /// Column headings.
    pub columns: Vec<String>,
    /// Cells, `[rows, columns]`; missing cells at the end of a row stay empty.
    pub rows: Vec<Vec<Cell>>,
    /// The cells that are bold.
    pub best: Option<Best>,
}

/// One cell.
#[derive(Debug, Clone, PartialEq)]
pub enum Cell {
    /// Text.
    Text(String),
    /// A number, shown with three significant digits; "diverged" if it is not finite.
    Number(f64),
    /// A share, shown as a percentage.
    Percent(f64),
    /// A count, shown in full.
    Count(u64),
    /// A value of a hyperparameter.
    Setting(crate::Setting),
    /// An empty cell.
    Missing,
}

/// The cells that are bold.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Best {
    /// These cells, as (row, column): for example the best ones, and those without a clear difference from them. The caption
    /// says what bold means.
    Cells(Vec<(usize, usize)>),
    /// The largest number of each column.
    LargestOfColumn,
}

impl Cell {
    /// Returns the number by which the largest of a column is found.
    const fn score(&self) -> Option<f64> {
        match self {
            Self::Number(value) | Self::Percent(value) if value.is_finite() => Some(*value),
            _ => None,
        }
    }
}

impl fmt::Display for Cell {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Text(text) => out.write_str(text),
            Self::Number(value) => out.write_str(&number(*value)),
            Self::Percent(share) => out.write_str(&percent(*share)),
            Self::Count(value) => out.write_str(&count(*value)),
            Self::Setting(setting) => setting.fmt(out),
            Self::Missing => out.write_str("–"),
        }
    }
}

impl From<Option<f64>> for Cell {
    fn from(number: Option<f64>) -> Self {
        number.map_or(Self::Missing, Self::Number)
    }
}

impl Table {
    /// Whether cell (`row`, `column`) is bold: one of the largest of its column, or one of the listed cells.
    pub fn is_best(&self, row: usize, column: usize) -> bool {
        match &self.best {
            None => false,
            Some(Best::Cells(cells)) => cells.contains(&(row, column)),
            Some(Best::LargestOfColumn) => {
                let mut all = (0..self.rows.len()).filter_map(|row| self.score(row, column));
                self.score(row, column).is_some_and(|own| all.all(|other| other <= own))
            }
        }
    }

    /// Removes columns that are empty in all rows.
    #[must_use]
    pub fn without_empty_columns(mut self) -> Self {
        let used: Vec<bool> = (0..self.columns.len())
            .map(|column| {
                (0..self.rows.len())
                    .any(|row| self.cell(row, column).is_some_and(|cell| *cell != Cell::Missing))
            })
            .collect();
        if let Some(Best::Cells(cells)) = &mut self.best {
            cells.retain(|&(_, column)| is_used(&used, column));
            for (_, column) in cells {
                *column = (0..*column).filter(|&before| is_used(&used, before)).count();
            }
        }
        self.columns = retained(self.columns, &used);
        self.rows = self.rows.into_iter().map(|row| retained(row, &used)).collect();
        self
    }

    fn score(&self, row: usize, column: usize) -> Option<f64> {
        self.cell(row, column).and_then(Cell::score)
    }

    fn cell(&self, row: usize, column: usize) -> Option<&Cell> {
        self.rows.get(row)?.get(column)
    }
}

fn retained<T>(items: Vec<T>, used: &[bool]) -> Vec<T> {
    let items = items.into_iter().enumerate().filter(|(place, _)| is_used(used, *place));
    items.map(|(_, item)| item).collect()
}

/// Whether a column is used. Cells beyond the last column are not.
fn is_used(used: &[bool], column: usize) -> bool {
    used.get(column).copied().unwrap_or(false)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_without_content_go() {
        let table = Table {
            columns: ["a", "b", "c"].map(ToOwned::to_owned).to_vec(),
            rows: vec![
                vec![Cell::Count(1), Cell::Missing, Cell::Missing],
                vec![Cell::Count(2), Cell::Missing, Cell::Count(3)],
            ],
            best: Some(Best::Cells(vec![(0, 1), (1, 2)])),
            ..Table::default()
        };
        let table = table.without_empty_columns();
        assert_eq!(table.columns, ["a", "c"]);
        assert_eq!(table.best, Some(Best::Cells(vec![(1, 1)])));
        assert_eq!(table.rows[1], [Cell::Count(2), Cell::Count(3)]);
    }

    fn row(cells: [f64; 3]) -> Vec<Cell> {
        cells.map(Cell::Number).to_vec()
    }

    /// Returns the bold cells of two rows of three.
    fn best(table: &Table) -> Vec<(usize, usize)> {
        let cells = (0..2).flat_map(|r| (0..3).map(move |c| (r, c)));
        cells.filter(|&(r, c)| table.is_best(r, c)).collect()
    }

    #[test]
    fn the_largest_of_a_column_are_found_and_ties_share() {
        let mut table = Table {
            columns: vec![String::new(); 3],
            rows: vec![row([1.0, 2.0, 3.0]), row([f64::NAN, 0.5, 3.0])],
            best: Some(Best::LargestOfColumn),
            ..Table::default()
        };
        assert_eq!(best(&table), [(0, 0), (0, 1), (0, 2), (1, 2)]);
        table.best = Some(Best::Cells(vec![(1, 0)]));
        assert_eq!(best(&table), [(1, 0)]);
        table.best = None;
        assert_eq!(best(&table), []);
    }
}
