//! Types of value columns, and their content.

use polars_parquet_format::{
    ConvertedType, DecimalType, FieldRepetitionType, Float16Type, IntType, LogicalType,
    MicroSeconds, MilliSeconds, NanoSeconds, NullType, StringType, TimeUnit, TimestampType, Type,
    UUIDType,
};

use crate::{campaign::Draws, parquet::Column};

/// Types of a value column.
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

/// Content of a column, row by row.
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

pub(crate) fn logical(kind: &str) -> Option<LogicalType> {
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

fn integer(bit_width: i8, is_signed: bool) -> LogicalType {
    LogicalType::INTEGER(IntType { bit_width, is_signed })
}

fn time(is_adjusted_to_u_t_c: bool, unit: TimeUnit) -> LogicalType {
    LogicalType::TIMESTAMP(TimestampType { is_adjusted_to_u_t_c, unit })
}

fn scale_and_precision(kind: &str) -> Option<(i32, i32)> {
    match kind {
        "decimal(9, 2)" => Some((2, 9)),
        "decimal(18, 4)" => Some((4, 18)),
        "decimal(38, 10)" => Some((10, 38)),
        // More decimals than digits.
        "decimal(5, 9)" => Some((9, 5)),
        _ => None,
    }
}

fn text(bytes: &[u8]) -> Vec<u8> {
    [&(bytes.len() as u32).to_le_bytes()[..], bytes].concat()
}

/// Encodes a value as in a page.
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

/// Returns the value of a row, and whether it exists.
pub(crate) fn value(content: &str, row: u64, draws: &mut Draws) -> (f64, bool) {
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
            if row.is_multiple_of(2) {
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
        "half missing" => row.is_multiple_of(2),
        _ => true,
    };
    (value, there)
}

/// Returns runs of equal levels, from one level per row.
fn levels(by_row: impl Iterator<Item = u8>) -> Vec<(u64, u8)> {
    let mut runs: Vec<(u64, u8)> = Vec::new();
    for level in by_row {
        match runs.last_mut() {
            Some((count, last)) if *last == level => *count += 1,
            _ => runs.push((1, level)),
        }
    }
    runs
}

/// Returns a column of this type and content.
pub(crate) fn column(name: &str, kind: &str, values: &[(f64, bool)]) -> Column {
    let rows = values.len() as u64;
    let there = values.iter().filter(|(_, there)| *there).map(|(value, _)| *value);
    let bytes = if kind == "bool" {
        let bits: Vec<bool> = there.map(|value| value > 50.0).collect();
        bits.chunks(8)
            .map(|bits| bits.iter().rev().fold(0, |byte, &bit| byte << 1 | u8::from(bit)))
            .collect()
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
    let depth: u8 = match kind {
        "deep struct" => 60,
        "list of lists" => 4,
        "list" => 2,
        "struct" | "map key" => 1,
        _ => 0,
    };
    made.definition_levels = Some(levels(values.iter().map(|(_, there)| depth + u8::from(*there))));
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
    // The outermost group has the name of the column.
    name.clone_into(&mut made.groups[0].0);
    "value".clone_into(&mut made.name);
    made
}

/// Returns a group, as it may enclose a column.
fn group(
    name: &str,
    repetition: FieldRepetitionType,
    converted: Option<ConvertedType>,
) -> (String, FieldRepetitionType, Option<ConvertedType>) {
    (name.to_owned(), repetition, converted)
}
