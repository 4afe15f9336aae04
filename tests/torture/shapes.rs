//! Shapes of logs: what a column is made of, what is in it, what times are, what files are.

use polars_parquet_format::{
    CompressionCodec, ConvertedType, DecimalType, FieldRepetitionType, FileMetaData, Float16Type,
    IntType, LogicalType, MicroSeconds, MilliSeconds, NanoSeconds, NullType, StringType, TimeUnit,
    TimestampType, Type, UUIDType,
};

use crate::{
    campaign::Draws,
    parquet::{Column, file},
};

/// Types of a column of values.
pub(crate) const KINDS: [&str; 38] = [
    "f64",
    "f32",
    "i8",
    "i16",
    "i32",
    "i64",
    "u8",
    "u16",
    "u32",
    "u64",
    "bool",
    "numbers as text",
    "words",
    "nothing as text",
    "bytes that are no text",
    "decimal(9, 2)",
    "decimal(18, 4)",
    "decimal(38, 10)",
    "decimal(5, 9)",
    "date",
    "time of day",
    "ms",
    "us",
    "ns",
    "int96",
    "three bytes",
    "f16",
    "json",
    "uuid",
    "interval",
    "dictionary of text",
    "null",
    "list",
    "list of lists",
    "struct",
    "deep struct",
    "repeated",
    "map key",
];

/// What is in it, row by row.
pub(crate) const CONTENTS: [&str; 20] = [
    "wave",
    "nan",
    "some nan",
    "inf",
    "some inf",
    "1e308",
    "denormal",
    "constant",
    "-0.0",
    "missing",
    "half missing",
    "alternating largest",
    "largest integer",
    "smallest integer",
    "1e155 once",
    "two values",
    "counter",
    "stuck",
    "spikes",
    "noise below one ulp",
];

/// What times are.
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

/// What files are.
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

/// Sensors with names that somebody will use.
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

fn physical(kind: &str) -> Type {
    match kind {
        "f64" => Type::DOUBLE,
        "f32" => Type::FLOAT,
        "bool" => Type::BOOLEAN,
        "i8" | "i16" | "i32" | "u8" | "u16" | "u32" | "decimal(9, 2)" | "date" | "null" => {
            Type::INT32
        }
        "int96" => Type::INT96,
        "decimal(38, 10)" | "three bytes" | "f16" | "uuid" | "interval" => {
            Type::FIXED_LEN_BYTE_ARRAY
        }
        "numbers as text"
        | "words"
        | "nothing as text"
        | "bytes that are no text"
        | "json"
        | "dictionary of text"
        | "decimal(5, 9)" => Type::BYTE_ARRAY,
        "list" | "list of lists" | "struct" | "deep struct" | "repeated" | "map key" => {
            Type::DOUBLE
        }
        _ => Type::INT64,
    }
}

fn length(kind: &str) -> Option<i32> {
    match kind {
        "decimal(38, 10)" | "uuid" => Some(16),
        "three bytes" => Some(3),
        "f16" => Some(2),
        "interval" => Some(12),
        _ => None,
    }
}

fn converted(kind: &str) -> Option<ConvertedType> {
    Some(match kind {
        "i8" => ConvertedType::INT_8,
        "i16" => ConvertedType::INT_16,
        "u8" => ConvertedType::UINT_8,
        "u16" => ConvertedType::UINT_16,
        "u32" => ConvertedType::UINT_32,
        "u64" => ConvertedType::UINT_64,
        "numbers as text"
        | "words"
        | "nothing as text"
        | "bytes that are no text"
        | "dictionary of text" => ConvertedType::UTF8,
        "json" => ConvertedType::JSON,
        "date" => ConvertedType::DATE,
        "time of day" => ConvertedType::TIME_MICROS,
        "ms" => ConvertedType::TIMESTAMP_MILLIS,
        "us" => ConvertedType::TIMESTAMP_MICROS,
        "interval" => ConvertedType::INTERVAL,
        kind if kind.starts_with("decimal") => ConvertedType::DECIMAL,
        _ => return None,
    })
}

