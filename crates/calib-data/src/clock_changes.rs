//! Clock changes in Europe: on the last Sundays of March and October, at one to four o'clock in the night.

use calib_core::Timestamp;
use calib_text::format_time;

const HOUR: i64 = 3_600_000_000;
const DAY: i64 = 24 * HOUR;

/// Returns the date of a time between two and three o'clock on the last Sunday of October, which clocks in Central
/// Europe show twice.
pub(crate) fn comes_twice(time: Timestamp) -> Option<String> {
    if hour(time) == 2 { last_sunday(time, "10") } else { None }
}

/// Returns the hour that clocks in Europe skip between two successive rows, such as `02:00 on 2024-03-31`. It begins at
/// one o'clock in Western Europe, at two in Central and at three in Eastern Europe. The rows must be more than an hour
/// and less than an hour and two periods apart.
pub(crate) fn was_left_out(from: Timestamp, to: Timestamp, period_secs: f64) -> Option<String> {
    let step = to.micros_since(from) as f64;
    let is_hour = step > HOUR as f64 && step < HOUR as f64 + 2.0 * period_secs * 1e6;
    let skipped = hour(from) + 1;
    if is_hour && (1..=3).contains(&skipped) && hour(to) == skipped + 1 {
        let date = last_sunday(to, "03")?;
        Some(format!("{skipped:02}:00 on {date}"))
    } else {
        None
    }
}

fn hour(time: Timestamp) -> i64 {
    time.as_micros().rem_euclid(DAY) / HOUR
}

/// Returns the date of a time, if it is the last Sunday of `month`, which has 31 days.
fn last_sunday(time: Timestamp, month: &str) -> Option<String> {
    // 1970-01-01 was a Thursday.
    let is_sunday = (time.as_micros().div_euclid(DAY) + 4).rem_euclid(7) == 0;
    let date = format_time(time).get(..10)?.to_owned();
    let is_last = date.get(5..7)? == month && date.get(8..10)? >= "25";
    (is_sunday && is_last).then_some(date)
}

#[cfg(test)]
mod tests {
    use calib_text::parse_time;

    use super::*;

    fn time(text: &str) -> Timestamp {
        parse_time(text).expect("a time")
    }

    fn skipped(from: &str, to: &str) -> Option<String> {
        was_left_out(time(from), time(to), 60.0)
    }

    #[test]
    fn clocks_change_on_last_sundays() {
        assert_eq!(comes_twice(time("2024-10-27 02:59:00")).as_deref(), Some("2024-10-27"));
        for other in ["2024-10-27 03:00:00", "2024-10-20 02:00:00", "2024-10-26 02:00:00"] {
            assert_eq!(comes_twice(time(other)), None, "{other}");
        }
        for first in 1..=3 {
            let left_out = skipped(
                &format!("2024-03-31 {:02}:59:00", first - 1),
                &format!("2024-03-31 {:02}:00:00", first + 1),
            );
            assert_eq!(left_out, Some(format!("{first:02}:00 on 2024-03-31")));
        }
        assert_eq!(skipped("2024-03-31 03:59:00", "2024-03-31 05:00:00"), None);
        assert_eq!(skipped("2024-03-31 01:59:00", "2024-03-31 03:30:00"), None);
        assert_eq!(skipped("2024-03-24 01:59:00", "2024-03-24 03:00:00"), None);
    }
}
