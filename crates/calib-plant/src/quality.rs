use calib_core::Rng;

use crate::{
    Mode,
    fluctuation::{Fluctuation, Follower},
    signal::{Frame, Signal},
    weather::Conditions,
};

/// Feed flow above which water in the pipe is fresh, L/s.
const FRESH_FLOW: f64 = 0.05;
const TURBIDITY_LIMIT: f64 = 4.9;

/// The water in pipes and tanks: temperature, turbidity, salt, acidity, and the chemicals dosed.
///
/// With the feed running, the pipe follows the river within a minute or so. Standing water warms up
/// towards the hall and settles. A restart flushes deposits past the turbidity sensor.
#[derive(Clone, Debug)]
pub(crate) struct Quality {
    running: Mix,
    standing: Mix,
    pipe: Water,
    flush: Follower,
    tank_temperature: Follower,
    permeate_temperature: Follower,
    tank_turbidity: Follower,
    breakthrough: Follower,
    shimmer: Fluctuation,
    dose: f64,
    hypochlorite: f64,
    refilling: bool,
    step_secs: f64,
}

#[derive(Clone, Copy, Debug)]
struct Water {
    temperature: f64,
    turbidity: f64,
    conductivity: f64,
    acidity: f64,
}

/// Shares of the way to the target in one step, for heat and for matter.
#[derive(Clone, Copy, Debug)]
struct Mix {
    heat: f64,
    matter: f64,
}

impl Mix {
    fn new(heat_secs: f64, matter_secs: f64, step_secs: f64) -> Self {
        Self {
            heat: 1.0 - (-step_secs / heat_secs).exp(),
            matter: 1.0 - (-step_secs / matter_secs).exp(),
        }
    }
}

impl Quality {
    pub(crate) fn new(conditions: &Conditions, step_secs: f64, rng: &mut Rng) -> Self {
        Self {
            running: Mix::new(60.0, 20.0, step_secs),
            standing: Mix::new(5.0 * 3600.0, 2.0 * 3600.0, step_secs),
            pipe: Water {
                temperature: conditions.river,
                turbidity: conditions.turbidity,
                conductivity: conditions.conductivity,
                acidity: conditions.acidity,
            },
            flush: Follower::new(0.0, 60.0, step_secs),
            tank_temperature: Follower::new(conditions.river, 1500.0, step_secs),
            permeate_temperature: Follower::new(conditions.river, 300.0, step_secs),
            tank_turbidity: Follower::new(conditions.turbidity, 1500.0, step_secs),
            breakthrough: Follower::new(0.0, 120.0, step_secs),
            shimmer: Fluctuation::new(0.002, 600.0, step_secs, rng),
            dose: 0.0,
            hypochlorite: 40.0,
            refilling: false,
            step_secs,
        }
    }

    pub(crate) fn enter(&mut self, mode: Mode, rng: &mut Rng) {
        match mode {
            Mode::Production => self.flush.value = rng.uniform(0.02, 0.08),
            Mode::BackPulse => self.breakthrough.value = rng.uniform(0.08, 0.25),
            _ => {}
        }
    }

    /// Returns the temperature at the membrane, °C.
    pub(crate) fn tank_temperature(&self) -> f64 {
        self.tank_temperature.value
    }

    /// Returns the turbidity of the influent, NTU.
    pub(crate) fn turbidity(&self) -> f64 {
        (self.pipe.turbidity + self.flush.value).min(TURBIDITY_LIMIT)
    }

