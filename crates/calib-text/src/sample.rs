//! Cells of the first rows of a file. A log may have thousands of files, so they take little memory.

/// Cells of some rows, in one string.
#[derive(Clone, Debug, Default)]
pub(crate) struct Sample {
    text: String,
    /// End of each cell in `text`, in bytes.
    cells: Vec<u32>,
    /// End of each row in `cells`.
    pub(crate) rows: Vec<u32>,
    /// Line of each row.
    pub(crate) lines: Vec<u64>,
}

impl Sample {
    /// Collects rows, each with its line.
    pub(crate) fn of(rows: impl Iterator<Item = (u64, Vec<String>)>) -> Self {
        let mut sample = Self::default();
        for (line, row) in rows {
            sample.lines.push(line);
            for cell in row {
                sample.text.push_str(cell.trim());
                sample.cells.push(sample.text.len() as u32);
            }
            sample.rows.push(sample.cells.len() as u32);
        }
        sample.text.shrink_to_fit();
        sample
    }

    /// Returns the cells of all rows.
    pub(crate) fn rows(&self) -> Vec<Vec<String>> {
        let mut rows = Vec::with_capacity(self.rows.len());
        let mut cell = 0;
        let mut begin = 0;
        for &end in &self.rows {
            let mut row = Vec::new();
            while cell < end as usize {
                let stop = self.cells[cell] as usize;
                row.push(self.text[begin..stop].to_owned());
                (begin, cell) = (stop, cell + 1);
            }
            rows.push(row);
        }
        rows
    }

    /// Iterates over the cells of a column, without rows that are too short.
    pub(crate) fn column(&self, column: usize) -> impl Iterator<Item = &str> {
        self.by_row(column).flatten()
    }

    /// The cell of a column in each row; `None` in a row that is too short.
    pub(crate) fn by_row(&self, column: usize) -> impl Iterator<Item = Option<&str>> {
        let starts = std::iter::once(0).chain(self.rows.iter().copied());
        starts.zip(&self.rows).map(move |(start, &end)| {
            let cell = start as usize + column;
            if cell >= end as usize {
                return None;
            }
            let begins = cell.checked_sub(1).map_or(0, |before| self.cells[before] as usize);
            Some(&self.text[begins..self.cells[cell] as usize])
        })
    }
}
