//! Spans of time formatted for readers.

use calib_core::number;

/// Formats a time span in the largest unit that keeps it above one: `30 s`, `8.33 h`, `14 d`.
pub fn duration(secs: f64) -> String {
    let (unit, name) = time_unit(secs);
    format!("{} {name}", number(secs / unit))
}

/// Returns the unit in which `secs` reads best: its length in seconds, and its name.
pub(crate) fn time_unit(secs: f64) -> (f64, &'static str) {
    match secs.abs() {
        size if size >= 3.0 * 86_400.0 => (86_400.0, "d"),
        size if size >= 2.0 * 3_600.0 => (3_600.0, "h"),
        size if size >= 3.0 * 60.0 => (60.0, "min"),
        _ => (1.0, "s"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_have_the_unit_in_which_they_read_best() {
        assert_eq!(duration(30.0), "30 s");
        assert_eq!(duration(30_000.0), "8.33 h");
        assert_eq!(duration(14.0 * 86_400.0), "14 d");
    }
}
