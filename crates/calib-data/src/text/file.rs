//! One text file of the log.

use std::{
    ops::Range,
    path::{Path, PathBuf},
};

use calib_core::Monitor;
use calib_text::{Decimal, Dialect, decimals_before_cut, has_decimals};
use rayon::prelude::*;

use super::{
    RecordReader, TextColumn,
    blocks::{Block, Blocks},
    decode,
    input::{self, Compression, fill, unreadable},
    shown,
};
use crate::{DataConfig, DataError};

/// Bytes at the beginning that are examined to recognise a file.
const HEAD: usize = 1 << 20;

/// A text file whose first rows have been read.
#[derive(Debug)]
pub(crate) struct TextFile {
    pub(crate) path: PathBuf,
    /// Size on the disk.
    pub(crate) bytes: u64,
    pub(crate) dialect: Dialect,
    /// Parts of times outside the column of times.
    time_parts: TimeParts,
    /// Columns that are not channels: parts of times, and row names.
    pub(crate) no_channels: Vec<usize>,
    /// Filter of rows: columns with the values that they must have.
    only: Vec<(usize, String)>,
    /// Approximate bytes of a row on the disk.
    row_bytes: f64,
}

impl TextFile {
    pub(crate) fn open(path: &Path, data: &DataConfig) -> Result<Self, DataError> {
        let bytes = input::size(path)?;
        let (head, compression) = head(path)?;
        if let Some(reason) = no_text(&head) {
            return Err(DataError::NotText { path: path.to_owned(), reason: reason.to_owned() });
        }
        let dialect = Dialect::of(&head, data.separator)
            .map_err(|reason| DataError::NotText { path: path.to_owned(), reason })?;
        let (skip, _) = dialect.skip;
        let lines = memchr::memchr_iter(b'\n', &head[skip as usize..]).count().max(1);
        let packed = match compression {
            Compression::Plain => 1.0,
            Compression::Gzip | Compression::Zstandard => TYPICAL_PACKING,
        };
        let row_bytes = ((head.len() as f64 - skip as f64) / lines as f64 / packed).max(1.0);
        let only = chosen(path, &dialect.columns, data)?;
        let no_channels = if dialect.has_row_names { vec![0] } else { Vec::new() };
        let time_parts = TimeParts::None;
        Ok(Self { path: path.to_owned(), bytes, dialect, time_parts, no_channels, only, row_bytes })
    }

    /// Sets the column `date` of dates and the column `clock` of times of day.
    pub(crate) fn join_times(&mut self, date: usize, clock: usize) {
        self.time_parts = TimeParts::Clock(clock);
        self.no_channels.push(clock);
        self.dialect.join(date, &[clock], |row| joined(&row[date], &row[clock]));
    }

    /// Sets the columns of years, months and days, and of hours, minutes and seconds as far as they exist. The first
    /// one stands for all.
    pub(crate) fn join_fields(&mut self, fields: &[usize]) {
        self.time_parts = TimeParts::Fields(fields.to_vec());
        self.no_channels.extend(&fields[1..]);
        self.dialect.join(fields[0], &fields[1..], |row| {
            joined_fields(fields.iter().map(|&column| row[column].clone()))
        });
    }

    /// Returns sentences about columns that are not read independently.
    pub(crate) fn read_as(&self) -> Vec<String> {
        let mut read_as = Vec::new();
        if self.dialect.has_row_names {
            read_as.push(format!(
                "the header has {} names and rows have {} values, as R writes tables: the first column has the names of the rows, and is left out as {:?}",
                self.columns().len() - 1,
                self.columns().len(),
                self.columns()[0].name
            ));
        }
        if let TimeParts::Fields(fields) = &self.time_parts {
            let names: Vec<&str> =
                fields.iter().map(|&field| self.columns()[field].name.as_str()).collect();
            read_as.push(format!("times are joined from the columns {}", names.join(", ")));
        }
        read_as
    }

    pub(crate) fn columns(&self) -> &[TextColumn] {
        &self.dialect.columns
    }

    pub(crate) fn estimated_rows(&self) -> u64 {
        (self.bytes as f64 / self.row_bytes) as u64
    }

