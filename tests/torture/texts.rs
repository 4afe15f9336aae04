//! Logs as text with a known truth: the instants and values that were written, in any notation.

use std::fmt::Write as _;

use jiff::tz::TimeZone;

use crate::campaign::Draws;

/// Notations of times.
pub(crate) const TIMES: [&str; 28] = [
    "iso",
    "iso with T and Z",
    "iso with offset",
    "day.month.year",
    "month/day/year AM",
    "day-month name",
    "no-break space",
    "seconds",
    "milliseconds",
    "microseconds",
    "nanoseconds",
    "fractions of a second",
    "from zero",
    "14 digits",
    "8 and 14 digits",
    "14 digits, 9999 among them",
    "iso, 9999 among them",
    "day.month.year, 9999 among them",
    "spreadsheet",
    "spreadsheet with comma",
    "MATLAB",
    "seconds since 1904",
    "file times",
    "milliseconds of 1969",
    "seconds of 1969",
    "clock of a zone",
    "clock of a zone, some missing",
    "clock of a zone, newest first",
];

/// Notations of numbers.
pub(crate) const NUMBERS: [&str; 16] = [
    "point",
    "comma",
    "thousands before a comma",
    "thousands before a point",
    "three digits behind a point",
    "three digits behind a comma",
    "whole",
    "whole, then comma",
    "whole, then thousands before a comma",
    "whole, then both",
    "exponents",
    "comma in one file, whole in the other",
    "comma in one file, point in the other",
    "thousands and comma in one file, thousands in the other",
    "point in one file, thousands in the other",
    "infinite ones among them",
];

/// Text around the table.
pub(crate) const DRESSES: [&str; 11] = [
    "plain",
    "CR LF",
    "mark of UTF-8",
    "Latin 1",
    "comments and a title",
    "units below the header",
    "all quoted",
    "zstd",
    "empty lines",
    "sep=;",
    "no end of line",
];

/// Meanings of a row.
pub(crate) const SHAPES: [&str; 4] = ["wide", "long", "file per tag", "InfluxDB"];

/// Names of the first channel.
pub(crate) const NAMES: [&str; 16] = [
    "P",
    "Durchfluß: P",
    "温度: °C",
    "T [°C]",
    "*",
    "[a]*?",
    "P\n[evaluate]\nresamples = 7\n#",
    "\"\"\"\nseed = 9\n",
    "'''",
    "P\u{2028}Q",
    "\u{1b}[2J",
    "seed",
    "1.5",
    "P = 3 # Q",
    "\u{202e}P",
    "..",
];

/// Time zones, each with the instant at which clocks go back.
const ZONES: [(&str, i64); 4] = [
    ("Europe/Paris", 1_729_990_800),
    ("Europe/Moscow", 1_414_274_400),
    ("America/Sao_Paulo", 1_518_919_200),
    ("Australia/Lord_Howe", 1_712_415_600),
];

/// Kind of a text log.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Kind {
    pub(crate) times: &'static str,
    pub(crate) numbers: &'static str,
    pub(crate) dress: &'static str,
    pub(crate) shape: &'static str,
    pub(crate) name: &'static str,
}

impl Kind {
    pub(crate) fn drawn(draws: &mut Draws) -> Self {
        let mut kind =
            Self { times: "iso", numbers: "point", dress: "plain", shape: "wide", name: "P" };
        for _ in 0..=draws.below(3) {
            match draws.below(5) {
                0 => kind.times = *draws.of(&TIMES),
                1 => kind.numbers = *draws.of(&NUMBERS),
                2 => kind.dress = *draws.of(&DRESSES),
                3 => kind.shape = *draws.of(&SHAPES),
                _ => kind.name = *draws.of(&NAMES),
            }
        }
        if kind.shape == "InfluxDB" {
            // InfluxDB has one notation of times and numbers, and no text around the table.
            kind = Self { times: "iso with T and Z", numbers: "point", dress: "plain", ..kind };
        }
        kind
    }

    fn zone(&self) -> bool {
        self.times.starts_with("clock of a zone")
    }

    fn files(&self) -> usize {
        if self.numbers.contains("in the other") { 2 } else { 1 }
    }

    fn separator(&self) -> char {
        if self.dress == "sep=;"
            || self.numbers.contains("comma")
            || self.numbers.contains("both")
            || self.times.contains("comma")
        {
            ';'
        } else {
            ','
        }
    }
}

/// A value of the first channel.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Truth {
    /// Time in microseconds; local time if the log names no zone.
    pub(crate) time: i64,
    /// The value; `None` if it is not a number that can be kept.
    pub(crate) value: Option<f64>,
}

