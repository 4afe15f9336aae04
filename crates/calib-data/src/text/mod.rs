//! Logs as text: CSV and its relatives, packed or not.
//!
//! A file is read in blocks of whole records ([`blocks`]), whose parts become cells on all threads: eight bytes each
//! ([`cell`]), kept column by column ([`columns`]) or tag by tag outside of the memory. What the file is like
//! ([`dialect`], [`stamps`]) is told by its first rows.

mod annotated;
mod blocks;
mod cell;
mod dialect;
mod file;
mod input;
mod number;
mod quality;
mod record;
mod stamps;
mod zone;

pub(crate) use self::{
    annotated::{Annotated, Key, Sample, is_annotated, names as annotated_names},
    blocks::Marks,
    cell::{Cell, Words},
    dialect::{TextColumn, decode, unbracketed},
    file::{Records, TextFile, is_value},
    input::size,
    number::{Decimal, Signs, cell as cell_of, either_way, parse as parse_number, plain_decimal},
    quality::Quality,
    record::RecordReader,
    stamps::{Candidates, Notation, Unreadable, compact_pattern, is_time_of_day},
    zone::{Walls, Zone},
};

/// As much of a cell as a message shows, in quotes.
pub(crate) fn shown(cell: &str) -> String {
    const LETTERS: usize = 60;
    match cell.char_indices().nth(LETTERS) {
        None => format!("{cell:?}"),
        Some((end, _)) => format!("{:?}…", &cell[..end]),
    }
}
