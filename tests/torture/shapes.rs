//! Shapes of logs: types of columns, their content, times and files.

use polars_parquet_format::{CompressionCodec, FieldRepetitionType, FileMetaData};

use crate::{
    campaign::Draws,
    parquet::{Column, file},
    times::{START, TIMES, timestamps, timestamps_from},
    types::{CONTENTS, KINDS, column, value},
};

/// Shapes of files.
pub(crate) const FILES: [&str; 29] = [
    "one",
    "empty file",
    "magic only",
    "no rows",
    "no columns",
    "one row",
    "two rows",
    "five rows",
    "same column twice",
    "odd name",
    "long name",
    "many columns",
    "two that follow",
    "two that overlap",
    "the same twice",
    "other columns",
    "other types",
    "hive folders",
    "named as a column",
    "a folder called so",
    "another ending",
    "cut off",
    "a bit",
    "declares more rows",
    "declares 2^62 rows",
    "declares another codec",
    "declares another place",
    "runs of 10^8 rows",
    "encrypted",
];

/// Problematic names of sensors.
const NAMES: [&str; 14] = [
    "",
    " ",
    "timestamp ",
    "..",
    "/",
    "a/b",
    "\u{0}",
    "\u{1b}[2J",
    "step",
    "温度",
    "\u{202e}P",
    "P,\"Q\"",
    "run-0001.json",
    "*",
];

/// Shape of a log: one entry of each list.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Shape {
    pub(crate) kind: &'static str,
    pub(crate) content: &'static str,
    pub(crate) times: &'static str,
    pub(crate) files: &'static str,
}

impl Shape {
    /// Draws a log with one or two oddities. With more, all would be refused for the first one.
    pub(crate) fn drawn(draws: &mut Draws) -> Self {
        let mut shape = Self { kind: "f64", content: "wave", times: "us", files: "one" };
        for _ in 0..=draws.below(2) {
            match draws.below(4) {
                0 => shape.kind = *draws.of(&KINDS),
                1 => shape.content = *draws.of(&CONTENTS),
                2 => shape.times = *draws.of(&TIMES),
                _ => shape.files = *draws.of(&FILES),
            }
        }
        shape
    }