/// A log and its truth.
pub(crate) struct Log {
    /// Name and content of each file.
    pub(crate) files: Vec<(String, Vec<u8>)>,
    pub(crate) truth: Vec<Truth>,
    /// Number of rows without a time.
    pub(crate) never: usize,
    /// Keys that a study of the log needs.
    pub(crate) sets: Vec<String>,
}

/// Returns the instants of the rows, in microseconds, oldest first.
fn instants(kind: &Kind, draws: &mut Draws) -> (Vec<i64>, Option<&'static str>) {
    let rows = match draws.below(4) {
        0 => 40,
        1 => 120,
        _ => 520,
    };
    let period = *draws.of(&[1, 10, 60, 300, 900, 1_800, 3_600]);
    if kind.zone() {
        let (zone, back) = *draws.of(&ZONES);
        let offset = draws.below(period as usize) as i64 / 60 * 60;
        let missing = if kind.times.ends_with("missing") { 3 } else { 0 };
        let before = rows / 2;
        let all = (0..rows).map(|row| back + (row - before) * period + offset);
        let kept: Vec<i64> = all.filter(|_| missing == 0 || draws.below(10) >= missing).collect();
        return (kept.into_iter().map(|second| second * 1_000_000).collect(), Some(zone));
    }
    let start = match kind.times {
        "from zero" => 0,
        times if times.ends_with("of 1969") => -1_000_000 - 3_600 * rows,
        // A day that cannot be a month, and one that can be a month.
        _ if draws.below(2) == 0 => 1_710_309_600,
        _ => 1_709_272_800,
    };
    ((0..rows).map(|row| (start + row * period) * 1_000_000).collect(), None)
}

fn civil(micros: i64, zone: Option<&str>) -> jiff::civil::DateTime {
    let instant = jiff::Timestamp::from_microsecond(micros).expect("in range");
    let zone = zone.map_or(TimeZone::UTC, |zone| TimeZone::get(zone).expect("a zone"));
    zone.to_datetime(instant)
}

fn as_pattern(at: jiff::civil::DateTime, pattern: &str) -> String {
    at.strftime(pattern).to_string()
}

/// Formats a time.
fn written(times: &str, micros: i64, zone: Option<&str>) -> String {
    let at = civil(micros, zone);
    let seconds = micros / 1_000_000;
    match times {
        "iso with T and Z" => as_pattern(at, "%Y-%m-%dT%H:%M:%SZ"),
        "iso with offset" => {
            civil(micros + 19_800_000_000, None).strftime("%Y-%m-%d %H:%M:%S+05:30").to_string()
        }
        "day.month.year" | "day.month.year, 9999 among them" => as_pattern(at, "%d.%m.%Y %H:%M:%S"),
        "month/day/year AM" => as_pattern(at, "%-m/%-d/%Y %-I:%M:%S %p"),
        "day-month name" => as_pattern(at, "%d-%b-%y %H:%M:%S"),
        "no-break space" => as_pattern(at, "%d.%m.%Y\u{a0}%H:%M:%S"),
        "seconds" | "from zero" | "seconds of 1969" => seconds.to_string(),
        "milliseconds" | "milliseconds of 1969" => (micros / 1_000).to_string(),
        "microseconds" => micros.to_string(),
        "nanoseconds" => (i128::from(micros) * 1_000).to_string(),
        "fractions of a second" => format!("{seconds}.0"),
        "14 digits" | "14 digits, 9999 among them" => as_pattern(at, "%Y%m%d%H%M%S"),
        "8 and 14 digits" => {
            as_pattern(at, if seconds % 86_400 == 0 { "%Y%m%d" } else { "%Y%m%d%H%M%S" })
        }
        "spreadsheet" => format!("{:.9}", micros as f64 / 86_400e6 + 25_569.0),
        "spreadsheet with comma" => {
            format!("{:.9}", micros as f64 / 86_400e6 + 25_569.0).replace('.', ",")
        }
        "MATLAB" => format!("{:.9}", micros as f64 / 86_400e6 + 719_529.0),
        "seconds since 1904" => (seconds + 2_082_844_800).to_string(),
        "file times" => (i128::from(micros) * 10 + 116_444_736_000_000_000).to_string(),
        _ => as_pattern(at, "%Y-%m-%d %H:%M:%S"),
    }
}

fn never(times: &str) -> &'static str {
    match times {
        "14 digits, 9999 among them" => "99991231235959",
        "day.month.year, 9999 among them" => "31.12.9999 23:59:59",
        _ => "9999-12-31 23:59:59",
    }
}

