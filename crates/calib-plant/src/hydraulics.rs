use calib_core::Rng;

use crate::{
    Mode, Pump, PumpDuty,
    fluctuation::{Fluctuation, Follower},
    signal::{Frame, Signal},
};

/// Set points of the controller: flows in L/s, air in m³/h.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Demand {
    pub(crate) feed: f64,
    pub(crate) permeate: f64,
    pub(crate) back_pulse: f64,
    drain: f64,
    recycle: f64,
    air: f64,
}

/// Set point of the level in the membrane tank, mm.
const TANK_LEVEL: f64 = 2200.0;
/// Response times of the pumps to their set points, s.
const FEED_SECS: f64 = 6.0;
const PERMEATE_SECS: f64 = 8.0;
/// Share of mode 33 in which the tank drains; then it fills.
const DRAIN_SHARE: f64 = 0.45;

impl Demand {
    /// Returns the demand `elapsed` seconds into a `mode` that lasts `lasting` seconds, at
    /// level `level` of the membrane tank and with permeate target `target`.
    pub(crate) fn of(mode: Mode, elapsed: f64, lasting: f64, level: f64, target: f64) -> Self {
        let air = 12.0;
        match mode {
            Mode::Production => Self {
                feed: (target + 0.05 + 0.002 * (TANK_LEVEL - level)).clamp(0.0, 0.85),
                permeate: target,
                drain: 0.05,
                recycle: 0.45,
                air: if is_pulsing(elapsed, 60.0, 60.0) { air } else { 0.0 },
                ..Self::default()
            },
            Mode::BackPulse => Self { back_pulse: 1.1, drain: 1.05, air, ..Self::default() },
            Mode::DrainAndRefill if elapsed < DRAIN_SHARE * lasting => {
                Self { drain: 1.15, air, ..Self::default() }
            }
            Mode::DrainAndRefill => {
                Self { feed: if level < TANK_LEVEL { 1.9 } else { 0.0 }, ..Self::default() }
            }
            Mode::ChemicalClean => Self {
                back_pulse: if is_pulsing(elapsed, 60.0, 840.0) { 0.3 } else { 0.0 },
                drain: if is_pulsing(elapsed, 60.0, 840.0) { 0.3 } else { 0.0 },
                recycle: 0.6,
                ..Self::default()
            },
            Mode::Restart => Self { feed: 0.3, ..Self::default() },
            Mode::Standby | Mode::Stopped | Mode::IntegrityTest => Self::default(),
        }
    }
}

/// Flows that follow the demand, and the tanks between them.
#[derive(Clone, Debug)]
pub(crate) struct Hydraulics {
    step_secs: f64,
    feed: Follower,
    permeate: Follower,
    back_pulse: Follower,
    drain: Follower,
    recycle: Follower,
    air: Follower,
    supply: Follower,
    feed_swing: Fluctuation,
    supply_swing: Fluctuation,
    header_swing: Fluctuation,
    feed_tank: f64,
    membrane_tank: f64,
    permeate_tank: f64,
    supplying: f64,
    distributing: f64,
    volumes: [f64; 3],
    feed_pump: Pump,
    permeate_pump: Pump,
}

impl Hydraulics {
    pub(crate) fn new(step_secs: f64, rng: &mut Rng) -> Self {
        Self {
            step_secs,
            feed: Follower::new(0.0, FEED_SECS, step_secs),
            permeate: Follower::new(0.0, PERMEATE_SECS, step_secs),
            back_pulse: Follower::new(0.0, 4.0, step_secs),
            drain: Follower::new(0.0, 5.0, step_secs),
            recycle: Follower::new(0.0, 6.0, step_secs),
            air: Follower::new(0.0, 5.0, step_secs),
            supply: Follower::new(0.0, 5.0, step_secs),
            feed_swing: Fluctuation::new(0.02, 45.0, step_secs, rng),
            supply_swing: Fluctuation::new(2.0, 900.0, step_secs, rng),
            header_swing: Fluctuation::new(0.8, 300.0, step_secs, rng),
            feed_tank: 650.0,
            membrane_tank: TANK_LEVEL,
            permeate_tank: 1000.0,
            supplying: 0.0,
            distributing: 0.0,
            volumes: [0.0; 3],
            feed_pump: Pump::first(PumpDuty::Feed),
            permeate_pump: Pump::first(PumpDuty::Permeate),
        }
    }