    /// Returns its files: path below the folder of logs, and content; `None` for a folder.
    pub(crate) fn files(&self, draws: &mut Draws) -> Vec<(String, Option<Vec<u8>>)> {
        let rows = match self.files {
            "no rows" => 0,
            "one row" => 1,
            "two rows" => 2,
            "five rows" => 5,
            _ => 300,
        };
        let name = match self.files {
            "odd name" => (*draws.of(&NAMES)).to_owned(),
            "long name" => "long".repeat(20_000),
            _ => "P".to_owned(),
        };
        let mut columns = self.columns(&name, rows, draws);
        match self.files {
            "empty file" => vec![(a_parquet(), Some(Vec::new()))],
            "magic only" => vec![(a_parquet(), Some(b"PAR1PAR1".to_vec()))],
            "no columns" => vec![(a_parquet(), Some(plain(&[], rows)))],
            "same column twice" => {
                columns.push(columns[1].clone());
                vec![(a_parquet(), Some(plain(&columns, rows)))]
            }
            "many columns" => {
                let further = columns[2].clone();
                columns.extend(
                    (0..1500)
                        .map(|number| Column { name: format!("Q{number}"), ..further.clone() }),
                );
                vec![(a_parquet(), Some(plain(&columns, rows)))]
            }
            "two that follow" | "two that overlap" | "other columns" | "other types" => {
                let mut others = self.columns(
                    if self.files == "other columns" { "R" } else { &name },
                    rows,
                    draws,
                );
                let shift = if self.files == "two that overlap" { 100 } else { rows };
                others[0] = timestamps_from(shift, rows);
                if self.files == "other types" {
                    others[1] = column(&name, draws.of::<&str>(&KINDS), &wave(rows, draws));
                }
                vec![
                    (a_parquet(), Some(plain(&columns, rows))),
                    ("b.parquet".to_owned(), Some(plain(&others, rows))),
                ]
            }
            "the same twice" => {
                vec![
                    (a_parquet(), Some(plain(&columns, rows))),
                    ("b.parquet".to_owned(), Some(plain(&columns, rows))),
                ]
            }
            "hive folders" => vec![
                ("day=1/a.parquet".to_owned(), Some(plain(&columns, rows))),
                ("day=x/a.parquet".to_owned(), Some(plain(&columns, rows))),
            ],
            "named as a column" => vec![("P=1/a.parquet".to_owned(), Some(plain(&columns, rows)))],
            "a folder called so" => {
                vec![
                    (a_parquet(), Some(plain(&columns, rows))),
                    ("b.parquet/inside.txt".to_owned(), Some(Vec::new())),
                ]
            }
            "another ending" => {
                vec![
                    ("a.csv".to_owned(), Some(plain(&columns, rows))),
                    ("a.PARQUET".to_owned(), Some(plain(&columns, rows))),
                ]
            }
            "cut off" => {
                let mut bytes = plain(&columns, rows);
                bytes.truncate(draws.below(bytes.len()));
                vec![(a_parquet(), Some(bytes))]
            }
            "a bit" => {
                let mut bytes = plain(&columns, rows);
                for _ in 0..=draws.below(8) {
                    let place = draws.below(bytes.len());
                    bytes[place] ^= 1 << draws.below(8);
                }
                vec![(a_parquet(), Some(bytes))]
            }
            "runs of 10^8 rows" => vec![(a_parquet(), Some(endless(100_000_000)))],
            "encrypted" => {
                let mut bytes = plain(&columns, rows);
                let end = bytes.len() - 4;
                bytes[end..].copy_from_slice(b"PARE");
                vec![(a_parquet(), Some(bytes))]
            }
            declares => vec![(
                a_parquet(),
                Some(file(&columns, rows as i64, |metadata| declare(declares, metadata))),
            )],
        }
    }

    fn columns(&self, name: &str, rows: u64, draws: &mut Draws) -> Vec<Column> {
        let values: Vec<_> = (0..rows).map(|row| value(self.content, row, draws)).collect();
        vec![
            timestamps(self.times, rows, draws),
            column(name, self.kind, &values),
            column("Q", "f64", &wave(rows, draws)),
        ]
    }
}

/// Returns a file of these columns.
fn plain(columns: &[Column], rows: u64) -> Vec<u8> {
    file(columns, rows as i64, |_| ())
}

fn a_parquet() -> String {
    "a.parquet".to_owned()
}

fn wave(rows: u64, draws: &mut Draws) -> Vec<(f64, bool)> {
    (0..rows).map(|row| value("wave", row, draws)).collect()
}

/// Makes the footer contradict the pages.
fn declare(what: &str, metadata: &mut FileMetaData) {
    let group = &mut metadata.row_groups[0];
    let rows = match what {
        "declares more rows" => group.num_rows * 3,
        "declares 2^62 rows" => 1 << 62,
        _ => group.num_rows,
    };
    (metadata.num_rows, group.num_rows) = (rows, rows);
    for chunk in &mut group.columns {
        let Some(column) = &mut chunk.meta_data else { continue };
        match what {
            "declares more rows" | "declares 2^62 rows" => column.num_values = rows,
            "declares another codec" => column.codec = CompressionCodec::SNAPPY,
            "declares another place" => column.data_page_offset += 1 << 40,
            _ => {}
        }
    }
}

/// Returns few bytes with many rows: one time and one value, repeated.
fn endless(rows: u64) -> Vec<u8> {
    let columns = [("timestamp", "us", START), ("P", "f64", 1.0)].map(|(name, kind, value)| {
        let mut made = column(name, kind, &[(value, true)]);
        made.repetition = FieldRepetitionType::REQUIRED;
        made.definition_levels = None;
        made.dictionary = Some(1);
        made.values = rows;
        made
    });
    plain(&columns, rows)
}
