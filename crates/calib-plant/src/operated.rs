//! A membrane plant that is operated by a decision every half hour.

use calib_core::{Rng, Seed, Timestamp};

use crate::{
    Membranes, Mode, PlantOptions, Recipe,
    change::Timeline,
    membrane::Membrane,
    options::{SECONDS_PER_DAY, SECONDS_PER_YEAR},
    weather::{Conditions, Weather},
};

/// Time from one decision to the next, s.
pub const DECISION_SECS: f64 = 1800.0;
/// Step of the physics, s. All recipes are whole numbers of steps.
const STEP_SECS: f64 = 30.0;
/// Step of the weather, s.
const WEATHER_SECS: f64 = 300.0;
/// Above this pressure the plant trips and is cleaned with chemicals, kPa.
pub const TRIP_KPA: f64 = 55.0;
/// Flow of a back-pulse, L/s, and the power of its air scour, kW.
const PULSE_FLOW: f64 = 1.1;
const SCOUR_KW: f64 = 1.2;
/// Efficiency of the pump.
const PUMP_EFFICIENCY: f64 = 0.5;
/// Flow for which the fouling rate of [`Membrane`] is given, L/s.
const USUAL_FLOW: f64 = 0.28;
/// Dose that halves the fouling, mg/L. The factor at dose d is 0.5 to the power d / 2.
const HALVING_DOSE: f64 = 2.0;
/// Relative error of instruments.
const ERROR: f64 = 0.01;

/// Instrument readings at the time of a decision.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// Highest pressure since the last decision, kPa.
    pub pressure_kpa: f64,
    /// Resistance by Darcy's law after the last back-pulse, kPa per (L/s · mPa·s).
    pub resistance: f64,
    /// Temperature of the feed, °C.
    pub temperature_celsius: f64,
    /// Turbidity of the feed, NTU.
    pub turbidity_ntu: f64,
}

/// Cost and yield of half an hour.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Account {
    /// Permeate minus the consumption of back-pulses, m³.
    pub permeate_m3: f64,
    /// Energy of the permeate pump and of the air scour, kWh.
    pub energy_kwh: f64,
    /// Coagulant, g.
    pub chemicals_g: f64,
    /// Whether the plant tripped and must be cleaned.
    pub tripped: bool,
}

/// A plant whose recipe is chosen every half hour by a policy.
///
/// The membrane is that of [`Plant`](crate::Plant), in the same weather. In addition, the deposit per litre grows with
/// the flow, and a dose of coagulant halves it. The properties of the plant (its membrane, the rate of turbidity
/// bursts, the time of the year) follow from its seed. The weather follows from the generator of the first start, so
/// one plant can run through many different years. Constants are our choice.
#[derive(Clone, Debug)]
pub struct OperatedPlant {
    membranes: Membranes,
    storms_per_day: f64,
    start_secs: f64,
    weather: Option<Weather>,
    /// Seconds since the first start.
    now: f64,
    conditions: Conditions,
    membrane: Membrane,
    since_pulse: f64,
    reading: Reading,
    account: Account,
}

const CALM: Conditions = Conditions {
    river: 8.0,
    air: 15.0,
    turbidity: 0.03,
    conductivity: 300.0,
    acidity: 7.4,
    organics: 1.0,
    hour: 0.0,
};

impl OperatedPlant {
    /// Returns the plant of this seed.
    pub fn new(seed: Seed) -> Self {
        let mut rng = seed.child("operated plant").rng();
        let membranes = Membranes {
            resistance: (0.08 * rng.normal()).exp(),
            fouling: (0.2 * rng.normal()).exp(),
        };
        Self {
            membranes,
            storms_per_day: rng.uniform(4.0, 10.0),
            start_secs: rng.uniform(0.0, SECONDS_PER_YEAR),
            weather: None,
            now: 0.0,
            conditions: CALM,
            membrane: Membrane::new(STEP_SECS),
            since_pulse: 0.0,
            reading: Reading {
                pressure_kpa: 0.0,
                resistance: 0.0,
                temperature_celsius: 0.0,
                turbidity_ntu: 0.0,
            },
            account: Account::default(),
        }
    }

