//! Times as text: recognises the notation of a column and reads the instants in its cells.

use std::collections::BTreeSet;

use jiff::{
    civil,
    fmt::{strtime, temporal::Pieces},
    tz::TimeZone,
};

use crate::{ParsedTime, TimestampUnit, format_time, parse_stamp, units};

/// A time of the year 9999, which means "never" in databases. Most of that year is beyond the supported instants.
const NEVER: ParsedTime = ParsedTime::Instant(i64::MAX);
const NEVER_YEAR: i16 = 9999;

/// The notation of the times of a column.
#[derive(Clone, Debug, PartialEq)]
pub enum Notation {
    /// ISO 8601.
    Iso,
    /// A number of time units since an epoch, mostly 1970.
    Number(TimestampUnit),
    /// A pattern of `strptime`.
    Pattern(String),
}

impl Notation {
    /// Reads `text` as an instant or a wall-clock time. A date without a time of day is midnight of that day, which
    /// spreadsheets write so. 24:00 is midnight of the next day.
    pub fn read(&self, text: &str) -> Option<ParsedTime> {
        self.read_clock(text).or_else(|| self.read_end_of_day(text)).or_else(|| match self {
            Self::Pattern(pattern) => read_midnight(pattern, text),
            Self::Iso | Self::Number(_) => None,
        })
    }

    /// Returns midnight of the next day if `text` ends in 24:00.
    fn read_end_of_day(&self, text: &str) -> Option<ParsedTime> {
        const DAY: i64 = 86_400_000_000;
        let at = text.find("24:00").filter(|&at| text[..at].ends_with([' ', 'T']))?;
        let start = format!("{}00:00{}", &text[..at], &text[at + "24:00".len()..]);
        match self.read_clock(&start)? {
            ParsedTime::Wall(micros) if micros % DAY == 0 => Some(ParsedTime::Wall(micros + DAY)),
            ParsedTime::Wall(_) | ParsedTime::Instant(_) => None,
        }
    }

    /// Reads a time whose time of day is written out.
    fn read_clock(&self, text: &str) -> Option<ParsedTime> {
        match self {
            Self::Iso => parse_stamp(text).or_else(|| {
                let pieces = Pieces::parse(text).ok()?;
                (pieces.date().year() == NEVER_YEAR).then_some(NEVER)
            }),
            Self::Number(unit) => {
                let micros = match text.parse::<i64>() {
                    Ok(whole) => unit.whole_in_micros(whole),
                    Err(_) => unit.in_micros(number(text)?),
                };
                Some(unit.stamp(micros))
            }
            Self::Pattern(pattern) => read_pattern(pattern, text),
        }
    }

    /// Describes how this notation reads `text` and how to select it in a study.
    pub fn reading(&self, text: &str) -> String {
        let Some(ParsedTime::Instant(micros) | ParsedTime::Wall(micros)) = self.read(text) else {
            return self.name();
        };
        let time = format_time(calib_core::Timestamp::from_micros(micros));
        match self {
            Self::Iso => time,
            Self::Number(unit) => format!("{time} with data.timestamp_unit = \"{}\"", unit.key()),
            Self::Pattern(pattern) => format!("{time} with data.timestamp_format = \"{pattern}\""),
        }
    }

    /// Whether both are numeric dates that differ only in the order of day and month.
    pub fn swaps_days(&self, other: &Self) -> bool {
        let (Self::Pattern(one), Self::Pattern(other)) = (self, other) else { return false };
        let [one, other] = [one, other].map(|pattern| date_of(pattern));
        one != other && one.replace("%d", "%m") == other.replace("%d", "%m")
    }

    /// Returns a readable name.
    pub fn name(&self) -> String {
        match self {
            Self::Iso => "ISO 8601".to_owned(),
            Self::Number(unit) => format!("numbers of {}", unit.name()),
            Self::Pattern(pattern) => pattern.clone(),
        }
    }
}

/// Returns the message about a number that may have several units.
pub fn unit_readings(number: &str, units: &[TimestampUnit]) -> String {
    units.iter().map(|unit| Notation::Number(*unit).reading(number)).collect::<Vec<_>>().join(", ")
}

/// Returns the part of a pattern before the time of day.
fn date_of(pattern: &str) -> &str {
    let clock = pattern.find("%H").or_else(|| pattern.find("%I")).unwrap_or(pattern.len());
    pattern[..clock].trim_end_matches(|c: char| c.is_whitespace() || "T_-,:".contains(c))
}