fn logical(kind: &str) -> Option<LogicalType> {
    let integer = |bit_width, is_signed| LogicalType::INTEGER(IntType { bit_width, is_signed });
    let time =
        |zone, unit| LogicalType::TIMESTAMP(TimestampType { is_adjusted_to_u_t_c: zone, unit });
    Some(match kind {
        "u64" => integer(64, false),
        "u32" => integer(32, false),
        "i8" => integer(8, true),
        "numbers as text" | "dictionary of text" => LogicalType::STRING(StringType {}),
        "decimal(18, 4)" => LogicalType::DECIMAL(DecimalType { scale: 4, precision: 18 }),
        "f16" => LogicalType::FLOAT16(Float16Type {}),
        "uuid" => LogicalType::UUID(UUIDType {}),
        "null" => LogicalType::UNKNOWN(NullType {}),
        "ms" => time(false, TimeUnit::MILLIS(MilliSeconds {})),
        "us" => time(false, TimeUnit::MICROS(MicroSeconds {})),
        "us of a zone" => time(true, TimeUnit::MICROS(MicroSeconds {})),
        "ns" => time(true, TimeUnit::NANOS(NanoSeconds {})),
        _ => return None,
    })
}

fn scale_and_precision(kind: &str) -> Option<(i32, i32)> {
    match kind {
        "decimal(9, 2)" => Some((2, 9)),
        "decimal(18, 4)" => Some((4, 18)),
        "decimal(38, 10)" => Some((10, 38)),
        // More digits behind the point than there are.
        "decimal(5, 9)" => Some((9, 5)),
        _ => None,
    }
}

fn text(bytes: &[u8]) -> Vec<u8> {
    [&(bytes.len() as u32).to_le_bytes()[..], bytes].concat()
}

/// A value as it lies in a page.
fn plain(kind: &str, value: f64) -> Vec<u8> {
    match kind {
        "numbers as text" => text(value.to_string().as_bytes()),
        "words" | "dictionary of text" => {
            text(if value > 0.0 { b"open \x1b[31m" } else { b"closed\nerror: no" })
        }
        "nothing as text" => text(b""),
        "bytes that are no text" => text(&[0xff, 0xfe, 0x80]),
        "json" => text(format!("{{\"v\": {value}}}").as_bytes()),
        "decimal(5, 9)" => text(&(value as i64).to_be_bytes()),
        _ => match physical(kind) {
            Type::DOUBLE => value.to_le_bytes().to_vec(),
            Type::FLOAT => (value as f32).to_le_bytes().to_vec(),
            Type::INT32 => (value as i64 as i32).to_le_bytes().to_vec(),
            Type::INT96 => {
                [&(value.abs() as u64).to_le_bytes()[..], &2_460_000_u32.to_le_bytes()].concat()
            }
            Type::FIXED_LEN_BYTE_ARRAY => {
                let size = length(kind).unwrap_or(1) as usize;
                (value as i128).to_be_bytes()[16 - size..].to_vec()
            }
            _ if value == 1e19 => i64::MAX.to_le_bytes().to_vec(),
            _ => (value as i64).to_le_bytes().to_vec(),
        },
    }
}

/// The value of a row, and whether it is there.
fn value(content: &str, row: u64, draws: &mut Draws) -> (f64, bool) {
    let wave = 50.0 + 20.0 * (row as f64 / 9.0).sin() + draws.below(100) as f64 / 40.0;
    let odd = row % 37 == 5;
    let value = match content {
        "nan" => f64::NAN,
        "some nan" if odd => f64::NAN,
        "inf" => f64::INFINITY,
        "some inf" if odd => f64::NEG_INFINITY,
        "1e308" => wave * 1e306,
        "denormal" => wave * 5e-324,
        "constant" => 7.25,
        "-0.0" => -0.0,
        "alternating largest" => {
            if row % 2 == 0 {
                f64::MAX
            } else {
                f64::MIN
            }
        }
        "largest integer" => 1e19,
        "smallest integer" => -1e19,
        "1e155 once" if row == 77 => 1e155,
        "two values" => (row % 2) as f64,
        "counter" => row as f64,
        "stuck" => (row / 100) as f64,
        "spikes" if odd => wave * 1e12,
        "noise below one ulp" => 1e16 + wave,
        _ => wave,
    };
    let there = match content {
        "missing" => false,
        "half missing" => row % 2 == 0,
        _ => true,
    };
    (value, there)
}

