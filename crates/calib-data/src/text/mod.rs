//! Logs as text: CSV and its relatives, packed or not.
//!
//! A file is read in blocks of whole records ([`blocks`]), whose parts become cells on all threads: eight bytes each
//! ([`Cell`]), kept column by column ([`columns`]) or tag by tag outside of the memory. What the file is like is told by its
//! first rows ([`calib_text::Dialect`], [`Candidates`]).

mod annotated;
mod blocks;
mod cut_number;
mod file;
mod input;
mod quality;

pub(crate) use calib_text::{
    Candidates, Cell, Decimal, LocalTimes, Marks, Notation, RecordReader, Signs, TextColumn,
    Unreadable, Words, Zone, cell_of, compact_pattern, decode, either_way, is_time_of_day,
    may_be_thousand, parse_number, plain_decimal, unbracketed,
};

pub(crate) use self::{
    annotated::{Annotated, Key, is_annotated, names as annotated_names},
    file::{Records, TextFile, is_value},
    input::{is_empty, size},
    quality::Quality,
};

/// As much of a cell as a message shows, in quotes.
pub(crate) fn shown(cell: &str) -> String {
    const LETTERS: usize = 60;
    match cell.char_indices().nth(LETTERS) {
        None => format!("{cell:?}"),
        Some((end, _)) => format!("{:?}…", &cell[..end]),
    }
}
