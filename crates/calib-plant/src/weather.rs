use std::f64::consts::TAU;

use calib_core::{Rng, Seed};

use crate::{
    Feed,
    change::{Feeds, Timeline},
    fluctuation::Fluctuation,
    options::{PlantOptions, SECONDS_PER_DAY, SECONDS_PER_YEAR},
};

/// River and air: the conditions that the plant cannot influence.
#[derive(Clone, Debug)]
pub(crate) struct Weather {
    rng: Rng,
    warmth: Fluctuation,
    ripple: Fluctuation,
    air: Fluctuation,
    salt: Fluctuation,
    acid: Fluctuation,
    storms: Storms,
    feeds: Feeds,
    start_secs: f64,
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Conditions {
    /// River temperature, °C.
    pub(crate) river: f64,
    /// Air temperature in the hall, °C.
    pub(crate) air: f64,
    /// River turbidity, NTU.
    pub(crate) turbidity: f64,
    /// River conductivity, µS/cm.
    pub(crate) conductivity: f64,
    /// River pH.
    pub(crate) acidity: f64,
    /// Organic matter in the river, relative to the usual amount.
    pub(crate) organics: f64,
    /// Hour of the day, 0 – 24.
    pub(crate) hour: f64,
}

impl Weather {
    /// Returns the weather of a plant that takes its water from `feeds`.
    pub(crate) fn new(options: &PlantOptions, feeds: &Timeline<Feed>, step_secs: f64) -> Self {
        let mut rng = options.seed.child("weather").rng();
        Self {
            warmth: Fluctuation::new(0.7, 2.5 * SECONDS_PER_DAY, step_secs, &mut rng),
            ripple: Fluctuation::new(0.04, 1200.0, step_secs, &mut rng),
            air: Fluctuation::new(0.8, 4.0 * 3600.0, step_secs, &mut rng),
            salt: Fluctuation::new(18.0, SECONDS_PER_DAY, step_secs, &mut rng),
            acid: Fluctuation::new(0.07, 0.5 * SECONDS_PER_DAY, step_secs, &mut rng),
            storms: Storms::new(options.seed.child("storms"), options.storms_per_day),
            feeds: Feeds::new(feeds),
            start_secs: options.start.as_micros() as f64 / 1e6,
            rng,
        }
    }

    /// Makes one step, to `t` seconds after the start.
    pub(crate) fn step(&mut self, t: f64) -> Conditions {
        let rng = &mut self.rng;
        let clock = self.start_secs + t;
        let hour = clock.rem_euclid(SECONDS_PER_DAY) / 3600.0;
        let feed = self.feeds.at(t);
        let year = season(clock);
        let feed_year = season(clock - SECONDS_PER_DAY * feed.season_delay_days);
        // Warmest at 16:00.
        let day = (TAU * (hour - 16.0) / 24.0).cos();
        let river = 6.8
            + feed.temperature_offset
            + 5.2 * feed.season * feed_year
            + 0.9 * day
            + self.warmth.step(rng)
            + self.ripple.step(rng);
        let turbidity = 0.03 * feed.turbidity + feed.storms * self.storms.at(t);
        Conditions {
            river: above_freezing(river),
            air: 15.0 + 4.0 * year + 1.5 * day + self.air.step(rng),
            turbidity,
            // Rain dilutes.
            conductivity: 310.0 - 25.0 * feed_year - 40.0 * turbidity
                + self.salt.step(rng)
                + feed.conductivity_offset,
            acidity: 7.45 - 0.12 * turbidity
                + 0.04 * day
                + self.acid.step(rng)
                + feed.acidity_offset,
            organics: feed.organics,
            hour,
        }
    }
}

/// Returns the season from −1 in the coldest to 1 in the warmest, on about 26 July.
fn season(clock: f64) -> f64 {
    (TAU * (clock / SECONDS_PER_YEAR - 0.565)).cos()
}

/// Applies a smooth floor at 0.1 °C: water does not cool below freezing.
fn above_freezing(celsius: f64) -> f64 {
    let floor = 0.1;
    let softness = 0.5;
    let above = (celsius - floor) / softness;
    // ln(1 + eˣ), which is x for large x.
    floor + softness * if above > 30.0 { above } else { above.exp().ln_1p() }
}

/// Turbidity bursts: arrivals of a Poisson process, each rising within minutes and decaying over an
/// hour or so: amplitude · (exp(−age/decay) − exp(−age/rise)).
#[derive(Clone, Debug)]
struct Storms {
    rng: Rng,
    mean_wait: f64,
    next: f64,
    active: Vec<Storm>,
}

#[derive(Clone, Copy, Debug)]
struct Storm {
    began: f64,
    amplitude: f64,
    rise: f64,
    decay: f64,
}

impl Storms {
    fn new(seed: Seed, per_day: f64) -> Self {
        let mut rng = seed.rng();
        // Infinite for a rate of zero, also for a negative zero, so that there is no storm.
        let mean_wait = SECONDS_PER_DAY / per_day.abs();
        let next = mean_wait * rng.exponential();
        Self { rng, mean_wait, next, active: Vec::new() }
    }

