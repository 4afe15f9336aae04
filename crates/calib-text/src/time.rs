//! Reads and writes instants as text in ISO 8601.

use calib_core::Timestamp;
use jiff::{civil, tz::TimeZone};

/// A time read from text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ParsedTime {
    /// A time with an offset from UTC: microseconds since 1970-01-01T00:00:00Z.
    Instant(i64),
    /// A wall-clock time without a zone: microseconds as if it were UTC.
    Wall(i64),
}

impl ParsedTime {
    /// Returns the instant, with wall-clock times read as UTC.
    pub fn as_it_stands(self) -> i64 {
        let (Self::Instant(micros) | Self::Wall(micros)) = self;
        micros
    }
}

/// Reads the instant in `text`: RFC 3339 (`2022-11-01T06:00:00Z`, any offset), a date and time
/// without an offset (read as UTC, with `T` or a space in between), or a date.
pub fn parse_time(text: &str) -> Option<Timestamp> {
    parse_stamp(text).map(|stamp| Timestamp::from_micros(stamp.as_it_stands()))
}

/// Reads a time like [`parse_time`], and keeps whether it has an offset.
pub fn parse_stamp(text: &str) -> Option<ParsedTime> {
    let text = text.trim();
    if let Ok(instant) = text.parse::<jiff::Timestamp>() {
        return Some(ParsedTime::Instant(instant.as_microsecond()));
    }
    let wall: civil::DateTime = text.parse().ok()?;
    Some(ParsedTime::Wall(TimeZone::UTC.to_timestamp(wall).ok()?.as_microsecond()))
}

/// Formats a time as `2022-11-01 06:00:00`, with fractions of a second if there are any.
pub fn format_time(time: Timestamp) -> String {
    jiff::Timestamp::from_microsecond(time.as_micros()).map_or_else(
        |_| format!("{} microseconds", time.as_micros()),
        |instant| {
            let wall = TimeZone::UTC.to_datetime(instant);
            wall.to_string().replace('T', " ")
        },
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn micros(text: &str) -> Option<i64> {
        parse_time(text).map(Timestamp::as_micros)
    }

    #[test]
    fn times_are_read_and_written() {
        assert_eq!(micros("1970-01-02"), Some(86_400_000_000));
        assert_eq!(micros("1970-01-01T00:00:01.5"), Some(1_500_000));
        assert_eq!(micros("1970-01-01 00:00:01"), Some(1_000_000));
        assert_eq!(micros("1970-01-01T01:00:00+01:00"), Some(0));
        assert_eq!(micros("1969-12-31T23:59:59Z"), Some(-1_000_000));
        for text in ["", "yesterday", "2022-13-01", "12:00"] {
            assert_eq!(micros(text), None, "{text}");
        }
        let written = format_time(Timestamp::from_micros(1_667_282_400_000_000));
        assert_eq!(written, "2022-11-01 06:00:00");
        assert_eq!(format_time(Timestamp::from_micros(500_000)), "1970-01-01 00:00:00.5");
        assert_eq!(parse_time(&written).map(format_time), Some(written));
    }
}
