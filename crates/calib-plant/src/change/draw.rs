use calib_core::{Rng, Seed, Timestamp};

use super::{
    Change, ChangeKind, ChangeOptions, Dated, Feed, Membranes, Pump, PumpDuty, Sensor, Settings,
    Timeline,
};
use crate::{
    channel::Recipe,
    options::{PlantOptions, SECONDS_PER_DAY, SECONDS_PER_YEAR},
    signal::{SIGNALS, Signal, SignalInfo},
};

/// Every change of a plant, by kind, each in time order.
#[derive(Clone, Debug, Default)]
pub(crate) struct Changes {
    pub(crate) membranes: Timeline<Membranes>,
    pub(crate) feeds: Timeline<Feed>,
    pub(crate) settings: Timeline<Settings>,
    pub(crate) permeate_pumps: Timeline<Pump>,
    pub(crate) feed_pumps: Timeline<Pump>,
    /// The sensors that change at all, with their timelines.
    pub(crate) sensors: Vec<(&'static SignalInfo, Timeline<Sensor>)>,
}

impl Changes {
    /// Draws the changes of the plant with these options.
    pub(crate) fn of(options: &PlantOptions) -> Self {
        let ChangeOptions { strength, .. } = options.change;
        if strength == 0.0 {
            return Self::default();
        }
        let rates = options.change;
        let seed = options.seed.child("change");
        let span = Span { seed, days: options.days };
        let pumps = span.events("pump", rates.pumps_per_year, |draw| draw.pump(strength));
        let (permeate, feed) =
            pumps.into_iter().partition(|event| event.value.duty == PumpDuty::Permeate);
        let of_sensors = Span { seed: seed.child("sensor"), days: options.days };
        let sensors = SIGNALS.iter().filter(|info| info.is_sensor()).filter_map(|info| {
            let events = of_sensors
                .events(info.tag, rates.sensors_per_year, |draw| draw.sensor(info, strength));
            (!events.is_empty()).then(|| (info, Timeline::new(events)))
        });
        Self {
            membranes: Timeline::new(
                span.events("membranes", rates.membranes_per_year, |draw| draw.membranes(strength)),
            ),
            feeds: Timeline::new(
                span.events("feed", rates.feeds_per_year, |draw| draw.feed(strength)),
            ),
            settings: Timeline::new(
                span.events("settings", rates.settings_per_year, |draw| draw.settings(strength)),
            ),
            permeate_pumps: Timeline::new(permeate),
            feed_pumps: Timeline::new(feed),
            sensors: sensors.collect(),
        }
    }

    /// Returns the changes of a sensor over time, or `None` if the recipe is not a sensor.
    pub(crate) fn of_recipe(&self, recipe: Recipe) -> Option<&Timeline<Sensor>> {
        let (Recipe::Lagged { signal, .. } | Recipe::Filtered { signal, .. }) = recipe else {
            return None;
        };
        self.sensors.iter().find(|(info, _)| info.signal == signal).map(|(_, timeline)| timeline)
    }

    /// Returns all changes in time order. Changes of a sensor are included only if it is `shown`.
    pub(crate) fn told(
        &self,
        options: &PlantOptions,
        shown: impl Fn(Signal) -> bool,
    ) -> Vec<Change> {
        fn all<T: Copy>(
            timeline: &Timeline<T>,
            kind: impl Fn(T) -> ChangeKind,
        ) -> Vec<(f64, ChangeKind)> {
            timeline.events().iter().map(|event| (event.at, kind(event.value))).collect()
        }
        let mut told = all(&self.membranes, ChangeKind::Membranes);
        told.extend(all(&self.feeds, ChangeKind::Feed));
        told.extend(all(&self.settings, ChangeKind::Settings));
        told.extend(all(&self.permeate_pumps, ChangeKind::Pump));
        told.extend(all(&self.feed_pumps, ChangeKind::Pump));
        for (info, timeline) in self.sensors.iter().filter(|(info, _)| shown(info.signal)) {
            told.extend(all(timeline, |sensor| ChangeKind::Sensor {
                tag: info.tag.to_owned(),
                sensor,
            }));
        }
        told.sort_by(|a, b| a.0.total_cmp(&b.0));
        let start = options.start.as_micros();
        let changes = told.into_iter().map(|(secs, kind)| {
            let at = Timestamp::from_micros(start + secs as i64 * 1_000_000);
            Change { at, kind }
        });
        changes.collect()
    }
}

/// The time range of a log in which changes are drawn.
struct Span {
    seed: Seed,
    days: f64,
}

impl Span {
    /// Returns events for `name` at the whole seconds of a Poisson process of rate `per_year`. The n-th value follows
    /// from seed, name and n alone, so that rates move only the dates.
    fn events<T>(
        &self,
        name: &str,
        per_year: f64,
        value: impl Fn(&mut Draw) -> T,
    ) -> Vec<Dated<T>> {
        let seed = self.seed.child(name);
        let mut waits = seed.child("dates").rng();
        // Infinite for a rate of zero, so that there is no event.
        let mut wait = || SECONDS_PER_YEAR / per_year * waits.exponential();
        let mut events = Vec::new();
        let mut at = wait();
        while at < self.days * SECONDS_PER_DAY {
            let rng = seed.child("values").number(events.len() as u64).rng();
            events.push(Dated { at: at.floor(), value: value(&mut Draw(rng)) });
            at += wait();
        }
        events
    }
}

/// A generator for the sizes of changes.
struct Draw(Rng);

impl Draw {
    /// Returns a standard normal number truncated at ±2, so that no event is extreme.
    fn z(&mut self) -> f64 {
        loop {
            let z = self.0.normal();
            if z.abs() <= 2.0 {
                return z;
            }
        }
    }