fn read_pattern(pattern: &str, text: &str) -> Option<ParsedTime> {
    let parsed = strtime::parse(pattern, text)
        .or_else(|error| {
            if text.contains(',') {
                strtime::parse(pattern, text.replace(',', "."))
            } else {
                Err(error)
            }
        })
        .ok()?;
    if parsed.offset().is_some()
        || parsed.iana_time_zone().is_some()
        || parsed.timestamp().is_some()
    {
        return match parsed.to_timestamp() {
            Ok(instant) => Some(ParsedTime::Instant(instant.as_microsecond())),
            Err(_) => (parsed.year() == Some(NEVER_YEAR)).then_some(NEVER),
        };
    }
    let wall = parsed
        .to_datetime()
        .or_else(|_| parsed.to_date().map(|date| date.to_datetime(civil::Time::midnight())))
        .ok()?;
    let Ok(instant) = TimeZone::UTC.to_timestamp(wall) else {
        return (wall.year() == NEVER_YEAR).then_some(NEVER);
    };
    let instant = instant.as_microsecond();
    // A pattern ends in one of these words if the cells do.
    let zone = pattern.to_ascii_uppercase();
    if ["Z", "UTC", "GMT"].into_iter().any(|name| zone.ends_with(name) && !zone.ends_with("%Z")) {
        return Some(ParsedTime::Instant(instant));
    }
    Some(ParsedTime::Wall(instant))
}

/// Reads a date without a time of day as midnight, in a column without a zone that has both dates and times.
fn read_midnight(pattern: &str, text: &str) -> Option<ParsedTime> {
    let clock = pattern.find(" %H").or_else(|| pattern.find(" %I"))?;
    let (date, rest) = pattern.split_at(clock);
    (!text.contains(':') && !rest.contains(['z', 'Z', 'U', 'G']))
        .then(|| read_pattern(date, text))
        .flatten()
}

/// Returns the number in a cell, with either decimal sign.
fn number(text: &str) -> Option<f64> {
    let number: f64 = text.parse().or_else(|_| text.replacen(',', ".", 1).parse()).ok()?;
    number.is_finite().then_some(number)
}

/// Returns the numbers in the cells if all are numbers.
fn numbers(cells: &[&str]) -> Option<Vec<f64>> {
    cells.iter().map(|cell| number(cell)).collect()
}

/// The notations that a column of times may have, given the cells seen so far.
#[derive(Clone, Debug)]
pub struct Candidates {
    /// Notations that can read all cells.
    pub left: Vec<Notation>,
    /// A cell that all of `left` can read. It shows where they differ.
    pub example: String,
    /// Why no notation can read all cells.
    pub unreadable: Option<Unreadable>,
}

/// A notation that is likely, but not certain.
#[derive(Clone, Debug, PartialEq)]
pub struct Likely {
    /// The notation.
    pub notation: Notation,
    /// A sentence that reports the choice to the user.
    pub told: String,
}

/// Days of a spreadsheet from the year 2000 to 2064.
const SPREADSHEET_DAYS: std::ops::RangeInclusive<f64> = 36_526.0..=60_000.0;

/// The reason why the times of a column cannot be read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Unreadable {
    /// The first cell that none of the notations of the other cells can read.
    Cell(String),
    /// Numbers that may have a unit that calib does not read, in words.
    Numbers(String),
}

/// One cell in this many may be damaged.
const MANY: usize = 20;

impl Candidates {
    /// Returns the notations that can read all of `cells`, which are not empty. If there are many cells, up to a
    /// twentieth may be damaged.
    pub fn of(cells: &[&str], unit: Option<TimestampUnit>) -> Self {
        let strict = Self::of_all(cells, unit);
        if !strict.left.is_empty() || cells.len() < MANY {
            return strict;
        }
        for reference in [0, cells.len() / 2, cells.len() - 1] {
            let known = Self::of_all(&cells[reference..=reference], unit).left;
            let whole: Vec<&str> = cells
                .iter()
                .filter(|cell| known.iter().any(|notation| notation.read(cell).is_some()))
                .copied()
                .collect();
            let damaged = cells.len() - whole.len();
            if damaged > 0 && damaged * MANY <= cells.len() {
                let found = Self::of_all(&whole, unit);
                if !found.left.is_empty() {
                    return found;
                }
            }
        }
        strict
    }

