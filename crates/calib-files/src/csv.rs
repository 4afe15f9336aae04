use std::path::Path;

use csv_core::{ReadRecordResult, Reader};

use crate::{FileError, read_regular};

/// A column of a CSV file.
#[derive(Clone, Debug, PartialEq)]
pub struct CsvColumn {
    /// Name from the header; without a header the column's number, from 0.
    pub name: String,
    /// The numbers, NaN where a cell is empty; or the first cell that is not a
    /// number.
    pub numbers: Result<Vec<f64>, NotANumber>,
}

/// A cell that is not a number.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected numbers, got `{text}` in line {line}")]
pub struct NotANumber {
    /// Last line of the record, from 1.
    pub line: u64,
    /// The cell.
    pub text: String,
}

impl CsvColumn {
    /// Whether the column holds at least one number, and no other text.
    pub fn is_numeric(&self) -> bool {
        self.numbers.as_ref().is_ok_and(|numbers| !numbers.iter().all(|number| number.is_nan()))
    }

    fn push(&mut self, cell: &str, line: u64) {
        let Ok(numbers) = &mut self.numbers else {
            return;
        };
        let text = cell.trim();
        if text.is_empty() {
            numbers.push(f64::NAN);
        } else if let Ok(number) = text.parse() {
            numbers.push(number);
        } else {
            let text = text.to_owned();
            self.numbers = Err(NotANumber { line, text });
        }
    }
}

/// Reads a CSV file (commas, `"` as quotes, any line ends, empty lines skipped).
///
/// The first record is a header if it has a cell that is neither a number nor empty.
///
/// # Errors
/// If the file cannot be read, has no records, or has records of different lengths.
pub fn read_csv(path: &Path) -> Result<Vec<CsvColumn>, FileError> {
    let bytes = read_regular(path)?;
    parse(&bytes).map_err(|reason| FileError::Csv { path: path.to_owned(), reason })
}

fn parse(bytes: &[u8]) -> Result<Vec<CsvColumn>, String> {
    let mut records = Records::new(bytes)?;
    let first = records.next().ok_or("expected a header or numbers, got nothing")?;
    let is_header = first.cells.iter().any(|cell| {
        let cell = cell.trim();
        !cell.is_empty() && cell.parse::<f64>().is_err()
    });
    let mut columns: Vec<CsvColumn> = first
        .cells
        .iter()
        .enumerate()
        .map(|(number, cell)| {
            let name = if is_header { cell.trim().to_owned() } else { number.to_string() };
            CsvColumn { name, numbers: Ok(Vec::new()) }
        })
        .collect();
    let expected = columns.len();
    // A record ends with a line end, and has a byte between its cells.
    let most = bytes.split(|&byte| byte == b'\n').count().min(bytes.len() / expected + 1);
    for column in &mut columns {
        column.numbers.iter_mut().try_for_each(|numbers| reserve(numbers, most))?;
    }
    for record in (!is_header).then_some(first).into_iter().chain(records) {
        let Record { cells, line } = record;
        if cells.len() != expected {
            let got = cells.len();
            return Err(format!(
                "expected {expected} cells as in the first record, got {got} in line {line}"
            ));
        }
        for (column, cell) in columns.iter_mut().zip(&cells) {
            column.push(cell, line);
        }
    }
    Ok(columns)
}

/// Reserves memory for `count` more values.
fn reserve<T>(values: &mut Vec<T>, count: usize) -> Result<(), String> {
    let reserved = values.try_reserve_exact(count);
    reserved.map_err(|_| "it does not fit into memory; take fewer records or columns".to_owned())
}

struct Record {
    cells: Vec<String>,
    line: u64,
}

/// Iterates over the records of a file in memory.
struct Records<'a> {
    reader: Reader,
    rest: &'a [u8],
    /// Buffer for the unquoted text of a record. It can hold the longest possible
    /// one.
    text: Vec<u8>,
    /// End of each cell in the text.
    ends: Vec<usize>,
}

