//! The unit of numeric times: the study gives it, or the size of the numbers shows it, or two units remain possible.

use std::ops::RangeInclusive;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{ParsedTime, format_time};

/// Unit of timestamps that are plain numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum TimestampUnit {
    /// Seconds since 1970-01-01.
    #[serde(rename = "s")]
    Seconds,
    /// Milliseconds since 1970-01-01.
    #[serde(rename = "ms")]
    Milliseconds,
    /// Microseconds since 1970-01-01.
    #[serde(rename = "us")]
    Microseconds,
    /// Nanoseconds since 1970-01-01.
    #[serde(rename = "ns")]
    Nanoseconds,
    /// Days since 1899-12-30 in the local time of the log, as in spreadsheets; rounded to milliseconds.
    #[serde(rename = "excel")]
    Excel,
}

/// 1970-01-01, in days of a spreadsheet.
const DAYS_TO_1970: f64 = 25_569.0;
const MILLIS_A_DAY: f64 = 86_400e3;

impl TimestampUnit {
    /// Converts `number` to microseconds since 1970.
    pub fn in_micros(self, number: f64) -> i64 {
        let micros = match self {
            Self::Seconds => number * 1e6,
            Self::Milliseconds => number * 1e3,
            Self::Microseconds => number,
            Self::Nanoseconds => number * 1e-3,
            // Fractions of a day are written with fewer digits than microseconds need.
            Self::Excel => ((number - DAYS_TO_1970) * MILLIS_A_DAY).round() * 1e3,
        };
        micros.round() as i64
    }

    /// Converts a whole number to microseconds without losing digits: nanoseconds have more digits than an `f64`.
    pub fn whole_in_micros(self, number: i64) -> i64 {
        match self {
            Self::Seconds => number.saturating_mul(1_000_000),
            Self::Milliseconds => number.saturating_mul(1_000),
            Self::Microseconds => number,
            Self::Nanoseconds => number.div_euclid(1_000),
            Self::Excel => self.in_micros(number as f64),
        }
    }

    /// Returns the time at `micros`: a wall-clock time for spreadsheets, which have no time zones, and else an instant.
    pub fn stamp(self, micros: i64) -> ParsedTime {
        if self == Self::Excel { ParsedTime::Wall(micros) } else { ParsedTime::Instant(micros) }
    }

    /// Returns the name of the unit in a study.
    pub fn key(self) -> &'static str {
        match self {
            Self::Seconds => "s",
            Self::Milliseconds => "ms",
            Self::Microseconds => "us",
            Self::Nanoseconds => "ns",
            Self::Excel => "excel",
        }
    }

    /// Returns a readable name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Seconds => "seconds",
            Self::Milliseconds => "milliseconds",
            Self::Microseconds => "microseconds",
            Self::Nanoseconds => "nanoseconds",
            Self::Excel => "days as spreadsheets count them",
        }
    }
}

/// Years 1990 to 2100, in microseconds: the usual time of plant logs.
const NOW: RangeInclusive<i64> = 631_152_000_000_000..=4_133_894_400_000_000;
/// Years 1900 to 1969, in microseconds: the time of logs before 1970.
const BEFORE: RangeInclusive<i64> = -2_208_988_800_000_000..=-1;

const SINCE_1970: [TimestampUnit; 4] = [
    TimestampUnit::Seconds,
    TimestampUnit::Milliseconds,
    TimestampUnit::Microseconds,
    TimestampUnit::Nanoseconds,
];

/// A unit that calib recognises but does not read.
struct Foreign {
    name: &'static str,
    micros: f64,
    /// The number that stands for 1970.
    zero: f64,
}

impl Foreign {
    fn in_micros(&self, number: f64) -> i64 {
        ((number - self.zero) * self.micros).round() as i64
    }

    fn is_now(&self, number: f64) -> bool {
        NOW.contains(&self.in_micros(number))
    }
}

const FOREIGN: [Foreign; 6] = [
    Foreign { name: "days as MATLAB counts them", micros: 86_400e6, zero: 719_529.0 },
    Foreign { name: "Julian days", micros: 86_400e6, zero: 2_440_587.5 },
    Foreign { name: "seconds since 1904", micros: 1e6, zero: 2_082_844_800.0 },
    Foreign { name: "seconds since 1900", micros: 1e6, zero: 2_208_988_800.0 },
    Foreign { name: "file times of Windows", micros: 0.1, zero: 116_444_736e9 },
    Foreign { name: "ticks of .NET", micros: 0.1, zero: 621_355_968e9 },
];