    /// Reads all records from the first row of values: `read` processes parts of a block in parallel, and `take`
    /// receives the results in order.
    ///
    /// # Errors
    /// If `read` or `take` fails, the file cannot be read, or the monitor interrupts.
    pub(crate) fn read_parts<Part: Send>(
        &self,
        read: impl Fn(Records<'_>) -> Result<Part, DataError> + Sync,
        mut take: impl FnMut(Part) -> Result<(), DataError>,
        monitor: &dyn Monitor,
    ) -> Result<(), DataError> {
        let mut blocks = self.blocks()?;
        while let Some(block) = blocks.next(rayon::current_num_threads())? {
            monitor.check()?;
            let parts = block
                .parts
                .par_iter()
                .map(|(range, line)| read(self.records(&block, range.clone(), *line)));
            for part in parts.collect::<Result<Vec<Part>, DataError>>()? {
                take(part)?;
            }
        }
        Ok(())
    }

    /// Returns the rows of values, from the first.
    pub(crate) fn blocks(&self) -> Result<Blocks, DataError> {
        let (input, _) = input::open(&self.path)?;
        Blocks::new(input, self.path.clone(), self.dialect.marks, self.dialect.skip)
    }

    /// Returns the records of the part `range` of a block, which `line` lines precede.
    pub(crate) fn records<'a>(
        &'a self,
        block: &'a Block,
        range: Range<usize>,
        line: u64,
    ) -> Records<'a> {
        let reader = RecordReader::new(&block.bytes[range], self.dialect.marks);
        Records { reader, file: self, block: &block.bytes, line }
    }
}

/// Location of times that are not in one column.
#[derive(Clone, Debug)]
enum TimeParts {
    /// Times are in one column.
    None,
    /// Times of day are in this column.
    Clock(usize),
    /// Years, months and days, and hours, minutes and seconds as far as they exist, are in these columns.
    Fields(Vec<usize>),
}

/// Returns why a file cannot be text.
fn no_text(head: &[u8]) -> Option<&'static str> {
    match head {
        [] => Some("it is empty; export it again, or leave it out"),
        [b'P', b'K', 3 | 5, 4 | 6, ..] => {
            Some("it is a ZIP archive or an Excel workbook; unpack it, or save each sheet as CSV")
        }
        _ if is_utf16(&head[..head.len().min(1 << 12)]) => {
            Some("it is text in UTF-16 without its mark; save or convert it as UTF-8")
        }
        _ if is_binary(&head[..head.len().min(1 << 12)]) => {
            Some("it is not text; export the log as CSV or Parquet")
        }
        _ => None,
    }
}

/// Whether nearly every second byte is 0 and hardly any other, as in 16-bit characters.
fn is_utf16(head: &[u8]) -> bool {
    let [even, odd] =
        [0, 1].map(|parity| head.iter().skip(parity).step_by(2).filter(|&&byte| byte == 0).count());
    let letters = head.len() / 2;
    letters >= 8 && 10 * even.max(odd) > 9 * letters && 10 * even.min(odd) < letters
}

/// Whether there are more zero bytes than damage would cause.
fn is_binary(head: &[u8]) -> bool {
    let zeros = memchr::memchr_iter(0, head).count();
    zeros * 16 > head.len()
}

/// Returns the columns in `data.where`, with their required values.
fn chosen(
    path: &Path,
    columns: &[TextColumn],
    data: &DataConfig,
) -> Result<Vec<(usize, String)>, DataError> {
    data.only
        .iter()
        .map(|(name, value)| {
            let column = columns.iter().position(|column| column.name == *name);
            let names = columns.iter().map(|column| column.name.as_str());
            let column = column.ok_or_else(|| DataError::where_column(path, name, names))?;
            Ok((column, value.clone()))
        })
        .collect()
}

/// Typical compression ratio of numbers as text.
const TYPICAL_PACKING: f64 = 4.0;

/// Returns the first bytes of a file; these are whole records if there is a line break at all.
fn head(path: &Path) -> Result<(Vec<u8>, Compression), DataError> {
    let (mut input, compression) = input::open(path)?;
    let mut head = vec![0; HEAD];
    let length = fill(&mut input, &mut head).map_err(|error| unreadable(path, &error))?;
    head.truncate(length);
    if length == HEAD
        && let Some(end) = memchr::memrchr(b'\n', &head)
    {
        head.truncate(end + 1);
    }
    Ok((head, compression))
}

/// Whether a cell equals the requested value, as text or as a number.
pub(crate) fn is_value(cell: &str, value: &str) -> bool {
    cell == value
        || matches!((cell.parse::<f64>(), value.parse::<f64>()), (Ok(cell), Ok(value)) if cell == value)
}

/// Joins a date and a time of day, which may also be written as 18.00.00. Returns an empty string if one is missing.
pub(crate) fn joined(date: &str, clock: &str) -> String {
    let date = date.trim();
    let clock = clock.trim();
    if date.is_empty() || clock.is_empty() {
        return String::new();
    }
    let clock = if clock.contains(':') { clock.to_owned() } else { clock.replacen('.', ":", 2) };
    format!("{date} {clock}")
}