impl<'a> Records<'a> {
    fn new(bytes: &'a [u8]) -> Result<Self, String> {
        let mut text = Vec::new();
        reserve(&mut text, bytes.len() + 1)?;
        text.resize(bytes.len() + 1, 0);
        Ok(Self { reader: Reader::new(), rest: bytes, text, ends: vec![0; 16] })
    }

    fn record(&self, cells: usize, last: Option<&u8>) -> Record {
        let starts = std::iter::once(0).chain(self.ends.iter().copied());
        let cells = starts
            .zip(&self.ends[..cells])
            .map(|(start, &end)| String::from_utf8_lossy(&self.text[start..end]).into_owned());
        // A line feed that ends the record is counted already.
        let line = self.reader.line() - u64::from(last == Some(&b'\n'));
        Record { cells: cells.collect(), line }
    }
}

impl Iterator for Records<'_> {
    type Item = Record;

    fn next(&mut self) -> Option<Record> {
        let mut written = 0;
        let mut cells = 0;
        loop {
            let (result, read, more_text, more_cells) = self.reader.read_record(
                self.rest,
                &mut self.text[written..],
                &mut self.ends[cells..],
            );
            let (now, rest) = self.rest.split_at(read);
            self.rest = rest;
            written += more_text;
            cells += more_cells;
            match result {
                ReadRecordResult::Record => return Some(self.record(cells, now.last())),
                // Without further input, the next call ends the last record.
                ReadRecordResult::InputEmpty => {}
                ReadRecordResult::OutputEndsFull => self.ends.resize(2 * self.ends.len(), 0),
                ReadRecordResult::OutputFull | ReadRecordResult::End => return None,
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(columns: &[CsvColumn]) -> Vec<&str> {
        columns.iter().map(|column| column.name.as_str()).collect()
    }

    fn numbers(column: &CsvColumn) -> &[f64] {
        column.numbers.as_deref().expect("numbers")
    }

    #[test]
    fn a_header_names_the_columns() {
        let text = "\u{feff}time,\"flow, total\",p\r\n2022-11-01,1.5,-2e-3\r\n\r\n2022-11-02,2,4";
        let columns = parse(text.as_bytes()).expect("valid");
        assert_eq!(names(&columns), ["time", "flow, total", "p"]);
        assert_eq!(numbers(&columns[1]), [1.5, 2.0]);
        assert_eq!(numbers(&columns[2]), [-2e-3, 4.0]);
        let numeric: Vec<bool> = columns.iter().map(CsvColumn::is_numeric).collect();
        assert_eq!(numeric, [false, true, true]);
        let cell = columns[0].numbers.clone().expect_err("dates");
        assert_eq!(cell.to_string(), "expected numbers, got `2022-11-01` in line 2");
    }

    #[test]
    fn without_a_header_columns_have_numbers() {
        let columns = parse(b"1,2\n3, 4 \n").expect("valid");
        assert_eq!(names(&columns), ["0", "1"]);
        assert_eq!(numbers(&columns[1]), [2.0, 4.0]);
    }

    #[test]
    fn empty_cells_are_missing_and_nothing_else_is_no_number() {
        let columns = parse(b"a,b,c\n1,,\n,2,\n3,x,\n").expect("valid");
        let a = numbers(&columns[0]);
        assert!(a[0] == 1.0 && a[1].is_nan() && a[2] == 3.0);
        let cell = columns[1].numbers.clone().expect_err("an x");
        assert_eq!((cell.line, cell.text.as_str()), (4, "x"));
        assert!(!columns[2].is_numeric());
    }

    #[test]
    fn records_are_equally_long() {
        let error = parse(b"a,b\n1,2\n3\n").expect_err("ragged");
        assert_eq!(error, "expected 2 cells as in the first record, got 1 in line 3");
        assert!(parse(b"").is_err() && parse(b"\n\n").is_err());
    }

    #[test]
    fn many_columns() {
        let wide: Vec<String> = (0..1000).map(|number| number.to_string()).collect();
        let columns = parse(wide.join(",").as_bytes()).expect("valid");
        assert_eq!(columns.len(), 1000);
        assert_eq!(numbers(&columns[999]), [999.0]);
    }
}