    /// Returns the notations that can read all of `cells`.
    fn of_all(cells: &[&str], unit: Option<TimestampUnit>) -> Self {
        // Midnight may be written without a time of day, unlike the other cells.
        let Some(&first) = cells.iter().find(|cell| cell.contains(':')).or(cells.first()) else {
            return Self { left: vec![Notation::Iso], example: String::new(), unreadable: None };
        };
        let told = if let Some(pattern) = compact_pattern(cells).filter(|_| unit.is_none()) {
            Ok(vec![Notation::Pattern(pattern.to_owned())])
        } else if let Some(numbers) = numbers(cells) {
            let units = unit.map_or_else(|| units(&numbers), |unit| Ok(vec![unit]));
            units.map(|units| units.into_iter().map(Notation::Number).collect())
        } else if Notation::Iso.read(first).is_some() {
            Ok(vec![Notation::Iso])
        } else {
            Ok(patterns(first).into_iter().map(Notation::Pattern).collect())
        };
        let (left, unreadable) = match told {
            Ok(left) if left.is_empty() => (left, Some(Unreadable::Cell(first.to_owned()))),
            Ok(left) => (left, None),
            Err(reason) => (Vec::new(), Some(Unreadable::Numbers(reason))),
        };
        let mut candidates = Self { left, example: first.to_owned(), unreadable };
        for cell in cells {
            candidates.note(cell);
        }
        candidates
    }

    /// Removes the notations that cannot read `cell`.
    pub fn note(&mut self, cell: &str) {
        let left: Vec<Notation> =
            self.left.iter().filter(|notation| notation.read(cell).is_some()).cloned().collect();
        if left.is_empty() && !self.left.is_empty() {
            self.unreadable.get_or_insert_with(|| Unreadable::Cell(cell.to_owned()));
        }
        self.left = left;
        // 01/01/2024 does not show the difference between the notations.
        if self.is_ambiguous() && !self.differ(&self.example) && self.differ(cell) {
            cell.clone_into(&mut self.example);
        }
    }

    /// Whether some of the notations read `cell` differently.
    fn differ(&self, cell: &str) -> bool {
        let mut readings = self.left.iter().map(|notation| notation.read(cell));
        let first = readings.next();
        readings.any(|reading| Some(reading) != first)
    }

    /// Whether the remaining notations read some cells differently.
    pub fn is_ambiguous(&self) -> bool {
        self.left.len() > 1
    }

    /// Returns the notation that is meant in practice, of those that are left. `cells` are the first of the column.
    /// `days` are the cells of all rows whose date is not that of the row before.
    pub fn likely(&self, cells: &[&str], days: &[String]) -> Option<Likely> {
        self.likely_order(days).or_else(|| self.likely_spreadsheet(cells))
    }

    /// Dates with points are day first wherever they are written. If the year has two digits, it may come first: the
    /// order whose days follow each other is meant, if that is clear.
    fn likely_order(&self, days: &[String]) -> Option<Likely> {
        let day_first = self.starting("%d.%m.")?;
        let month_first = self.left.iter().find(|other| day_first.swaps_days(other));
        let Some(year_first) = self.starting("%y.%m.") else {
            return Some(self.chosen(day_first, month_first?));
        };
        let [by_day, by_year] = [day_first, year_first].map(|notation| travel(notation, days));
        if CLEARLY * by_day < by_year {
            Some(self.chosen(day_first, month_first.unwrap_or(year_first)))
        } else if CLEARLY * by_year < by_day {
            Some(self.chosen(year_first, day_first))
        } else {
            None
        }
    }

    /// Returns the notation left whose pattern starts with `start`.
    fn starting(&self, start: &str) -> Option<&Notation> {
        self.left.iter().find(
            |notation| matches!(notation, Notation::Pattern(pattern) if pattern.starts_with(start)),
        )
    }

    /// Chooses an order of the fields of dates with points, and tells of the `other` one.
    fn chosen(&self, notation: &Notation, other: &Notation) -> Likely {
        let told = format!(
            "dates with points, such as {}, are read as {}: set data.timestamp_format = \"{}\" if the {} comes first",
            self.example,
            order(notation),
            other.name(),
            order(other).split(',').next().unwrap_or_default()
        );
        Likely { notation: notation.clone(), told }
    }