/// Returns the units that numbers may have; a single one if the size of the numbers is conclusive.
///
/// In seconds, 1e11 is the year 5138; in milliseconds it is 1973. The same holds for the other steps. Numbers before
/// 1970 are small in every unit, and days of a spreadsheet are seconds of the first day of 1970.
///
/// # Errors
/// If the numbers may have a unit that calib does not read: the reason, in words.
pub fn units(numbers: &[f64]) -> Result<Vec<TimestampUnit>, String> {
    let sorted = sorted(numbers);
    let Some(&middle) = sorted.get(sorted.len() / 2) else {
        return Ok(vec![TimestampUnit::Seconds]);
    };
    let guess = by_size(middle.abs());
    if let Some(foreign) = FOREIGN.iter().find(|unit| mostly(&sorted, |number| unit.is_now(number)))
    {
        let [read, known] = [foreign.in_micros(middle), guess.in_micros(middle)].map(told);
        return Err(format!(
            "its numbers, such as {middle}, fit two notations: {read} if they are {}, which calib does not read (write times as text, such as 2022-11-01T06:00:00), \
             and {known} with data.timestamp_unit = \"{}\"",
            foreign.name,
            guess.key()
        ));
    }
    if NOW.contains(&guess.in_micros(middle)) {
        return Ok(vec![guess]);
    }
    if mostly(&sorted, |number| NOW.contains(&TimestampUnit::Excel.in_micros(number))) {
        return Ok(vec![guess, TimestampUnit::Excel]);
    }
    let low = sorted[sorted.len() / 10];
    if low < 0.0 {
        let mut fitting = SINCE_1970.to_vec();
        fitting.retain(|unit| BEFORE.contains(&unit.in_micros(low)));
        if !fitting.is_empty() {
            return Ok(fitting);
        }
    }
    Ok(vec![guess])
}

/// Whether at least three quarters of the numbers satisfy a condition: some stand for something else.
fn mostly(numbers: &[f64], is_so: impl Fn(f64) -> bool) -> bool {
    4 * numbers.iter().filter(|&&number| is_so(number)).count() >= 3 * numbers.len()
}

fn told(micros: i64) -> String {
    format_time(calib_core::Timestamp::from_micros(micros))
}

fn by_size(size: f64) -> TimestampUnit {
    match size {
        _ if size < 1e11 => TimestampUnit::Seconds,
        _ if size < 1e14 => TimestampUnit::Milliseconds,
        _ if size < 1e17 => TimestampUnit::Microseconds,
        _ => TimestampUnit::Nanoseconds,
    }
}

/// Returns the finite numbers in ascending order, evenly thinned if there are many.
fn sorted(numbers: &[f64]) -> Vec<f64> {
    let thinned = numbers.iter().step_by(numbers.len() / THINNED + 1).copied();
    let mut sorted: Vec<f64> = thinned.filter(|number| number.is_finite()).collect();
    sorted.sort_unstable_by(f64::total_cmp);
    sorted
}

/// Number of values that are examined for their unit.
const THINNED: usize = 1 << 16;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::unit_readings;

    fn known_units(numbers: &[f64]) -> Vec<TimestampUnit> {
        units(numbers).expect("known")
    }

    fn unit(numbers: &[f64]) -> Option<TimestampUnit> {
        match known_units(numbers)[..] {
            [unit] => Some(unit),
            _ => None,
        }
    }

    #[test]
    fn the_unit_shows_in_the_size() {
        let second = 1_667_282_400.0;
        for (factor, expected) in [1.0, 1e3, 1e6, 1e9].into_iter().zip(SINCE_1970) {
            assert_eq!(unit(&[second * factor]), Some(expected));
            let sentinels = [0.0, second * factor, second * factor + 1.0, f64::NAN, 9e18, -1.0];
            assert_eq!(unit(&sentinels), Some(expected), "few of them stand for something else");
        }
        assert_eq!(unit(&[]), Some(TimestampUnit::Seconds));
        assert_eq!(unit(&[0.0, 60.0, 120.0]), Some(TimestampUnit::Seconds), "from the beginning");
    }

    #[test]
    fn numbers_that_fit_two_notations_have_both() {
        assert_eq!(
            known_units(&[45_292.5, 45_292.6]),
            [TimestampUnit::Seconds, TimestampUnit::Excel],
            "days of a spreadsheet"
        );
        let hours: Vec<f64> = (0..40).map(|hour| f64::from(hour) * 3600.0).collect();
        assert_eq!(known_units(&hours), [TimestampUnit::Seconds], "seconds that pass through them");
        let before = known_units(&[-1_036_800_000.0, -1_036_740_000.0]);
        assert_eq!(before, SINCE_1970, "milliseconds of December 1969, or seconds of 1937");
        assert_eq!(
            known_units(&[-3.15e11])[0],
            TimestampUnit::Milliseconds,
            "no seconds since 1900"
        );
        assert!(known_units(&[-60_000.0, -30_000.0, 0.0, 30_000.0, 60_000.0]).len() > 1);
        let told = unit_readings("45292.5", &known_units(&[45_292.5]));
        assert!(told.contains("1970-01-01 12:34:52.5 with data.timestamp_unit = \"s\""), "{told}");
        assert!(
            told.contains("2024-01-01 12:00:00 with data.timestamp_unit = \"excel\""),
            "{told}"
        );
    }

    #[test]
    fn what_calib_does_not_read_is_named() {
        for (number, name) in [
            (739_252.5, "MATLAB"),
            (2_460_311.5, "Julian"),
            (3_786_912_000.0, "since 1904"),
            (133_485_408e9, "Windows"),
            (638_396_640e9, ".NET"),
        ] {
            let error = units(&[number, number + 1e-3 * number.sqrt()]).expect_err(name);
            assert!(error.contains(name) && error.contains("20"), "{error}");
        }
    }
}
