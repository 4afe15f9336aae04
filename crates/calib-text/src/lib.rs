//! Interprets text: recognises the notation of cells, numbers, times and tables, and reads their values. It opens no
//! file and knows no log.
//!
//! - [`RecordReader`]: splits text in memory into records and cells by its [`Marks`].
//! - [`Dialect`]: recognises the separator, header and units of a table from its first rows.
//! - [`number_columns`]: the columns of a table that is no log; [`most_cells`]: a bound on their cells.
//! - [`Cell`], [`Words`]: a cell in eight bytes.
//! - [`cell_of`], [`plain_decimal`], [`Signs`]: numbers, and their decimal sign.
//! - [`Switch`], [`Quality`]: words for the state of a switch, and codes of good and bad values.
//! - [`Candidates`], [`Notation`]: the notations that a column of times may have; [`TimestampUnit`], [`units`]: the
//!   unit of numeric times.
//! - [`Zone`], [`LocalTimes`]: local clocks, on which one hour per year occurs twice.
//! - [`parse_time`], [`format_time`]: instants as text.
//!
//! ```
//! use calib_text::{Decimal, parse_number, parse_time};
//!
//! assert_eq!(parse_number("1.234,5", Decimal::Comma), Some(1234.5));
//! assert!(parse_time("2022-11-01 06:00:00").is_some());
//! ```

mod cell;
mod columns;
mod cut_number;
mod dialect;
mod names;
mod notation;
mod number;
mod preamble;
mod quality;
mod record;
mod sample;
mod switch;
mod time;
mod unit;
mod zone;

pub use cell::{Cell, Words};
pub use columns::{NotANumber, NumberColumn, number_columns};
pub use cut_number::{decimals_before_cut, has_decimals};
pub use dialect::{Dialect, TextColumn, decode, unbracketed};
pub use notation::{
    Candidates, Likely, Notation, Unreadable, compact_pattern, is_time_of_day, unit_readings,
};
pub use number::{
    Decimal, LARGEST, SignError, Signs, cell_of, either_way, may_be_thousand, parse_number,
    plain_decimal,
};
pub use preamble::most_cells;
pub use quality::Quality;
pub use record::{Marks, RecordReader};
pub use switch::Switch;
pub use time::{ParsedTime, format_time, parse_stamp, parse_time};
pub use unit::{TimestampUnit, units};
pub use zone::{LocalTimes, Zone};

/// Marks a missing time in a list of times in microseconds.
pub const NO_TIME: i64 = i64::MIN;