/// Formats a number in groups of three digits.
fn grouped(whole: u64, sign: char) -> String {
    let digits = whole.to_string();
    let mut grouped = String::new();
    for (place, digit) in digits.chars().enumerate() {
        if place > 0 && (digits.len() - place).is_multiple_of(3) {
            grouped.push(sign);
        }
        grouped.push(digit);
    }
    grouped
}

/// Formats a number of thousandths for a row of a file, and returns its value. Notations without fractions drop the fraction.
fn number(numbers: &str, thousandths: u64, row: usize, file: usize) -> (String, Option<f64>) {
    let whole = thousandths / 1_000;
    let fraction = thousandths % 1_000;
    let half = whole as f64 + 0.5;
    let late = row >= 430;
    match (numbers, file) {
        ("comma", _)
        | ("comma in one file, whole in the other" | "comma in one file, point in the other", 0) => {
            text_and_value(format!("{whole},5"), half)
        }
        ("thousands before a comma", _)
        | ("thousands and comma in one file, thousands in the other", 0) => {
            text_and_value(format!("{},5", grouped(whole, '.')), half)
        }
        ("thousands and comma in one file, thousands in the other", _) => {
            text_and_value(grouped(whole, '.'), whole as f64)
        }
        ("thousands before a point", _) => {
            text_and_value(format!("\"{}.5\"", grouped(whole, ',')), half)
        }
        ("point in one file, thousands in the other", 1) => {
            text_and_value(format!("\"{}\"", grouped(whole, ',')), whole as f64)
        }
        ("three digits behind a point", _) => {
            text_and_value(format!("{whole}.{fraction:03}"), thousandths as f64 / 1_000.0)
        }
        ("three digits behind a comma", _) => {
            text_and_value(format!("{whole},{fraction:03}"), thousandths as f64 / 1_000.0)
        }
        ("whole, then comma", _) if late => text_and_value(format!("{whole},5"), half),
        ("whole, then thousands before a comma", _) if late => {
            text_and_value(format!("{},5", grouped(whole, '.')), half)
        }
        ("whole, then both", _) if late && row.is_multiple_of(2) => {
            text_and_value(format!("{},5", grouped(whole, '.')), half)
        }
        // Thousands have the separator of the file's other numbers.
        ("whole, then both", _) if late => text_and_value(grouped(whole, '.'), whole as f64),
        (
            "whole"
            | "comma in one file, whole in the other"
            | "whole, then comma"
            | "whole, then thousands before a comma"
            | "whole, then both",
            _,
        ) => text_and_value(whole.to_string(), whole as f64),
        ("exponents", _) => text_and_value(
            format!("{whole}.5e-3"),
            format!("{whole}.5e-3").parse().expect("a number"),
        ),
        ("infinite ones among them", _) if row % 17 == 3 => ("inf".to_owned(), None),
        ("infinite ones among them", _) if row % 17 == 4 => ("-1e200".to_owned(), None),
        _ => text_and_value(format!("{whole}.5"), half),
    }
}

fn text_and_value(text: String, value: f64) -> (String, Option<f64>) {
    (text, Some(value))
}

fn quoted(name: &str) -> String {
    format!("\"{}\"", name.replace('"', "\"\""))
}

/// Returns the times and cells of one file.
fn of_file(rows: &[(usize, String, String)], file: usize) -> Vec<(String, String)> {
    let own = rows.iter().filter(|row| row.0 == file);
    own.map(|(_, at, text)| (at.clone(), text.clone())).collect()
}

fn dressed(dress: &str, header: &str, units: &str, rows: &str) -> Vec<u8> {
    let text = match dress {
        "comments and a title" => format!("# exported\n\nPlant 7\n{header}\n{rows}"),
        "units below the header" => format!("{header}\n{units}\n{rows}"),
        "empty lines" => format!("\n{header}\n\n{}", rows.replace('\n', "\n\n")),
        "sep=;" => format!("sep=;\n{header}\n{rows}"),
        "no end of line" => format!("{header}\n{}", rows.trim_end()),
        _ => format!("{header}\n{rows}"),
    };
    match dress {
        "CR LF" => text.replace('\n', "\r\n").into_bytes(),
        "mark of UTF-8" => [b"\xEF\xBB\xBF", text.as_bytes()].concat(),
        "Latin 1" => {
            text.chars().map(|letter| u8::try_from(u32::from(letter)).unwrap_or(b'?')).collect()
        }
        "zstd" => zstd::encode_all(text.as_bytes(), 1).expect("memory"),
        _ => text.into_bytes(),
    }
}

