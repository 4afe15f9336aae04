use calib_core::Timestamp;

/// Returns the month of a timestamp in the proleptic Gregorian calendar, 1 to 12.
///
/// The day count is turned into a date by the arithmetic of Hinnant, "chrono-compatible low-level date
/// algorithms" (2013): years begin in March, so that the leap day comes last.
pub fn month_of(timestamp: Timestamp) -> u8 {
    year_and_month(timestamp).1
}

/// Returns the year of a timestamp in the proleptic Gregorian calendar.
pub fn year_of(timestamp: Timestamp) -> i64 {
    year_and_month(timestamp).0
}

fn year_and_month(timestamp: Timestamp) -> (i64, u8) {
    const MICROS_A_DAY: i64 = 86_400_000_000;
    const DAYS_TO_MARCH_OF_YEAR_0: i64 = 719_468;
    const DAYS_IN_400_YEARS: i64 = 146_097;
    let days = timestamp.as_micros().div_euclid(MICROS_A_DAY) + DAYS_TO_MARCH_OF_YEAR_0;
    let era = days.div_euclid(DAYS_IN_400_YEARS);
    let day = days.rem_euclid(DAYS_IN_400_YEARS);
    let year = (day - day / 1460 + day / 36_524 - day / 146_096) / 365;
    let day_of_year = day - (365 * year + year / 4 - year / 100);
    let months_since_march = (5 * day_of_year + 2) / 153;
    let month = (months_since_march + 2) % 12 + 1;
    // January and February end the year that began in March.
    (400 * era + year + i64::from(month <= 2), month as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn length(year: i64, month: u8) -> i64 {
        match month {
            2 if year % 4 == 0 && (year % 100 != 0 || year % 400 == 0) => 29,
            2 => 28,
            4 | 6 | 9 | 11 => 30,
            _ => 31,
        }
    }

    #[test]
    fn every_day_of_a_thousand_years_has_its_month() {
        // 1600-01-01 is 135 140 days before 1970-01-01.
        let mut day = -135_140_i64;
        for year in 1600..2600 {
            for month in 1..=12 {
                for _ in 0..length(year, month) {
                    let micros = day * 86_400_000_000;
                    let first = Timestamp::from_micros(micros);
                    assert_eq!((year_of(first), month_of(first)), (year, month));
                    assert_eq!(month_of(Timestamp::from_micros(micros + 86_399_999_999)), month);
                    day += 1;
                }
            }
        }
    }
}