    /// Makes one step with `feed` L/s in the pipe and `permeate` L/s demanded.
    pub(crate) fn step(
        &mut self,
        mode: Mode,
        conditions: &Conditions,
        feed: f64,
        permeate: f64,
        rng: &mut Rng,
    ) {
        let pipe = &mut self.pipe;
        if feed > FRESH_FLOW {
            let Mix { heat, matter } = self.running;
            pipe.temperature += heat * (conditions.river - pipe.temperature);
            pipe.turbidity += matter * (conditions.turbidity - pipe.turbidity);
            pipe.conductivity += matter * (conditions.conductivity - pipe.conductivity);
            pipe.acidity += matter * (conditions.acidity - pipe.acidity);
            self.tank_temperature.step(pipe.temperature);
            self.tank_turbidity.step(pipe.turbidity);
        } else {
            pipe.temperature += self.standing.heat * (conditions.air - pipe.temperature);
            pipe.turbidity += self.standing.matter * (0.02 - pipe.turbidity);
        }
        self.flush.step(0.0);
        self.breakthrough.step(0.0);
        self.shimmer.step(rng);
        let tank = self.tank_temperature.value;
        self.permeate_temperature.step(tank + 0.03 * (conditions.air - tank));

        self.dose = match mode {
            Mode::ChemicalClean => 9.0,
            _ => 9.0 * permeate * (1.0 + 0.3 * pipe.turbidity.min(3.0)) * conditions.organics,
        };
        // About an eighth of the tank per day; topped up to 55 % when it falls to 20 %.
        let change = if self.refilling { 0.06 } else { 0.0 } - self.dose * 5.0e-5;
        self.hypochlorite = (self.hypochlorite + self.step_secs * change).clamp(0.0, 58.0);
        self.refilling = self.hypochlorite < if self.refilling { 55.0 } else { 20.0 };
    }

    /// Writes temperatures, turbidities, chemistry and doses into `frame`.
    pub(crate) fn record(&self, frame: &mut Frame) {
        frame[Signal::Temperature] = self.pipe.temperature;
        frame[Signal::Turbidity] = self.turbidity();
        frame[Signal::Conductivity] = self.pipe.conductivity.clamp(20.0, 490.0);
        frame[Signal::Acidity] = self.pipe.acidity;
        frame[Signal::TankTemperature] = self.tank_temperature.value;
        frame[Signal::PermeateTemperature] = self.permeate_temperature.value;
        frame[Signal::PermeateTurbidity] = (0.03
            + 0.015 * self.tank_turbidity.value
            + self.breakthrough.value
            + self.shimmer.value())
        .clamp(0.0, 1.0);
        frame[Signal::DosePump] = self.dose;
        frame[Signal::HypochloriteLevel] = self.hypochlorite;
    }
}

#[cfg(test)]
mod tests {
    use calib_core::Seed;

    use super::*;

    const RIVER: Conditions = Conditions {
        river: 4.0,
        air: 16.0,
        turbidity: 1.0,
        conductivity: 300.0,
        acidity: 7.4,
        organics: 1.0,
        hour: 12.0,
    };

    #[test]
    fn standing_water_warms_and_settles_and_fresh_water_returns() {
        let mut rng = Seed::new(1).rng();
        let mut quality = Quality::new(&RIVER, 1.0, &mut rng);
        for _ in 0..3600 {
            quality.step(Mode::Standby, &RIVER, 0.0, 0.0, &mut rng);
        }
        // An hour of five towards 16 °C, an hour of two towards clear.
        assert!((quality.pipe.temperature - (16.0 - 12.0 * (-0.2_f64).exp())).abs() < 1e-6);
        assert!((quality.turbidity() - (0.02 + 0.98 * (-0.5_f64).exp())).abs() < 1e-6);
        for _ in 0..600 {
            quality.step(Mode::Production, &RIVER, 0.4, 0.3, &mut rng);
        }
        assert!((quality.pipe.temperature - 4.0).abs() < 0.01);
        assert!((quality.turbidity() - 1.0).abs() < 0.01);
    }

    #[test]
    fn the_hypochlorite_tank_is_topped_up() {
        let mut rng = Seed::new(1).rng();
        let mut quality = Quality::new(&RIVER, 5.0, &mut rng);
        let levels: Vec<f64> = (0..5 * 17_280)
            .map(|_| {
                quality.step(Mode::Production, &RIVER, 0.4, 0.3, &mut rng);
                quality.hypochlorite
            })
            .collect();
        let low = levels.iter().copied().fold(f64::INFINITY, f64::min);
        let high = levels.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        assert!((19.0..20.5).contains(&low) && (54.5..56.0).contains(&high), "{low} {high}");
    }
}