    /// Returns the present instrument readings.
    pub fn reading(&self) -> Reading {
        self.reading
    }

    /// Returns cost and yield of the last half hour.
    pub fn account(&self) -> Account {
        self.account
    }

    /// Starts with a membrane that was just cleaned. The weather continues.
    pub fn start_clean(&mut self, rng: &mut Rng) {
        self.start(rng, 1.0, 3.0);
    }

    /// Starts with a membrane in any condition short of a trip.
    pub fn start_anywhere(&mut self, rng: &mut Rng) {
        let cake = rng.uniform(0.0, 30.0);
        let pores = rng.uniform(2.0, 30.0);
        self.start(rng, cake, pores);
    }

    fn start(&mut self, rng: &mut Rng, cake: f64, pores: f64) {
        if self.weather.is_none() {
            let options = PlantOptions {
                seed: Seed::new(rng.bits()),
                storms_per_day: self.storms_per_day,
                start: Timestamp::from_micros((self.start_secs * 1e6) as i64),
                ..PlantOptions::default()
            };
            self.weather = Some(Weather::new(&options, &Timeline::default(), WEATHER_SECS));
        }
        // A clean takes eight hours.
        self.pass(SECONDS_PER_DAY / 3.0);
        self.membrane.fit(self.membranes);
        self.membrane.foul(cake, pores);
        self.since_pulse = 0.0;
        self.account = Account::default();
        let pressure = self.membrane.pressure(USUAL_FLOW, self.conditions.river);
        self.read(pressure, self.membrane.resistance(), rng);
    }

    /// Advances the weather by `secs`.
    fn pass(&mut self, secs: f64) {
        for _ in 0..(secs / WEATHER_SECS) as u32 {
            self.now += WEATHER_SECS;
            if let Some(weather) = &mut self.weather {
                self.conditions = weather.step(self.now);
            }
        }
    }

    fn read(&mut self, pressure: f64, resistance: f64, rng: &mut Rng) {
        self.reading = Reading {
            pressure_kpa: measured(pressure, rng),
            resistance: measured(resistance, rng),
            temperature_celsius: measured(self.conditions.river, rng),
            turbidity_ntu: measured(self.conditions.turbidity, rng),
        };
    }

    /// Operates by `recipe` until the next decision, or until the plant trips.
    pub fn operate(&mut self, recipe: &Recipe, rng: &mut Rng) -> Account {
        self.account = Account::default();
        let mut highest = 0.0_f64;
        let mut relieved = self.reading.resistance;
        let mut done = 0.0;
        let mut weathered = 0.0;
        while done < DECISION_SECS && !self.account.tripped {
            if self.since_pulse >= recipe.interval_secs {
                done += self.pulse(recipe, rng);
                relieved = self.membrane.resistance();
                continue;
            }
            if weathered <= done {
                self.pass(WEATHER_SECS);
                weathered += WEATHER_SECS;
            }
            highest = highest.max(self.produce(recipe));
            done += STEP_SECS;
        }
        self.read(highest, relieved, rng);
        self.account
    }

    /// Makes one step of production, and returns the pressure at its end.
    fn produce(&mut self, recipe: &Recipe) -> f64 {
        let flow = recipe.flow_litres_per_second;
        let undosed = 0.5_f64.powf(recipe.dose_mg_per_litre / HALVING_DOSE);
        let fouls = self.conditions.organics * undosed * flow / USUAL_FLOW;
        self.membrane.step(Mode::Production, flow, self.conditions.turbidity, fouls);
        let pressure = self.membrane.pressure(flow, self.conditions.river);
        let litres = flow * STEP_SECS;
        self.account.permeate_m3 += litres / 1000.0;
        // 1 kPa times 1 m³ is 1 kJ.
        self.account.energy_kwh += pressure * litres / 1000.0 / 3600.0 / PUMP_EFFICIENCY;
        self.account.chemicals_g += litres * recipe.dose_mg_per_litre / 1000.0;
        self.account.tripped = pressure > TRIP_KPA;
        self.since_pulse += STEP_SECS;
        pressure
    }

