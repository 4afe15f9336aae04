//! Columns of the states that are computed and not sensors.

use std::{f64::consts::TAU, ops::Range};

use calib_core::Timestamp;

/// Computes the exponential trace `e ← βe + (1 − β)x` inside each of `runs`, in place. It starts at
/// the first value of a run, so it has no start-up transient.
pub(crate) fn trace(values: &mut [f64], runs: &[Range<usize>], decay: f64) {
    for run in runs {
        let mut trace = values[run.start];
        for value in &mut values[run.clone()] {
            trace = decay * trace + (1.0 - decay) * *value;
            *value = trace;
        }
    }
}

/// Returns the sine and cosine of the time of day (UTC, or the clock of the log). Midnight is the
/// angle 0.
pub(crate) fn time_of_day(timestamps: &[Timestamp]) -> [Vec<f64>; 2] {
    [
        timestamps.iter().map(|&time| angle(time).sin()).collect(),
        timestamps.iter().map(|&time| angle(time).cos()).collect(),
    ]
}

/// Returns the angle of a clock hand that turns once per day, in radians.
fn angle(time: Timestamp) -> f64 {
    const DAY: i64 = 86_400_000_000;
    time.as_micros().rem_euclid(DAY) as f64 / DAY as f64 * TAU
}

#[cfg(test)]
mod tests {
    use std::slice::from_ref;

    use super::*;

    #[test]
    fn traces_restart_in_each_run() {
        let mut values = [1.0, 3.0, 99.0, 5.0, 5.0];
        trace(&mut values, &[0..2, 3..5], 0.5);
        assert_eq!(values, [1.0, 2.0, 99.0, 5.0, 5.0]);
        let mut values = [1.0, 3.0];
        trace(&mut values, from_ref(&(0..2)), 0.0);
        assert_eq!(values, [1.0, 3.0], "no decay is no trace");
    }

    fn are_close(got: &[f64], expected: [f64; 6]) -> bool {
        got.iter().zip(expected).all(|(got, expected)| (got - expected).abs() < 1e-12)
    }

    #[test]
    fn the_day_is_a_circle() {
        let hours = [0, 6, 12, 18, 24, -6].map(|hour| Timestamp::from_micros(hour * 3_600_000_000));
        let [sine, cosine] = time_of_day(&hours);
        assert!(are_close(&sine, [0.0, 1.0, 0.0, -1.0, 0.0, -1.0]));
        assert!(are_close(&cosine, [1.0, 0.0, -1.0, 0.0, 1.0, 0.0]));
    }
}