    /// Days of a spreadsheet from 2000 to 2064 would be seconds of the first day of 1970. Whole numbers may be seconds
    /// of a day.
    fn likely_spreadsheet(&self, cells: &[&str]) -> Option<Likely> {
        let excel = Notation::Number(TimestampUnit::Excel);
        let days = numbers(cells)?;
        let are_days = days.iter().all(|day| SPREADSHEET_DAYS.contains(day))
            && days.iter().any(|day| day.fract() != 0.0);
        let other = self.left.iter().find(|notation| **notation != excel)?;
        (are_days && self.left.contains(&excel)).then(|| Likely {
            told: format!(
                "times such as {} are read as days of a spreadsheet: {}; as numbers since 1970 they would be {}",
                self.example,
                excel.reading(&self.example),
                other.reading(&self.example)
            ),
            notation: excel,
        })
    }

    /// Lists the notations with their readings of the example.
    pub fn readings(&self) -> String {
        let readings = self.left.iter().map(|notation| notation.reading(&self.example));
        readings.collect::<Vec<_>>().join(", ")
    }
}

/// One order of the fields of dates is clear if the steps of the other are so many times as long. Our choice.
const CLEARLY: f64 = 4.0;

/// Returns the sum of the steps between successive `cells`, in microseconds.
fn travel(notation: &Notation, cells: &[String]) -> f64 {
    let times: Vec<i64> =
        cells.iter().filter_map(|cell| notation.read(cell).map(ParsedTime::as_it_stands)).collect();
    times.windows(2).map(|pair| pair[0].abs_diff(pair[1]) as f64).sum()
}

/// Returns the order of the fields of numeric dates, in words.
fn order(notation: &Notation) -> &'static str {
    match notation {
        Notation::Pattern(pattern) if pattern.starts_with("%d") => "day, month, year",
        Notation::Pattern(pattern) if pattern.starts_with("%m") => "month, day, year",
        _ => "year, month, day",
    }
}

/// Returns the patterns that can read `example`: its date in every order that it allows, then its time.
fn patterns(example: &str) -> Vec<String> {
    let Some((date, time)) = split(example) else { return Vec::new() };
    let Some(time) = time_pattern(time) else { return Vec::new() };
    let orders = date_patterns(date);
    orders.into_iter().map(|date| format!("{date}{time}")).collect()
}

/// Returns the pattern of dates written as one number, such as `20240301060000`, if at least three quarters of `cells`
/// match it.
///
/// The digits end at the day, the hour, the minute, the second or the millisecond, and name a time from 1970 to 2099 or
/// of the year 9999. Read as numbers since 1970, they would lie in 1970, in the years 2032 to 2036, in 1976 or in the
/// year 2611.
pub fn compact_pattern(cells: &[&str]) -> Option<&'static str> {
    let mut lengths: Vec<usize> = cells.iter().map(|cell| whole_length(cell)).collect();
    lengths.sort_unstable();
    let length = *lengths.get(lengths.len() / 2)?;
    let pattern = match length {
        8 => "%Y%m%d",
        10 => "%Y%m%d%H",
        12 => "%Y%m%d%H%M",
        14 if cells.iter().any(|cell| whole_length(cell) < cell.len()) => "%Y%m%d%H%M%S%.f",
        14 => "%Y%m%d%H%M%S",
        17 => "%Y%m%d%H%M%S%f",
        _ => return None,
    };
    let dates = cells.iter().copied().filter(|cell| {
        whole_length(cell) == length
            && cell.bytes().take(length).all(|byte| byte.is_ascii_digit())
            && (("1970".."2100").contains(&&cell[..4]) || &cell[..4] == "9999")
            && read_pattern(pattern, cell).is_some()
    });
    (4 * dates.count() >= 3 * cells.len()).then_some(pattern)
}

/// Returns the number of bytes before the decimal sign, or of the whole cell if it has no decimal sign.
fn whole_length(cell: &str) -> usize {
    cell.find(['.', ',']).unwrap_or(cell.len())
}

/// Splits a time into the date, and the time of day with the characters before it.
fn split(example: &str) -> Option<(&str, &str)> {
    let Some(colon) = example.find(':') else { return Some((example, "")) };
    let hour = example[..colon].trim_end_matches(|c: char| c.is_ascii_digit());
    if hour.is_empty() {
        return None;
    }
    // 20240301T0600 has no colon; 2024-03-01 T 06:00 has spaces on both sides.
    let date = hour.trim_end_matches(|c: char| c.is_whitespace() || "T_-,:".contains(c));
    Some((date, &example[date.len()..]))
}

