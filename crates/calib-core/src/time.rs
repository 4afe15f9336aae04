use serde::{Deserialize, Serialize};

/// An instant in microseconds since 1970-01-01T00:00:00.
///
/// Logs with a time zone are converted to UTC; logs without one keep their wall-clock reading.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Timestamp(i64);

impl Timestamp {
    /// The instant `micros` microseconds after the epoch.
    pub const fn from_micros(micros: i64) -> Self {
        Self(micros)
    }

    /// Microseconds since the epoch.
    pub const fn as_micros(self) -> i64 {
        self.0
    }

    /// The span from `earlier` to `self`, in microseconds; negative if `earlier` is later.
    pub const fn micros_since(self, earlier: Self) -> i64 {
        self.0 - earlier.0
    }

    /// The instant `periods` sample periods later.
    #[must_use]
    pub const fn plus(self, period: Period, periods: i64) -> Self {
        Self(self.0 + period.0 * periods)
    }
}

/// The time from one sample to the next, in microseconds; always positive.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Period(i64);

impl Period {
    /// A period of `micros` microseconds, or `None` unless it is positive.
    pub const fn from_micros(micros: i64) -> Option<Self> {
        if micros > 0 { Some(Self(micros)) } else { None }
    }

    /// A period of `secs` seconds, or `None` unless it rounds to at least one microsecond.
    pub fn from_secs(secs: f64) -> Option<Self> {
        let micros = (secs * 1e6).round();
        if micros >= 1.0 && micros < i64::MAX as f64 { Some(Self(micros as i64)) } else { None }
    }

    /// Length in microseconds.
    pub const fn as_micros(self) -> i64 {
        self.0
    }

    /// Length in seconds.
    pub fn as_secs(self) -> f64 {
        self.0 as f64 / 1e6
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn periods_are_positive() {
        assert_eq!(Period::from_micros(0), None);
        assert_eq!(Period::from_secs(-1.0), None);
        assert_eq!(Period::from_secs(f64::NAN), None);
        assert_eq!(Period::from_secs(0.5).map(Period::as_micros), Some(500_000));
    }

    #[test]
    fn steps_of_a_period_add_up() {
        let start = Timestamp::from_micros(10);
        let later = start.plus(Period::from_secs(1.0).expect("positive"), 3);
        assert_eq!(later.micros_since(start), 3_000_000);
    }
}