    /// Exchanges a pump.
    pub(crate) fn fit(&mut self, pump: Pump) {
        let (flow, fitted, usual_secs) = match pump.duty {
            PumpDuty::Feed => (&mut self.feed, &mut self.feed_pump, FEED_SECS),
            PumpDuty::Permeate => (&mut self.permeate, &mut self.permeate_pump, PERMEATE_SECS),
        };
        *flow = flow.with_time_constant(usual_secs * pump.response, self.step_secs);
        *fitted = pump;
    }

    /// Returns the factor on the pulsation of the membrane pressure.
    pub(crate) fn pulsation(&self) -> f64 {
        self.permeate_pump.pulsation
    }

    /// Returns the level of the membrane tank, mm.
    pub(crate) fn level(&self) -> f64 {
        self.membrane_tank
    }

    /// Returns the permeate flow minus the back-pulse flow, L/s.
    pub(crate) fn net_flow(&self) -> f64 {
        self.permeate.value - self.back_pulse.value
    }

    /// Returns the feed flow, L/s.
    pub(crate) fn feed_flow(&self) -> f64 {
        self.feed.value
    }

    pub(crate) fn step(&mut self, demand: &Demand, rng: &mut Rng) {
        let h = self.step_secs;
        let swing = 1.0 + self.feed_pump.pulsation * self.feed_swing.step(rng);
        self.feed.step(demand.feed * swing);
        self.permeate.step(demand.permeate);
        self.back_pulse.step(demand.back_pulse);
        self.drain.step(demand.drain);
        self.recycle.step(demand.recycle);
        self.air.step(demand.air);
        self.supply_swing.step(rng);
        self.header_swing.step(rng);

        // The supply valve fills: it opens at the lower level and closes at the upper one.
        self.supplying = if self.feed_tank >= 740.0 {
            0.0
        } else if self.feed_tank <= 560.0 {
            1.0
        } else {
            self.supplying
        };
        self.supply.step(1.9 * self.supplying);
        self.feed_tank += h * 0.6 * (self.supply.value - self.feed.value);
        self.feed_tank = self.feed_tank.clamp(410.0, 890.0);

        let into_tank = self.feed.value + self.back_pulse.value;
        let out_of_tank = self.permeate.value + self.drain.value;
        self.membrane_tank += h * 6.5 * (into_tank - out_of_tank);
        self.membrane_tank = self.membrane_tank.clamp(30.0, 2400.0);

        // The distribution pump empties: it runs from the upper level down to the lower one.
        self.distributing = if self.permeate_tank >= 1300.0 {
            1.0
        } else if self.permeate_tank <= 700.0 {
            0.0
        } else {
            self.distributing
        };
        let withdrawn = self.back_pulse.value + 0.9 * self.distributing;
        self.permeate_tank += h * 3.0 * (self.permeate.value - withdrawn);
        self.permeate_tank = self.permeate_tank.clamp(180.0, 1520.0);

        let flows = [self.feed.value, self.permeate.value, self.drain.value];
        for (volume, flow) in self.volumes.iter_mut().zip(flows) {
            *volume = (*volume + h * flow / 1000.0) % 10_000.0;
        }
    }