fn date_patterns(date: &str) -> Vec<String> {
    let separators: Vec<&str> =
        date.split(|c: char| c.is_ascii_alphanumeric()).filter(|part| !part.is_empty()).collect();
    let fields: Vec<&str> =
        date.split(|c: char| !c.is_ascii_alphanumeric()).filter(|part| !part.is_empty()).collect();
    let orders: &[[&str; 3]] = &[["%d", "%m", "Y"], ["%m", "%d", "Y"], ["Y", "%m", "%d"]];
    let ([first, second, third], [before, after]) = (&fields[..], &separators[..]) else {
        return match fields[..] {
            [digits] if digits.len() == 8 && separators.is_empty() => vec!["%Y%m%d".to_owned()],
            _ => Vec::new(),
        };
    };
    let fields = [*first, *second, *third];
    // A day in 2024 is never written as 24-Mar-12.
    let has_name = fields
        .iter()
        .any(|field| field.len() >= 3 && field.bytes().all(|byte| byte.is_ascii_alphabetic()));
    let orders = if has_name && fields[0].len() < 4 { &orders[..2] } else { orders };
    let found: BTreeSet<String> = orders
        .iter()
        .filter_map(|order| -> Option<String> {
            let mut pattern = String::new();
            for ((kind, text), separator) in order.iter().zip(fields).zip([*before, *after, ""]) {
                pattern.push_str(field_pattern(kind, text)?);
                pattern.push_str(&separator.replace('%', "%%"));
            }
            Some(pattern)
        })
        .collect();
    found.into_iter().collect()
}

/// Returns the pattern of a field of a date, if the field can be of this kind.
fn field_pattern(kind: &str, text: &str) -> Option<&'static str> {
    let digits = text.bytes().all(|byte| byte.is_ascii_digit());
    match (kind, text.len()) {
        ("Y", 4) if digits => Some("%Y"),
        ("Y", 2) if digits => Some("%y"),
        ("%m", 1 | 2) if digits => Some("%m"),
        ("%d", 1 | 2) if digits => Some("%d"),
        ("%m", 3) if text.bytes().all(|byte| byte.is_ascii_alphabetic()) => Some("%b"),
        ("%m", 4..) if text.bytes().all(|byte| byte.is_ascii_alphabetic()) => Some("%B"),
        _ => None,
    }
}

/// Returns the pattern of a time of day, including the text before and after it.
fn time_pattern(time: &str) -> Option<String> {
    if time.is_empty() {
        return Some(String::new());
    }
    let start = time.find(|c: char| c.is_ascii_digit())?;
    let (before, time) = time.split_at(start);
    let end = time.find(|c: char| !c.is_ascii_digit() && c != ':').unwrap_or(time.len());
    let (clock, mut rest) = time.split_at(end);
    let seconds = match clock.split(':').count() {
        2 => "",
        3 => ":%S%.f",
        _ => return None,
    };
    if let Some(fraction) = rest.strip_prefix(['.', ',']) {
        rest = fraction.trim_start_matches(|c: char| c.is_ascii_digit());
    }
    let space = rest.len() - rest.trim_start().len();
    let (gap, rest) = rest.split_at(space);
    let upper = rest.trim_end().to_ascii_uppercase();
    let (hour, after) = match upper.as_str() {
        "" => ("%H", String::new()),
        "AM" | "PM" => ("%I", format!("{gap}%p")),
        "Z" | "UTC" | "GMT" => ("%H", format!("{gap}{}", rest.trim_end())),
        zone if zone.starts_with(['+', '-']) => {
            let colons = zone.contains(':');
            ("%H", format!("{gap}{}", if colons { "%:z" } else { "%z" }))
        }
        _ => return None,
    };
    Some(format!("{before}{hour}:%M{seconds}{after}"))
}

/// Whether `cell` is a time of day without a date, such as `06:00:00`, `6:00 PM` or `18.00.00`.
pub fn is_time_of_day(cell: &str) -> bool {
    let fields: Vec<&str> = cell.split('.').collect();
    if fields.len() == 3 && fields.iter().all(|field| field.len() <= 2) {
        return fields
            .iter()
            .zip([24, 60, 60])
            .all(|(field, limit)| field.parse::<u8>().is_ok_and(|number| number < limit));
    }
    cell.starts_with(|c: char| c.is_ascii_digit()) && time_pattern(cell).is_some()
}

#[cfg(test)]
mod tests;
