//! Ticks of a date axis.

use jiff::{
    Timestamp, ToSpan as _,
    civil::{Date, DateTime},
    tz::TimeZone,
};

use super::tick::Tick;

/// Distance between ticks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Every {
    /// Seconds, counted from midnight of 1970-01-01.
    Secs(i64),
    /// Calendar months; a year is twelve.
    Months(i32),
}

const MINUTE: i64 = 60;
const HOUR: i64 = 60 * MINUTE;
const DAY: i64 = 24 * HOUR;
const MONTH_SECS: f64 = 30.44 * DAY as f64;

/// Usual steps of clocks and calendars.
const STEPS: [Every; 22] = [
    Every::Secs(1),
    Every::Secs(5),
    Every::Secs(10),
    Every::Secs(30),
    Every::Secs(MINUTE),
    Every::Secs(5 * MINUTE),
    Every::Secs(10 * MINUTE),
    Every::Secs(30 * MINUTE),
    Every::Secs(HOUR),
    Every::Secs(3 * HOUR),
    Every::Secs(6 * HOUR),
    Every::Secs(12 * HOUR),
    Every::Secs(DAY),
    Every::Secs(2 * DAY),
    Every::Secs(7 * DAY),
    Every::Months(1),
    Every::Months(2),
    Every::Months(3),
    Every::Months(6),
    Every::Months(12),
    Every::Months(60),
    Every::Months(240),
];

impl Every {
    fn secs(self) -> f64 {
        match self {
            Self::Secs(secs) => secs as f64,
            Self::Months(months) => MONTH_SECS * f64::from(months),
        }
    }
}

/// Returns about `wanted` ticks between two instants, in seconds since 1970, at whole minutes, hours, days, months or years.
/// Returns no ticks outside the range of the calendar.
pub(super) fn dates(low: f64, high: f64, wanted: usize) -> Vec<Tick> {
    dates_apart(low, high, (high - low) / wanted.max(1) as f64)
}

/// Returns ticks in the same way, at least `rough` seconds apart.
pub(super) fn dates_apart(low: f64, high: f64, rough: f64) -> Vec<Tick> {
    let every = STEPS.into_iter().find(|step| step.secs() >= rough).unwrap_or(Every::Months(1200));
    match every {
        Every::Secs(step) => {
            let first = (low / step as f64).ceil() as i64;
            let last = (high / step as f64).floor() as i64;
            (first..=last)
                .filter_map(|number| tick(civil((number * step) as f64)?, every))
                .collect()
        }
        Every::Months(step) => months(low, high, step).unwrap_or_default(),
    }
}

fn months(low: f64, high: f64, step: i32) -> Option<Vec<Tick>> {
    let first = civil(low)?.date();
    // Steps count from January of year 0.
    let number =
        (i32::from(first.year()) * 12 + i32::from(first.month()) - 1).div_euclid(step) * step;
    let year = number.div_euclid(12);
    let month = number.rem_euclid(12) + 1;
    let mut date = Date::new(i16::try_from(year).ok()?, i8::try_from(month).ok()?, 1).ok()?;
    let mut ticks = Vec::new();
    while let Some(tick) =
        tick(date.to_datetime(jiff::civil::Time::midnight()), Every::Months(step))
        && tick.value <= high
    {
        if tick.value >= low {
            ticks.push(tick);
        }
        let Ok(next) = date.checked_add(step.months()) else { break };
        date = next;
    }
    Some(ticks)
}

fn civil(secs: f64) -> Option<DateTime> {
    Some(TimeZone::UTC.to_datetime(Timestamp::from_second(secs as i64).ok()?))
}

fn tick(at: DateTime, every: Every) -> Option<Tick> {
    let format = match every {
        Every::Secs(secs) if secs < MINUTE => "%H:%M:%S",
        Every::Secs(secs) if secs < HOUR => "%H:%M",
        Every::Secs(secs) if secs < DAY => "%m-%d %H:%M",
        Every::Secs(_) => "%Y-%m-%d",
        Every::Months(months) if months % 12 != 0 => "%Y-%m",
        Every::Months(_) => "%Y",
    };
    let value = TimeZone::UTC.to_timestamp(at).ok()?.as_second() as f64;
    Some(Tick { value, label: Some(at.strftime(format).to_string()) })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn secs(text: &str) -> f64 {
        let at: DateTime = text.parse().expect("a time");
        TimeZone::UTC.to_timestamp(at).expect("in range").as_second() as f64
    }

    fn labels(from: &str, to: &str) -> Vec<String> {
        dates(secs(from), secs(to), 9).into_iter().filter_map(|tick| tick.label).collect()
    }

    #[test]
    fn a_year_has_months_a_week_has_days_and_a_day_has_hours() {
        let year = labels("2022-03-31T00:00", "2023-03-31T00:00");
        assert_eq!(year, ["2022-05", "2022-07", "2022-09", "2022-11", "2023-01", "2023-03"]);
        let week = labels("2023-04-07T00:10", "2023-04-14T00:00");
        assert_eq!(
            (week.len(), week[0].as_str(), week[6].as_str()),
            (7, "2023-04-08", "2023-04-14")
        );
        let day = labels("2022-11-01T00:00", "2022-11-02T00:00");
        assert_eq!((day.len(), day[1].as_str()), (9, "11-01 03:00"));
        let hour = labels("2022-11-01T00:00", "2022-11-01T01:00");
        assert_eq!((hour.len(), hour[1].as_str()), (7, "00:10"));
        let decades = labels("1950-06-01T00:00", "2020-01-01T00:00");
        assert_eq!(decades, ["1960", "1980", "2000", "2020"]);
    }

    #[test]
    fn times_that_no_calendar_has_are_not_marked() {
        assert!(dates(1e18, 2e18, 9).is_empty());
        assert!(dates(f64::NAN, f64::NAN, 9).is_empty());
    }
}