    /// Writes flows, levels, valves, pumps and volumes into `frame`.
    pub(crate) fn record(&self, demand: &Demand, pressure: f64, frame: &mut Frame) {
        let feed = self.feed.value;
        let permeate = self.permeate.value;
        frame[Signal::FeedFlow] = feed;
        frame[Signal::PermeateFlow] = permeate;
        frame[Signal::BackPulseFlow] = self.back_pulse.value;
        frame[Signal::DrainFlow] = self.drain.value;
        frame[Signal::RecycleFlow] = self.recycle.value;
        frame[Signal::AirFlow] = self.air.value;
        frame[Signal::FeedTankLevel] = self.feed_tank;
        frame[Signal::MembraneTankLevel] = self.membrane_tank;
        frame[Signal::PermeateTankLevel] = self.permeate_tank;
        frame[Signal::FeedSetpoint] = demand.feed;
        frame[Signal::PermeateSetpoint] = demand.permeate;
        frame[Signal::FeedValve] = opening(demand.feed);
        frame[Signal::PermeateValve] = opening(demand.permeate);
        frame[Signal::BackPulseValve] = opening(demand.back_pulse);
        frame[Signal::DrainValve] = opening(demand.drain);
        frame[Signal::RecycleValve] = opening(demand.recycle);
        frame[Signal::AirValve] = opening(demand.air);
        frame[Signal::Blower] = 60.0 * opening(demand.air);
        frame[Signal::SupplyValve] = self.supplying;
        frame[Signal::DistributionPump] = self.distributing;
        frame[Signal::Mixer] = if demand.feed > 0.0 { 70.0 } else { 35.0 };
        let draws = permeate / 0.5 * (1.0 + pressure / 200.0) * self.permeate_pump.speed;
        let feeds = (feed / 2.3 + 0.1 * opening(demand.feed)) * self.feed_pump.speed;
        frame[Signal::PermeatePump] = 100.0 * draws.min(1.0);
        frame[Signal::FeedPump] = 100.0 * feeds.clamp(0.0, 1.0);
        frame[Signal::PumpPressure] = 2.0 + 22.0 * feed * feed;
        frame[Signal::FeedPressure] = 62.0 - 14.0 * self.supply.value + self.supply_swing.value();
        frame[Signal::AirPressure] = 45.0 - 0.9 * self.air.value + self.header_swing.value();
        frame[Signal::FeedTotal] = self.volumes[0];
        frame[Signal::PermeateTotal] = self.volumes[1];
        frame[Signal::WasteTotal] = self.volumes[2];
    }
}

/// Returns 1 for a valve or a pump with a positive demand, and 0 otherwise.
fn opening(wanted: f64) -> f64 {
    f64::from(u8::from(wanted > 0.0))
}

/// Returns whether something that is on and off in turns, for these seconds, is on.
fn is_pulsing(elapsed: f64, on: f64, off: f64) -> bool {
    elapsed % (on + off) < on
}

#[cfg(test)]
mod tests {
    use calib_core::Seed;

    use super::*;

    fn run(hydraulics: &mut Hydraulics, mode: Mode, secs: u32) -> (f64, f64) {
        let mut rng = Seed::new(1).rng();
        let mut low = f64::INFINITY;
        let mut high = f64::NEG_INFINITY;
        for elapsed in 0..secs {
            let elapsed = f64::from(elapsed);
            let lasting = f64::from(secs);
            let demand = Demand::of(mode, elapsed, lasting, hydraulics.level(), 0.3);
            hydraulics.step(&demand, &mut rng);
            low = low.min(hydraulics.level());
            high = high.max(hydraulics.level());
        }
        (low, high)
    }

    #[test]
    fn the_membrane_tank_is_drained_and_filled_again() {
        let mut hydraulics = Hydraulics::new(1.0, &mut Seed::new(2).rng());
        let (low, _) = run(&mut hydraulics, Mode::DrainAndRefill, 289);
        assert!(low < 1500.0, "{low}");
        assert!(hydraulics.level() > 2100.0, "{}", hydraulics.level());
    }

    #[test]
    fn production_holds_its_level_and_its_flow() {
        let mut hydraulics = Hydraulics::new(1.0, &mut Seed::new(2).rng());
        let (low, high) = run(&mut hydraulics, Mode::Production, 3600);
        assert!(low > 2050.0 && high < 2300.0, "{low} {high}");
        assert!((hydraulics.net_flow() - 0.3).abs() < 1e-6);
        run(&mut hydraulics, Mode::BackPulse, 101);
        assert!((hydraulics.net_flow() + 1.1).abs() < 0.01);
    }

    #[test]
    fn the_feed_tank_cycles_between_its_switches() {
        let mut hydraulics = Hydraulics::new(1.0, &mut Seed::new(2).rng());
        let mut rng = Seed::new(1).rng();
        let demand = Demand::of(Mode::Production, 0.0, 1.0, 2200.0, 0.3);
        let mut changes = 0;
        for _ in 0..20_000 {
            let before = hydraulics.supplying;
            hydraulics.step(&demand, &mut rng);
            changes += u32::from(before != hydraulics.supplying);
            assert!((540.0..760.0).contains(&hydraulics.feed_tank));
        }
        assert!(changes > 10, "{changes}");
    }
}