    /// Makes a back-pulse, and returns its duration, s.
    fn pulse(&mut self, recipe: &Recipe, rng: &mut Rng) -> f64 {
        self.membrane.enter(Mode::BackPulse, rng);
        let mut took = 0.0;
        while took < recipe.pulse_secs {
            self.membrane.step(Mode::BackPulse, -PULSE_FLOW, self.conditions.turbidity, 1.0);
            took += STEP_SECS;
        }
        self.account.permeate_m3 -= PULSE_FLOW * took / 1000.0;
        self.account.energy_kwh += SCOUR_KW * took / 3600.0;
        self.since_pulse = 0.0;
        took
    }
}

/// Returns a value with the error of its instrument.
fn measured(value: f64, rng: &mut Rng) -> f64 {
    value * (1.0 + ERROR * rng.normal())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{RECIPES, operators_rule};

    /// Returns the totals over `decisions` of a policy, with the number of trips.
    fn year(policy: impl Fn(Reading) -> usize, decisions: usize) -> (f64, usize) {
        let mut plant = OperatedPlant::new(Seed::new(3));
        let mut rng = Seed::new(4).rng();
        plant.start_clean(&mut rng);
        let mut permeate = 0.0;
        let mut trips = 0;
        for _ in 0..decisions {
            let account = plant.operate(&RECIPES[policy(plant.reading())], &mut rng);
            permeate += account.permeate_m3;
            trips += usize::from(account.tripped);
            if account.tripped {
                plant.start_clean(&mut rng);
            }
        }
        (permeate, trips)
    }

    #[test]
    fn a_higher_flow_brings_more_and_trips_more() {
        let (by_rule, rare) = year(
            |reading: Reading| operators_rule(reading.pressure_kpa, reading.turbidity_ntu),
            5000,
        );
        let (_, often) = year(|_| 5, 5000);
        assert!(often > 3 * rare.max(1), "{often} trips, {rare} by the rule");
        assert!((0.2..0.5).contains(&(by_rule / 5000.0)), "{by_rule}");
    }

    #[test]
    fn a_dose_and_frequent_pulses_keep_the_pressure_low() {
        let [long, normal, careful] = [2, 1, 4].map(|recipe: usize| {
            let mut plant = OperatedPlant::new(Seed::new(5));
            let mut rng = Seed::new(6).rng();
            plant.start_clean(&mut rng);
            let mut sum = 0.0;
            for _ in 0..300 {
                plant.operate(&RECIPES[recipe], &mut rng);
                sum += plant.reading().pressure_kpa;
            }
            sum / 300.0
        });
        assert!(long > normal + 1.0 && normal > careful + 1.0, "{long} {normal} {careful}");
    }

    /// Returns three half-hours of a plant, given the seeds of plant and weather.
    fn lived(plant: u64, life: u64) -> [Account; 3] {
        let mut plant = OperatedPlant::new(Seed::new(plant));
        let mut rng = Seed::new(life).rng();
        plant.start_anywhere(&mut rng);
        [1, 7, 0].map(|recipe: usize| plant.operate(&RECIPES[recipe], &mut rng))
    }

    #[test]
    fn the_same_generator_gives_the_same_half_hours() {
        assert_eq!(lived(1, 2), lived(1, 2));
        assert_ne!(lived(1, 2), lived(1, 3));
        assert_ne!(lived(1, 2), lived(2, 2));
    }

    #[test]
    fn an_account_is_what_the_recipe_says() {
        let mut plant = OperatedPlant::new(Seed::new(1));
        let mut rng = Seed::new(1).rng();
        plant.start_clean(&mut rng);
        // Half an hour of production, then a pulse at the next decision.
        let [first, second] = [3, 3].map(|recipe| plant.operate(&RECIPES[recipe], &mut rng));
        assert!((first.permeate_m3 - 0.28 * 1.8).abs() < 1e-9, "{first:?}");
        assert!((first.chemicals_g - 0.28 * 1.8 * 2.0).abs() < 1e-9);
        assert!((second.permeate_m3 - (0.28 * 1.74 - 1.1 * 0.06)).abs() < 1e-9, "{second:?}");
        assert!(second.energy_kwh > 1.2 * 60.0 / 3600.0);
    }
}
