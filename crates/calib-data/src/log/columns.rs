//! Reads a wide text file, and stores it column by column outside of memory.

use calib_core::Monitor;
use calib_text::ParsedTime;

use super::{
    bad_rows_found::{BadRowsFound, NO_TIME},
    clock::{Clock, Fractions, Instants},
    store::{Columns, Seen, Store},
};
use crate::{
    DataError,
    text::{
        Cell, Decimal, Notation, Records, Signs, TextFile, cell_of, decode, either_way,
        may_be_thousand, plain_decimal, shown,
    },
};

/// A wide text file in a store.
pub(crate) struct Imported {
    pub(crate) times: Vec<i64>,
    pub(crate) columns: Columns,
    /// Whether a column holds only text that is not a number, per column.
    pub(crate) words_only: Vec<bool>,
    /// Number of rows whose time names no instant, or two that no other row can tell apart.
    pub(crate) undecided: u64,
}

/// Reads the times of `file`, and all its columns into `store`.
pub(crate) fn import(
    file: &TextFile,
    time: usize,
    clock: &Clock,
    fractions: &Fractions,
    store: &mut Store,
    monitor: &dyn Monitor,
) -> Result<Imported, DataError> {
    let width = file.columns().len();
    let mut imported = Imported {
        times: Vec::new(),
        columns: Columns::default(),
        words_only: vec![true; width],
        undecided: 0,
    };
    let mut instants = clock.rows();
    file.read_parts(
        |records| WideChunk::read(records, width, time, &clock.notation, fractions),
        |part| imported.add(part, &mut instants, store),
        monitor,
    )?;
    imported.undecided = instants.finish(&mut |(), instant| {
        imported.times.push(instant);
        Ok::<(), DataError>(())
    })?;
    Ok(imported)
}

impl Imported {
    fn add(
        &mut self,
        mut part: WideChunk,
        instants: &mut Instants<()>,
        store: &mut Store,
    ) -> Result<(), DataError> {
        let rows = part.stamps.len();
        for stamp in part.stamps {
            instants.push(stamp, (), &mut |(), instant| {
                self.times.push(instant);
                Ok::<(), DataError>(())
            })?;
        }
        store.adopt(part.seen, &mut part.cells)?;
        for (column, cells) in part.cells.chunks(rows.max(1)).enumerate() {
            self.words_only[column] &= !cells
                .iter()
                .any(|&bits| matches!(Cell::decode(bits), Cell::Number(_) | Cell::NonFinite));
        }
        let at = store.append(&part.cells)?;
        self.columns.add(rows, at);
        // A compressed text file may have any number of rows.
        store.memory.require_rows(self.columns.rows as u64, None)
    }
}

/// The part that one thread read: cells column by column.
struct WideChunk {
    stamps: Vec<Option<ParsedTime>>,
    cells: Vec<u64>,
    seen: Seen,
}

impl WideChunk {
    fn read(
        mut records: Records<'_>,
        width: usize,
        time: usize,
        notation: &Notation,
        fractions: &Fractions,
    ) -> Result<Self, DataError> {
        let mut seen = Seen::default();
        let mut stamps = Vec::new();
        let mut by_row: Vec<u64> = Vec::new();
        while let Some(stamp) =
            next_row(&mut records, fractions.decimal, &mut seen.bad_rows, |records| {
                // If rows have no times, they get them when all rows are counted.
                if time < width { stamp(records, time, notation) } else { Ok(None) }
            })?
        {
            stamps.push(stamp);
            for column in 0..width {
                let cell = if column == time || records.is_no_channel(column) {
                    Cell::Missing
                } else {
                    cell(&records, column, fractions, &mut seen)?
                };
                by_row.push(cell.encode());
            }
        }
        let rows = stamps.len();
        let mut cells = vec![0; by_row.len()];
        for (row, record) in by_row.chunks_exact(width).enumerate() {
            for (column, &cell) in record.iter().enumerate() {
                cells[column * rows + row] = cell;
            }
        }
        Ok(Self { stamps, cells, seen })
    }
}

/// Reads the time of the next row with `stamp`; `None` if there are no more rows. Damaged lines are recorded in
/// `bad_rows`. So is a last line that ends in a cut number, unless the sign `decimal` is unknown.
pub(crate) fn next_row<T>(
    records: &mut Records<'_>,
    decimal: Decimal,
    bad_rows: &mut BadRowsFound,
    mut stamp: impl FnMut(&Records<'_>) -> Result<T, DataError>,
) -> Result<Option<T>, DataError> {
    loop {
        let read = match records.advance() {
            Ok(false) => return Ok(None),
            Ok(true) => records.refuse_cut_number(decimal).and_then(|()| stamp(records)),
            Err(error) => Err(error),
        };
        match read {
            Err(bad @ DataError::Record { .. }) => bad_rows.note(&bad),
            read => return read.map(Some),
        }
    }
}

/// Returns the time of a record; `None` if it has no time.
pub(crate) fn stamp(
    records: &Records<'_>,
    column: usize,
    notation: &Notation,
) -> Result<Option<ParsedTime>, DataError> {
    let text = records.time(column);
    let text = text.trim();
    if text.is_empty() {
        return Ok(None);
    }
    notation
        .read(text)
        .map(Some)
        .ok_or_else(|| records.refused(format!("{} {NO_TIME} ({})", shown(text), notation.name())))
}

/// Reads a cell of a record that may be a number.
pub(crate) fn cell(
    records: &Records<'_>,
    column: usize,
    fractions: &Fractions,
    seen: &mut Seen,
) -> Result<Cell, DataError> {
    let bytes = records.bytes(column);
    // While the decimal sign is unknown, each cell may show it.
    if (fractions.told_by.is_none() || fractions.decimal != Decimal::Unknown)
        && let Some(value) = plain_decimal(bytes, fractions.decimal)
    {
        return Ok(Cell::Number(value));
    }
    let text = decode(bytes);
    let is_untold = fractions.told_by.is_some() && fractions.decimal == Decimal::Unknown;
    let cell = if is_untold && records.has_semicolons() && may_be_thousand(&text) {
        None
    } else {
        cell_of(&text, fractions.decimal, &mut seen.words)
    };
    let cell = cell.ok_or_else(|| records.refused(either_way(text.trim())))?;
    if fractions.told_by.is_some() && Signs::may_tell(&text, fractions.decimal) {
        seen.signs.note(&text, records.path());
    }
    Ok(cell)
}
