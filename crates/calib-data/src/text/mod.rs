//! Reads logs as text: CSV and similar formats, compressed or not.
//!
//! A file is read in blocks of whole records ([`blocks`]). All threads convert their parts to cells of eight bytes
//! ([`Cell`]). The cells are stored outside of memory, column by column ([`columns`]) or tag by tag. The first rows
//! determine the format of the file ([`calib_text::Dialect`], [`Candidates`]).

mod annotated;
mod blocks;
mod file;
mod input;

pub(crate) use calib_text::{
    Candidates, Cell, Decimal, LocalTimes, Marks, Notation, Quality, RecordReader, Signs, Switch,
    TextColumn, Unreadable, Words, Zone, cell_of, compact_pattern, decode, either_way,
    is_time_of_day, may_be_thousand, parse_number, plain_decimal, unbracketed,
};

pub(crate) use self::{
    annotated::{Annotated, Key, is_annotated, names as annotated_names},
    file::{Records, TextFile, is_value},
    input::{is_empty, size},
};

/// Quotes the beginning of a cell for a message.
pub(crate) fn shown(cell: &str) -> String {
    const LETTERS: usize = 60;
    match cell.char_indices().nth(LETTERS) {
        None => format!("{cell:?}"),
        Some((end, _)) => format!("{:?}…", &cell[..end]),
    }
}