    fn at(&mut self, t: f64) -> f64 {
        while self.next <= t {
            let decay = 3000.0 * (0.5 * self.rng.normal()).exp();
            self.active.push(Storm {
                began: self.next,
                amplitude: 0.45 * (0.7 * self.rng.normal()).exp(),
                rise: decay * self.rng.uniform(0.05, 0.2),
                decay,
            });
            self.next += self.mean_wait * self.rng.exponential();
        }
        self.active.retain(|storm| t - storm.began < 15.0 * storm.decay);
        self.active
            .iter()
            .map(|storm| {
                let age = t - storm.began;
                storm.amplitude * ((-age / storm.decay).exp() - (-age / storm.rise).exp())
            })
            .sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::change::Dated;

    fn hourly(options: &PlantOptions, days: usize) -> Vec<Conditions> {
        let mut weather = Weather::new(options, &Timeline::default(), 3600.0);
        (0..days * 24).map(|hour| weather.step(hour as f64 * 3600.0)).collect()
    }

    fn mean(values: impl Iterator<Item = f64>) -> f64 {
        let (sum, count) = values.fold((0.0, 0), |(sum, count), value| (sum + value, count + 1));
        sum / f64::from(count)
    }

    /// Returns the turbidity in every hour of two days.
    fn turbidities(storms_per_day: f64) -> Vec<f64> {
        let conditions = hourly(&PlantOptions { storms_per_day, ..PlantOptions::default() }, 2);
        conditions.iter().map(|conditions| conditions.turbidity).collect()
    }

    #[test]
    fn no_storms_whatever_the_sign_of_zero() {
        assert_eq!(turbidities(-0.0), turbidities(0.0));
    }

    #[test]
    fn the_river_has_seasons_and_days() {
        let conditions = hourly(&PlantOptions::default(), 730);
        let month =
            |first: usize| mean(conditions[first * 24..(first + 30) * 24].iter().map(|c| c.river));
        // November 1 is day 0: January starts on day 61, July on day 242.
        assert!(month(242) > month(61) + 7.0, "{} {}", month(242), month(61));
        let [afternoon, night] = [16.0, 4.0]
            .map(|hour: f64| mean(conditions.iter().filter(|c| c.hour == hour).map(|c| c.river)));
        let swing = afternoon - night;
        assert!((1.2..2.0).contains(&swing), "{swing}");
        assert!(conditions.iter().all(|c| c.river > 0.0));
    }

    /// Returns the river temperature in every minute of twenty days.
    fn river(feeds: &Timeline<Feed>) -> Vec<f64> {
        let mut weather = Weather::new(&PlantOptions::default(), feeds, 60.0);
        (0..20 * 1440).map(|minute| weather.step(f64::from(minute) * 60.0).river).collect()
    }

    #[test]
    fn another_feed_comes_in_without_a_jump() {
        let warm = Feed { blending_days: 2.0, temperature_offset: 3.0, season: 0.5, ..Feed::FIRST };
        let late = Feed { blending_days: 1.0, season_delay_days: 40.0, ..Feed::FIRST };
        let feeds = [(10.0, warm), (11.0, late)]
            .map(|(day, value)| Dated { at: day * SECONDS_PER_DAY, value });
        let with = river(&Timeline::new(feeds.to_vec()));
        let without = river(&Timeline::default());
        let shift: Vec<f64> =
            with.iter().zip(&without).map(|(with, without)| with - without).collect();
        assert!(shift[..10 * 1440].iter().all(|&shift| shift == 0.0));
        assert!(shift.windows(2).all(|pair| (pair[1] - pair[0]).abs() < 0.01));
        assert!(shift[11 * 1440] > 1.0 && shift[19 * 1440] > 0.5, "{}", shift[19 * 1440]);
    }

    #[test]
    fn storms_burst_and_decay() {
        let options = PlantOptions::default();
        let calm = PlantOptions { storms_per_day: 0.0, ..options.clone() };
        assert!(hourly(&calm, 10).iter().all(|c| c.turbidity == 0.03));
        let turbidity: Vec<f64> = hourly(&options, 400).iter().map(|c| c.turbidity).collect();
        // Mean of a shot process: rate × amplitude × (decay − rise).
        let amplitude = 0.45 * (0.5 * 0.7 * 0.7_f64).exp();
        let decay = 3000.0 * (0.5 * 0.5 * 0.5_f64).exp();
        let expected = 0.03 + 6.0 / SECONDS_PER_DAY * amplitude * decay * (1.0 - 0.125);
        let got = mean(turbidity.iter().copied());
        assert!((got / expected - 1.0).abs() < 0.1, "{got} {expected}");
        // Near zero most of the time, high now and then.
        let mut sorted = turbidity;
        sorted.sort_unstable_by(f64::total_cmp);
        let high = sorted[sorted.len() * 99 / 100];
        assert!(high > 8.0 * sorted[sorted.len() / 3], "99 % quantile {high}");
    }
}