/// Runs of equal levels, of one level a row.
fn levels(of: impl Iterator<Item = u8>) -> Vec<(u64, u8)> {
    let mut runs: Vec<(u64, u8)> = Vec::new();
    for level in of {
        match runs.last_mut() {
            Some((count, last)) if *last == level => *count += 1,
            _ => runs.push((1, level)),
        }
    }
    runs
}

/// A column of this type and content.
fn column(name: &str, kind: &str, values: &[(f64, bool)]) -> Column {
    let rows = values.len() as u64;
    let there = values.iter().filter(|(_, there)| *there).map(|(value, _)| *value);
    let bytes = if kind == "bool" {
        let bits: Vec<bool> = there.map(|value| value > 50.0).collect();
        let byte =
            |bits: &[bool]| bits.iter().rev().fold(0, |byte, &bit| byte << 1 | u8::from(bit));
        bits.chunks(8).map(byte).collect()
    } else if kind == "dictionary of text" {
        [plain(kind, 1.0), plain(kind, -1.0)].concat()
    } else {
        there.flat_map(|value| plain(kind, value)).collect()
    };
    let mut made = Column::required(name, physical(kind), bytes, rows);
    made.length = length(kind);
    made.converted = converted(kind);
    made.logical = logical(kind);
    made.scale_and_precision = scale_and_precision(kind);
    made.repetition = FieldRepetitionType::OPTIONAL;
    made.dictionary = (kind == "dictionary of text").then_some(2);
    let around = |depth: u8| levels(values.iter().map(|(_, there)| depth + u8::from(*there)));
    let group = |name: &str, repetition, converted| (name.to_owned(), repetition, converted);
    made.definition_levels = Some(around(match kind {
        "struct" => 1,
        "deep struct" => 60,
        "list" => 2,
        "list of lists" => 4,
        "repeated" => 0,
        "map key" => 1,
        _ => 0,
    }));
    match kind {
        "struct" => made.groups = vec![group("inside", FieldRepetitionType::OPTIONAL, None)],
        "deep struct" => {
            made.groups =
                (0..60).map(|_| group("inside", FieldRepetitionType::OPTIONAL, None)).collect();
        }
        "list" | "list of lists" => {
            let mut groups = Vec::new();
            for _ in 0..if kind == "list" { 1 } else { 2 } {
                groups.push(group(
                    "list",
                    FieldRepetitionType::OPTIONAL,
                    Some(ConvertedType::LIST),
                ));
                groups.push(group("element", FieldRepetitionType::REPEATED, None));
            }
            made.groups = groups;
            made.repetition_levels = Some(levels(values.iter().map(|_| 0)));
        }
        "repeated" => {
            made.repetition = FieldRepetitionType::REPEATED;
            made.repetition_levels = Some(levels((0..rows).map(|row| u8::from(row % 3 == 1))));
        }
        "map key" => {
            made.groups =
                vec![group("key_value", FieldRepetitionType::REPEATED, Some(ConvertedType::MAP))];
            made.repetition = FieldRepetitionType::OPTIONAL;
            made.repetition_levels = Some(levels(values.iter().map(|_| 0)));
        }
        _ => {}
    }
    if made.groups.is_empty() {
        return made;
    }
    // The outermost group has the column's name.
    made.groups[0].0 = name.to_owned();
    made.name = "value".to_owned();
    made
}

