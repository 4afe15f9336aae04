//! The clock on which times are shown.

use calib_core::Timestamp;
use calib_text::{Zone, format_time};

use crate::DataConfig;

/// The clock on which people read times: that of `data.time_zone`, if a study sets it, or otherwise that of
/// the log.
#[derive(Clone, Debug, Default)]
pub struct ShownClock {
    zone: Option<Zone>,
    /// Name of the clock; `None` if times are unchanged from the log.
    name: Option<String>,
}

impl ShownClock {
    /// Returns the clock of a study with this section. `utc` is whether the times of the log are known in
    /// UTC.
    pub fn of(data: &DataConfig, utc: bool) -> Self {
        let zone = data.time_zone.as_deref().and_then(Zone::new);
        let name = match (&zone, utc) {
            (Some(_), _) => data.time_zone.clone(),
            (None, true) => Some("UTC".to_owned()),
            (None, false) => None,
        };
        Self { zone, name }
    }

    /// The zone of `data.time_zone`, if the study names one.
    pub fn zone(&self) -> Option<&Zone> {
        self.zone.as_ref()
    }

    /// A time on this clock.
    pub fn shown(&self, time: Timestamp) -> String {
        let zone = self.zone.as_ref();
        zone.map_or_else(|| format_time(time), |zone| zone.written(time).replacen('T', " ", 1))
    }

    /// Formats a range as `2024-03-01 00:00:00 to 2024-03-08 00:00:00 (Europe/Berlin)`.
    pub fn range(&self, [first, last]: [Timestamp; 2]) -> String {
        format!("{} to {}", self.shown(first), self.named(last))
    }

    /// Formats a time on this clock, followed by the name of the clock.
    pub fn named(&self, time: Timestamp) -> String {
        let name = self.name.as_ref().map_or_else(String::new, |name| format!(" ({name})"));
        format!("{}{name}", self.shown(time))
    }

    /// Describes the clock, for times that are shown without its name.
    pub fn told(&self) -> String {
        match &self.name {
            Some(name) => format!("in {name}"),
            None => "as the log has them".to_owned(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn clock(zone: Option<&str>, utc: bool) -> ShownClock {
        let data = DataConfig { time_zone: zone.map(str::to_owned), ..DataConfig::default() };
        ShownClock::of(&data, utc)
    }

    #[test]
    fn times_are_shown_on_the_clock_of_the_study_with_its_name() {
        let noon = Timestamp::from_micros(1_709_294_400_000_000);
        let berlin = clock(Some("Europe/Berlin"), true);
        assert_eq!(berlin.named(noon), "2024-03-01 13:00:00 (Europe/Berlin)");
        assert_eq!(berlin.told(), "in Europe/Berlin");
        assert_eq!(clock(None, true).named(noon), "2024-03-01 12:00:00 (UTC)");
        let own = clock(None, false);
        assert_eq!(own.range([noon, noon]), "2024-03-01 12:00:00 to 2024-03-01 12:00:00");
        assert_eq!(own.told(), "as the log has them");
    }
}