    /// Returns a factor of median 1 whose logarithm has the standard deviation `spread`, before truncation.
    fn factor(&mut self, spread: f64) -> f64 {
        (spread * self.z()).exp()
    }

    fn membranes(&mut self, strength: f64) -> Membranes {
        Membranes { resistance: self.factor(0.2 * strength), fouling: self.factor(0.4 * strength) }
    }

    fn feed(&mut self, strength: f64) -> Feed {
        Feed {
            blending_days: self.0.uniform(1.0, 14.0),
            temperature_offset: 1.2 * strength * self.z(),
            season: self.factor(0.15 * strength),
            season_delay_days: 10.0 * strength * self.z(),
            turbidity: self.factor(0.5 * strength),
            storms: self.factor(0.5 * strength),
            conductivity_offset: 30.0 * strength * self.z(),
            acidity_offset: 0.1 * strength * self.z(),
            organics: self.factor(0.25 * strength),
        }
    }

    fn sensor(&mut self, info: &SignalInfo, strength: f64) -> Sensor {
        let span = info.range.1 - info.range.0;
        let offset = 0.015 * span * strength * self.z();
        Sensor {
            // Stray light and deposits on the windows only add to the reading of a turbidimeter.
            offset: if info.unit == "NTU" { offset.abs() } else { offset },
            gain: self.factor(0.04 * strength),
            time_constant_secs: strength * (self.0.uniform(5.0_f64.ln(), 120.0_f64.ln())).exp(),
            noise: self.factor(0.4 * strength),
        }
    }

    fn settings(&mut self, strength: f64) -> Settings {
        Settings {
            production: self.factor(0.08 * strength),
            back_pulse_interval: self.factor(0.2 * strength),
        }
    }

    fn pump(&mut self, strength: f64) -> Pump {
        Pump {
            duty: if self.0.unit() < 0.5 { PumpDuty::Permeate } else { PumpDuty::Feed },
            speed: self.factor(0.08 * strength),
            pulsation: self.factor(0.4 * strength),
            response: self.factor(0.4 * strength),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn changes(days: f64, change: ChangeOptions) -> Vec<Change> {
        let options = PlantOptions { days, change, ..PlantOptions::default() };
        Changes::of(&options).told(&options, |_| true)
    }

    fn dates(changes: &[Change]) -> Vec<i64> {
        changes.iter().map(|change| change.at.as_micros()).collect()
    }

    #[test]
    fn nothing_changes_at_strength_zero() {
        let often = ChangeOptions { feeds_per_year: 50.0, ..ChangeOptions::default() };
        assert_eq!(changes(3650.0, often), []);
    }

    #[test]
    fn rates_are_those_asked_for() {
        let years = 400.0;
        let typical = ChangeOptions { strength: 1.0, ..ChangeOptions::default() };
        let all = changes(365.2425 * years, typical);
        let rate = |is: fn(&ChangeKind) -> bool| {
            all.iter().filter(|change| is(&change.kind)).count() as f64 / years
        };
        let sensors = SIGNALS.iter().filter(|info| info.is_sensor()).count() as f64;
        for (got, expected) in [
            (rate(|kind| matches!(kind, ChangeKind::Membranes(_))), 1.0),
            (rate(|kind| matches!(kind, ChangeKind::Feed(_))), 2.0),
            (rate(|kind| matches!(kind, ChangeKind::Settings(_))), 2.0),
            (rate(|kind| matches!(kind, ChangeKind::Pump(_))), 1.0),
            (rate(|kind| matches!(kind, ChangeKind::Sensor { .. })), 0.5 * sensors),
        ] {
            assert!((got / expected - 1.0).abs() < 0.15, "{got} a year, expected {expected}");
        }
        assert!(all.is_sorted_by(|a, b| a.at <= b.at));
    }

    fn changes_of_strength(strength: f64) -> Vec<Change> {
        changes(3650.0, ChangeOptions { strength, ..ChangeOptions::default() })
    }

    #[test]
    fn a_stronger_plant_has_the_same_dates_and_larger_changes() {
        let weak = changes_of_strength(0.5);
        let strong = changes_of_strength(2.0);
        assert!(!weak.is_empty() && dates(&weak) == dates(&strong));
        for (weak, strong) in weak.iter().zip(&strong) {
            if let (ChangeKind::Membranes(weak), ChangeKind::Membranes(strong)) =
                (&weak.kind, &strong.kind)
            {
                let four_times = 4.0 * weak.resistance.ln();
                assert!((strong.resistance.ln() - four_times).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn a_longer_log_has_the_same_beginning() {
        let typical = ChangeOptions { strength: 1.0, ..ChangeOptions::default() };
        let short = changes(400.0, typical);
        let long = changes(2000.0, typical);
        assert!(short.len() > 3 && long.len() > short.len());
        assert_eq!(long[..short.len()], short);
    }
}
