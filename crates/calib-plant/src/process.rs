use calib_core::Rng;

use crate::{
    Membranes, Mode, Pump, PumpDuty, Settings,
    change::{Changes, Dated, Timeline},
    fluctuation::{Fluctuation, Follower},
    hydraulics::{Demand, Hydraulics},
    membrane::{Membrane, viscosity},
    options::PlantOptions,
    quality::Quality,
    schedule::Schedule,
    signal::{Frame, Signal},
    weather::{Conditions, Weather},
};

/// The longest step of the process, s. For coarser logs the process is integrated between rows.
const LONGEST_STEP: f64 = 5.0;
/// Period after which the synchronisation timer wraps, s. No usual sampling interval divides it.
const SYNC_SECS: f64 = 119.965;

/// The plant itself, without instruments. Its state is carried from row to row, and is the same
/// whether or not the rows are read.
#[derive(Clone, Debug)]
pub(crate) struct Process {
    period_secs: f64,
    steps_per_row: u32,
    row: i64,
    rng: Rng,
    schedule: Schedule,
    settings: Timeline<Settings>,
    membranes: Exchanged<Membranes>,
    pumps: [Exchanged<Pump>; 2],
    weather: Weather,
    membrane: Membrane,
    hydraulics: Hydraulics,
    quality: Quality,
    pressure: Follower,
    pulsation: Fluctuation,
    permeability: f64,
    pump_hours: f64,
    cycles: u32,
    demand: Demand,
}

impl Process {
    /// Returns the plant at its start, with all its later changes.
    pub(crate) fn new(options: &PlantOptions, changes: &Changes) -> Self {
        let period_secs = options.period.as_secs();
        let steps_per_row = (period_secs / LONGEST_STEP).ceil().max(1.0) as u32;
        let step_secs = period_secs / f64::from(steps_per_row);
        let mut rng = options.seed.child("process").rng();
        let mut weather = Weather::new(options, &changes.feeds, step_secs);
        let conditions = weather.step(0.0);
        Self {
            period_secs,
            steps_per_row,
            row: 0,
            schedule: Schedule::new(options.seed.child("schedule"), changes.settings.clone()),
            settings: changes.settings.clone(),
            membranes: Exchanged::new(&changes.membranes),
            pumps: [&changes.permeate_pumps, &changes.feed_pumps].map(Exchanged::new),
            membrane: Membrane::new(step_secs),
            hydraulics: Hydraulics::new(step_secs, &mut rng),
            quality: Quality::new(&conditions, step_secs, &mut rng),
            pressure: Follower::new(0.0, 5.0, step_secs),
            pulsation: Fluctuation::new(0.35, 12.0, step_secs, &mut rng),
            permeability: 0.0,
            pump_hours: 0.0,
            cycles: 0,
            demand: Demand::default(),
            weather,
            rng,
        }
    }

    /// Computes the signals of the next row.
    pub(crate) fn next_row(&mut self, frame: &mut Frame) {
        let steps = if self.row == 0 { 1 } else { self.steps_per_row };
        let now = self.row as f64 * self.period_secs;
        let step_secs = self.period_secs / f64::from(self.steps_per_row);
        for left in (0..steps).rev() {
            let t = now - f64::from(left) * step_secs;
            let conditions = self.step(t, step_secs);
            if left == 0 {
                self.record(t, &conditions, frame);
            }
        }
        self.row += 1;
    }

    fn step(&mut self, t: f64, step_secs: f64) -> Conditions {
        while self.schedule.ends() <= t {
            self.schedule.advance();
            let mode = self.schedule.mode();
            self.membrane.enter(mode, &mut self.rng);
            self.quality.enter(mode, &mut self.rng);
            self.cycles += u32::from(mode == Mode::BackPulse);
            if mode.stands_still() {
                self.exchange();
            }
        }
        let conditions = self.weather.step(t);
        let mode = self.schedule.mode();
        let began = self.schedule.began();
        let lasting = self.schedule.ends() - began;
        let level = self.hydraulics.level();
        let target = self.production_target(t, &conditions);
        self.demand = Demand::of(mode, t - began, lasting, level, target);
        self.hydraulics.step(&self.demand, &mut self.rng);
        let flow = self.hydraulics.net_flow();
        self.quality.step(
            mode,
            &conditions,
            self.hydraulics.feed_flow(),
            self.demand.permeate,
            &mut self.rng,
        );
        self.membrane.step(mode, flow, self.quality.turbidity(), conditions.organics);
        let celsius = self.quality.tank_temperature();
        let still = match mode {
            // Air holds the membrane under pressure and slowly leaks.
            Mode::IntegrityTest => 66.0 * (-(t - began) / 9000.0).exp(),
            _ => 0.0,
        };
        self.pressure.step(still + self.membrane.pressure(flow, celsius));
        self.pulsation.step(&mut self.rng);
        if self.demand.permeate > 0.0 {
            self.pump_hours = (self.pump_hours + step_secs / 3600.0) % 10_000.0;
        }
        conditions
    }

    /// Exchanges the parts that have become due since the plant last stopped.
    fn exchange(&mut self) {
        let now = self.schedule.began();
        if let Some(membranes) = self.membranes.due(now) {
            self.membrane.fit(membranes);
        }
        for pump in self.pumps.iter_mut().filter_map(|pump| pump.due(now)) {
            self.hydraulics.fit(pump);
            if pump.duty == PumpDuty::Permeate {
                self.pump_hours = 0.0;
            }
        }
    }