/// Joins the year, the month, the day, and the hour, the minute and the second as far as they exist. Returns an empty
/// string if one is missing.
pub(crate) fn joined_fields(fields: impl Iterator<Item = impl AsRef<str>>) -> String {
    let mut text = String::new();
    for (field, before) in fields.zip(["", "-", "-", " ", ":", ":"]) {
        let field = field.as_ref().trim();
        // Some programs turn columns with missing values into fractions.
        let field = field.strip_suffix(".0").unwrap_or(field);
        if field.is_empty() {
            return String::new();
        }
        text.push_str(before);
        if field.len() < 2 {
            text.push('0');
        }
        text.push_str(field);
    }
    if text.contains(' ') && !text.contains(':') {
        text.push_str(":00");
    }
    text
}

/// Records of a text file.
pub(crate) struct Records<'a> {
    reader: RecordReader<'a>,
    file: &'a TextFile,
    /// All records of the block.
    block: &'a [u8],
    line: u64,
}

impl Records<'_> {
    /// Moves to the next record; returns false if there is none.
    pub(crate) fn advance(&mut self) -> Result<bool, DataError> {
        let (expected, got) =
            loop {
                if !self.reader.advance() {
                    return Ok(false);
                }
                let expected = self.file.columns().len();
                let got = self.reader.count();
                let one_empty_more =
                    got == expected + 1 && self.reader.cell(expected).trim_ascii().is_empty();
                if got != expected && !one_empty_more {
                    break (expected, got);
                }
                if self.file.only.iter().all(|(column, value): &(usize, String)| {
                    is_value(self.text(*column).trim(), value)
                }) {
                    return Ok(true);
                }
            };
        let hint = if got > expected {
            "did two lines run into one, or is there a decimal comma outside of quotes?"
        } else {
            "is the file cut off, or are there notes below the table?"
        };
        Err(self.refused(format!("{got} cells, and the header names {expected} columns; {hint}")))
    }

    /// Rejects the last record of a file that ends in the middle of a number, if the numbers above show it.
    pub(crate) fn refuse_cut_number(&self, decimal: Decimal) -> Result<(), DataError> {
        let columns = self.file.columns().len();
        if !self.reader.lacks_line_break() || self.reader.count() != columns {
            return Ok(());
        }
        let text = self.text(columns - 1);
        let last = text.trim();
        let mut before = self.file.dialect.cells(columns - 1);
        // The first rows of a short file are all of its rows.
        if before.last() == Some(&last) {
            before.pop();
        }
        match decimals_before_cut(last, &before, decimal) {
            Some(decimals) if self.are_padded(decimals, decimal) => Err(self.refused(format!(
                "no line break follows {}, and numbers above it have {decimals} decimals; is the file cut off?",
                shown(last)
            ))),
            _ => Ok(()),
        }
    }

    /// Whether all numbers of the last column have so many decimals, in the block of the last record without it.
    fn are_padded(&self, decimals: usize, decimal: Decimal) -> bool {
        let last = self.file.columns().len() - 1;
        let mut records = RecordReader::new(self.block, self.file.dialect.marks);
        while records.advance() && !records.lacks_line_break() {
            if records.count() > last
                && !has_decimals(decode(records.cell(last)).trim(), decimals, decimal)
            {
                return false;
            }
        }
        true
    }

    /// Returns the raw bytes of a cell of the record.
    pub(crate) fn bytes(&self, column: usize) -> &[u8] {
        self.reader.cell(column)
    }

    /// Returns the time of the record as text, with the time of day from another column if there is one.
    pub(crate) fn time(&self, column: usize) -> std::borrow::Cow<'_, str> {
        match &self.file.time_parts {
            TimeParts::None => self.text(column),
            TimeParts::Clock(clock) => joined(&self.text(column), &self.text(*clock)).into(),
            TimeParts::Fields(fields) => {
                joined_fields(fields.iter().map(|&field| self.text(field))).into()
            }
        }
    }

    /// Whether times are in several columns.
    pub(crate) fn has_time_parts(&self) -> bool {
        !matches!(self.file.time_parts, TimeParts::None)
    }

    /// Whether semicolons separate cells, as usual if the decimal sign is a comma.
    pub(crate) fn has_semicolons(&self) -> bool {
        self.file.dialect.marks.separator == b';'
    }

    /// Whether a column is not a channel: it has a part of the times, or the row names.
    pub(crate) fn is_no_channel(&self, column: usize) -> bool {
        self.file.no_channels.contains(&column)
    }

    /// Returns a cell of the record as text.
    pub(crate) fn text(&self, column: usize) -> std::borrow::Cow<'_, str> {
        decode(self.reader.cell(column))
    }

    pub(crate) fn path(&self) -> &Path {
        &self.file.path
    }

    pub(crate) fn refused(&self, reason: String) -> DataError {
        DataError::Record {
            path: self.file.path.clone(),
            line: self.line + self.reader.line(),
            reason,
        }
    }
}