impl Log {
    /// Returns a log of a kind.
    pub(crate) fn of(kind: &Kind, draws: &mut Draws) -> Self {
        let (mut times, zone) = instants(kind, draws);
        if kind.times.ends_with("newest first") {
            times.reverse();
        }
        let mut log = Self { files: Vec::new(), truth: Vec::new(), never: 0, sets: Vec::new() };
        log.sets.extend(zone.map(|zone| format!("data.time_zone={zone}")));
        if kind.shape == "InfluxDB" {
            log.influx(kind, &times, draws);
            return log;
        }
        let separator = kind.separator();
        let per_file = times.len().div_ceil(kind.files());
        let (mut one, mut other) = (Vec::new(), Vec::new());
        for (row, &time) in times.iter().enumerate() {
            let file = row / per_file;
            let most = if draws.below(2) == 0 { 999_000 } else { 900_000_000 };
            let thousandths = 1_000 + draws.below(most) as u64;
            let (text, value) = number(kind.numbers, thousandths, row, file);
            let text = if kind.dress == "all quoted" && !text.starts_with('"') {
                quoted(&text)
            } else {
                text
            };
            let at = written(kind.times, time, zone);
            let at = if kind.dress == "all quoted" { quoted(&at) } else { at };
            log.truth.push(Truth { time, value });
            one.push((file, at.clone(), text));
            other.push((file, at, (row % 7).to_string()));
            if kind.times.ends_with("9999 among them") && row % 50 == 20 {
                log.never += if kind.shape == "long" { 2 } else { 1 };
                one.push((file, never(kind.times).to_owned(), "7".to_owned()));
                other.push((file, never(kind.times).to_owned(), "7".to_owned()));
            }
        }
        let name = quoted(kind.name);
        for file in 0..kind.files() {
            let one = of_file(&one, file);
            let other = of_file(&other, file);
            let mut rows = String::new();
            let both = one.iter().zip(&other);
            let dress = kind.dress;
            match kind.shape {
                "long" => {
                    for ((at, p), (_, q)) in both {
                        writeln!(
                            rows,
                            "{at}{separator}{name}{separator}{p}\n{at}{separator}Q{separator}{q}"
                        )
                        .expect("memory");
                    }
                    let header = format!("time{separator}tag{separator}value");
                    let units = format!("{separator}{separator}kPa");
                    log.add(&format!("part{file}"), dress, dressed(dress, &header, &units, &rows));
                }
                "file per tag" => {
                    for (tag, values) in [("P1", &one), ("Q1", &other)] {
                        let rows: Vec<String> = values
                            .iter()
                            .map(|(at, text)| format!("{at}{separator}{text}\n"))
                            .collect();
                        let rows = rows.concat();
                        let header = format!("time{separator}value");
                        let units = format!("{separator}kPa");
                        log.add(
                            &format!("{tag}_2024-03-0{}", file + 1),
                            dress,
                            dressed(dress, &header, &units, &rows),
                        );
                    }
                }
                _ => {
                    for ((at, p), (_, q)) in both {
                        writeln!(rows, "{at}{separator}{p}{separator}{q}").expect("memory");
                    }
                    let header = format!("time{separator}{name}{separator}Q");
                    let units = format!("{separator}kPa{separator}m3/h");
                    log.add(&format!("part{file}"), dress, dressed(dress, &header, &units, &rows));
                }
            }
        }
        log
    }

    fn add(&mut self, name: &str, dress: &str, content: Vec<u8>) {
        let ending = match dress {
            "zstd" => ".csv.zst",
            _ => ".csv",
        };
        self.files.push((format!("{name}{ending}"), content));
    }

    fn influx(&mut self, kind: &Kind, times: &[i64], draws: &mut Draws) {
        let mut text = String::new();
        let annotation = "#group,false,false,false,false,true\n#datatype,string,long,dateTime:RFC3339,double,string\n#default,_result,,,,\n";
        for (table, name) in [kind.name, "Q"].into_iter().enumerate() {
            writeln!(text, "{annotation},result,table,_time,_value,_field").expect("memory");
            for &time in times {
                let value = draws.below(1_000_000) as f64 / 8.0;
                if table == 0 {
                    self.truth.push(Truth { time, value: Some(value) });
                }
                let at = written(kind.times, time, None);
                writeln!(text, ",,{table},{at},{value},{}", quoted(name)).expect("memory");
            }
            text.push('\n');
        }
        self.files.push(("history.csv".to_owned(), text.into_bytes()));
    }
}
