//! Times of logs.

use crate::{
    campaign::Draws,
    parquet::Column,
    types::{column, logical},
};

/// Kinds of times.
pub(crate) const TIMES: [&str; 32] = [
    "us",
    "ms",
    "ns",
    "us of a zone",
    "date",
    "integer s",
    "integer us",
    "int32 s",
    "float s",
    "text",
    "words",
    "int96",
    "missing",
    "some missing",
    "equal",
    "unsorted",
    "backwards",
    "largest once",
    "smallest once",
    "year 9999",
    "year 1",
    "before 1970",
    "steps of 1 us",
    "steps of a day",
    "steps of 100 years",
    "random gaps",
    "every row twice",
    "no such column",
    "bool",
    "decimal",
    "unsigned",
    "nan",
];

/// First minute of the log, in microseconds.
pub(crate) const START: f64 = 1_667_260_800_000_000.0;

/// Returns the time of a row in microseconds, and whether it exists.
fn instant(times: &str, row: u64, rows: u64, draws: &mut Draws) -> (f64, bool) {
    let minute = 60e6;
    let regular = START + row as f64 * minute;
    let micros = match times {
        "equal" => START,
        "unsorted" => START + draws.below(rows as usize) as f64 * minute,
        "backwards" => START + (rows - row) as f64 * minute,
        "largest once" if row == rows / 2 => 1e19,
        "smallest once" if row == rows / 2 => -1e19,
        "year 9999" if row + 1 == rows => 253_402_214_400e6,
        "year 1" if row == 0 => -62_135_596_800e6,
        "before 1970" => regular - 2.5e15,
        "steps of 1 us" => START + row as f64,
        "steps of a day" => START + row as f64 * 86_400e6,
        "steps of 100 years" => row as f64 * 3.15576e15,
        "random gaps" => regular + (row / (1 + draws.below(50)) as u64) as f64 * 1e9,
        "every row twice" => START + (row / 2) as f64 * minute,
        _ => regular,
    };
    let there = match times {
        "missing" => false,
        "some missing" => row % 11 != 3,
        _ => true,
    };
    (micros, there)
}

/// Returns the column of times.
pub(crate) fn timestamps(times: &str, rows: u64, draws: &mut Draws) -> Column {
    let micros: Vec<(f64, bool)> = (0..rows).map(|row| instant(times, row, rows, draws)).collect();
    let (kind, factor) = match times {
        "ms" => ("ms", 1e-3),
        "ns" => ("ns", 1e3),
        "date" => ("date", 1.0 / 86_400e6),
        "integer s" => ("i64", 1e-6),
        "integer us" => ("i64", 1.0),
        "int32 s" => ("i32", 1e-6),
        "float s" => ("f64", 1e-6),
        "nan" => ("f64", f64::NAN),
        "text" => ("numbers as text", 1e-6),
        "words" => ("words", 1.0),
        "int96" => ("int96", 1.0),
        "bool" => ("bool", 1.0),
        "decimal" => ("decimal(18, 4)", 1.0),
        "unsigned" => ("u64", 1.0),
        _ => ("us", 1.0),
    };
    let values: Vec<(f64, bool)> = micros
        .iter()
        .map(|&(micros, there)| {
            (if micros.abs() == 1e19 { micros } else { micros * factor }, there)
        })
        .collect();
    let name = if times == "no such column" { "when" } else { "timestamp" };
    let mut made = column(name, kind, &values);
    if times == "us of a zone" {
        made.logical = logical(times);
    }
    made
}

/// Returns regular times that begin `shift` rows later.
pub(crate) fn timestamps_from(shift: u64, rows: u64) -> Column {
    let values: Vec<_> = (0..rows).map(|row| (START + (shift + row) as f64 * 60e6, true)).collect();
    column("timestamp", "us", &values)
}