/// The first minute of the log, in microseconds.
const START: f64 = 1_667_260_800_000_000.0;

/// The time of a row, in microseconds.
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

fn timestamps(times: &str, rows: u64, draws: &mut Draws) -> Column {
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

/// A shape of a log: one of each list above.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Shape {
    pub(crate) kind: &'static str,
    pub(crate) content: &'static str,
    pub(crate) times: &'static str,
    pub(crate) files: &'static str,
}

impl Shape {
    /// A log with one or two oddities: more of them would all be refused for the first.
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

    /// Its files: path below the folder of logs, and content; a folder where there is none.
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
        let one = |columns: &[Column]| Some(file(columns, rows as i64, |_| ()));
        let a = || "a.parquet".to_owned();
        match self.files {
            "empty file" => vec![(a(), Some(Vec::new()))],
            "magic only" => vec![(a(), Some(b"PAR1PAR1".to_vec()))],
            "no columns" => vec![(a(), one(&[]))],
            "same column twice" => {
                columns.push(columns[1].clone());
                vec![(a(), one(&columns))]
            }
            "many columns" => {
                let further = columns[2].clone();
                columns.extend(
                    (0..1500)
                        .map(|number| Column { name: format!("Q{number}"), ..further.clone() }),
                );
                vec![(a(), one(&columns))]
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
                    others[1] = column(&name, *draws.of(&KINDS), &wave(rows, draws));
                }
                vec![(a(), one(&columns)), ("b.parquet".to_owned(), one(&others))]
            }
            "the same twice" => vec![(a(), one(&columns)), ("b.parquet".to_owned(), one(&columns))],
            "hive folders" => vec![
                ("day=1/a.parquet".to_owned(), one(&columns)),
                ("day=x/a.parquet".to_owned(), one(&columns)),
            ],
            "named as a column" => vec![("P=1/a.parquet".to_owned(), one(&columns))],
            "a folder called so" => {
                vec![(a(), one(&columns)), ("b.parquet/inside.txt".to_owned(), Some(Vec::new()))]
            }
            "another ending" => {
                vec![("a.csv".to_owned(), one(&columns)), ("a.PARQUET".to_owned(), one(&columns))]
            }
            "cut off" => {
                let mut bytes = file(&columns, rows as i64, |_| ());
                bytes.truncate(draws.below(bytes.len()));
                vec![(a(), Some(bytes))]
            }
            "a bit" => {
                let mut bytes = file(&columns, rows as i64, |_| ());
                for _ in 0..=draws.below(8) {
                    let place = draws.below(bytes.len());
                    bytes[place] ^= 1 << draws.below(8);
                }
                vec![(a(), Some(bytes))]
            }
            "runs of 10^8 rows" => vec![(a(), Some(endless(100_000_000)))],
            "encrypted" => {
                let mut bytes = file(&columns, rows as i64, |_| ());
                let end = bytes.len() - 4;
                bytes[end..].copy_from_slice(b"PARE");
                vec![(a(), Some(bytes))]
            }
            declares => vec![(
                a(),
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

fn wave(rows: u64, draws: &mut Draws) -> Vec<(f64, bool)> {
    (0..rows).map(|row| value("wave", row, draws)).collect()
}

fn timestamps_from(shift: u64, rows: u64) -> Column {
    let values: Vec<_> = (0..rows).map(|row| (START + (shift + row) as f64 * 60e6, true)).collect();
    column("timestamp", "us", &values)
}

/// A footer that says something else than the pages.
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

/// Few bytes, many rows: one time and one value, repeated.
fn endless(rows: u64) -> Vec<u8> {
    let dictionary = |name: &str, kind, value| {
        let mut made = column(name, kind, &[(value, true)]);
        made.repetition = FieldRepetitionType::REQUIRED;
        made.definition_levels = None;
        made.dictionary = Some(1);
        made.values = rows;
        made
    };
    file(&[dictionary("timestamp", "us", START), dictionary("P", "f64", 1.0)], rows as i64, |_| ())
}