    /// Returns the target permeate flow in production, L/s: less at night.
    fn production_target(&self, t: f64, conditions: &Conditions) -> f64 {
        let usual = if (6.0..22.0).contains(&conditions.hour) { 0.3 } else { 0.25 };
        usual * self.settings.at(t).map_or(1.0, |settings| settings.value.production)
    }

    fn record(&mut self, t: f64, conditions: &Conditions, frame: &mut Frame) {
        let flow = self.hydraulics.net_flow();
        let pulsation = self.hydraulics.pulsation() * self.pulsation.value();
        let pressure = self.pressure.value + pulsation * flow.abs().sqrt();
        if self.demand.permeate > 0.0 && self.pressure.value > 3.0 {
            let celsius = self.quality.tank_temperature();
            self.permeability = 1000.0 * flow * viscosity(celsius) / self.pressure.value;
        }
        self.hydraulics.record(&self.demand, pressure, frame);
        self.quality.record(frame);
        frame[Signal::Pressure] = pressure;
        frame[Signal::Mode] = f64::from(self.schedule.mode().number());
        frame[Signal::ProductionSetpoint] = self.production_target(t, conditions);
        frame[Signal::AirTemperature] = conditions.air;
        frame[Signal::Permeability] = self.permeability;
        frame[Signal::StepTimer] = t - self.schedule.began();
        frame[Signal::SyncTimer] = 1000.0 * (t % SYNC_SECS);
        frame[Signal::PumpHours] = self.pump_hours;
        frame[Signal::Cycles] = f64::from(self.cycles % 10_000);
    }
}

/// A part of the plant that can be exchanged only while the plant is stopped.
#[derive(Clone, Debug)]
struct Exchanged<T> {
    timeline: Timeline<T>,
    fitted: Option<Dated<T>>,
}

impl<T: Copy + PartialEq> Exchanged<T> {
    fn new(timeline: &Timeline<T>) -> Self {
        Self { timeline: timeline.clone(), fitted: None }
    }

    /// Returns the part that is due at `t`, if it is not installed yet.
    fn due(&mut self, t: f64) -> Option<T> {
        let wanted = self.timeline.at(t);
        if wanted == self.fitted {
            return None;
        }
        self.fitted = wanted;
        wanted.map(|dated| dated.value)
    }
}

#[cfg(test)]
mod tests {
    use calib_core::{Period, Seed};

    use super::*;
    use crate::ChangeOptions;

    fn at(period_secs: f64) -> PlantOptions {
        let period = Period::from_secs(period_secs).expect("positive");
        PlantOptions { period, ..PlantOptions::default() }
    }

    fn rows(period_secs: f64, count: usize) -> impl Iterator<Item = Frame> {
        rows_of(&at(period_secs), count)
    }

    fn rows_of(options: &PlantOptions, count: usize) -> impl Iterator<Item = Frame> + use<> {
        let mut process = Process::new(options, &Changes::of(options));
        let mut frame = Frame::zero();
        (0..count).map(move |_| {
            process.next_row(&mut frame);
            frame.clone()
        })
    }

    #[test]
    fn every_signal_stays_within_its_range() {
        // A month at every step, then a year of hourly rows: summer, winter and many cleans.
        for frame in rows(5.0, 30 * 17_280).chain(rows(3600.0, 24 * 365)) {
            for info in crate::signal::SIGNALS {
                let (low, high) = info.range;
                let value = frame[info.signal];
                assert!(value >= low && value <= high, "{} is {value}", info.tag);
            }
        }
    }

    #[test]
    fn a_plant_that_changes_stays_a_plant() {
        let often = ChangeOptions {
            strength: 2.0,
            membranes_per_year: 12.0,
            feeds_per_year: 12.0,
            settings_per_year: 12.0,
            pumps_per_year: 12.0,
            ..ChangeOptions::default()
        };
        for seed in 0..3 {
            let seed = Seed::new(seed);
            let days = 365.0;
            let options = PlantOptions { seed, days, change: often, ..at(1200.0) };
            for frame in rows_of(&options, 72 * 365) {
                for info in crate::signal::SIGNALS {
                    // Where membranes are bad and the water cold, an instrument may reach the end
                    // of its range.
                    let beyond = 0.5 * (info.range.1 - info.range.0);
                    let low = info.range.0 - beyond;
                    let high = info.range.1 + beyond;
                    let value = frame[info.signal];
                    assert!(value >= low && value <= high, "{} is {value}", info.tag);
                }
            }
        }
    }

    #[test]
    fn the_modes_are_the_same_at_any_period() {
        let fine: Vec<Frame> = rows(1.0, 86_400).collect();
        for (minute, frame) in rows(60.0, 1440).enumerate() {
            assert_eq!(frame[Signal::Mode], fine[minute * 60][Signal::Mode]);
        }
    }

    #[test]
    fn averages_are_the_same_at_any_period() {
        let fine: Vec<Frame> = rows(1.0, 2 * 86_400).collect();
        let coarse: Vec<Frame> = rows(30.0, 2 * 2880).collect();
        for signal in [
            Signal::Pressure,
            Signal::PermeateFlow,
            Signal::MembraneTankLevel,
            Signal::PermeateTotal,
            Signal::Turbidity,
        ] {
            let [a, b] = [&fine, &coarse].map(|rows| {
                rows.iter().map(|frame| frame[signal]).sum::<f64>() / rows.len() as f64
            });
            assert!((a / b - 1.0).abs() < 0.05, "{signal:?} {a} {b}");
        }
    }
}
