use std::ops::{Index, IndexMut};

/// The kind of values of a signal, which decides the possible instrument errors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Nature {
    /// Continuous, with white noise of this share of the range.
    Analog(f64),
    /// A switch, 0 or 1.
    Binary,
    /// A number written by the controller, without error.
    Exact,
    /// A number that only grows, or a clock.
    Counter,
}

/// Metadata of a signal.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SignalInfo {
    pub(crate) signal: Signal,
    pub(crate) tag: &'static str,
    pub(crate) unit: &'static str,
    pub(crate) description: &'static str,
    pub(crate) range: (f64, f64),
    pub(crate) nature: Nature,
}

impl SignalInfo {
    /// Whether an instrument in the plant measures it. Signals that the controller puts out have tags with a
    /// suffix after a point.
    pub(crate) fn is_sensor(&self) -> bool {
        matches!(self.nature, Analog(_)) && !self.tag.contains('.')
    }
}

macro_rules! signals {
    ($($name:ident $tag:literal $unit:literal $low:literal $high:literal $nature:expr, $description:literal;)*) => {
        /// The quantities that the process computes at every instant, the most informative first.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub(crate) enum Signal {
            $(#[doc = $description] $name,)*
        }

        /// All signals in the order of the enumeration.
        pub(crate) const SIGNALS: &[SignalInfo] = &[
            $(SignalInfo {
                signal: Signal::$name,
                tag: $tag,
                unit: $unit,
                description: $description,
                range: ($low, $high),
                nature: $nature,
            },)*
        ];
    };
}

use Nature::{Analog, Binary, Counter, Exact};

// Tags and most ranges follow the published tag list of the pilot (see the crate's documentation).
#[rustfmt::skip]
signals! {
    Pressure "PIT300" "kPa" -75.0 80.0 Analog(0.0012), "membrane pressure, positive when permeate is drawn";
    Temperature "TIT101" "°C" 0.0 30.0 Analog(0.0004), "influent temperature";
    Turbidity "TUIT101" "NTU" 0.0 5.0 Analog(0.0006), "influent turbidity";
    Mode "MODE" "" 0.0 100.0 Exact, "operating mode";
    FeedFlow "FIT101" "L/s" 0.0 2.2 Analog(0.003), "feed flow";
    PermeateFlow "FIT301" "L/s" 0.0 1.2 Analog(0.002), "permeate flow";
    PumpPressure "PIT201" "kPa" -3.0 100.0 Analog(0.002), "pressure after the feed pump";
    MembraneTankLevel "LIT301" "mm" 0.0 2500.0 Analog(0.001), "level of the membrane tank";
    PermeateTankLevel "LIT602" "mm" 0.0 1600.0 Analog(0.001), "level of the permeate tank";
    PermeatePump "P301.SCOUTPUT" "%" 0.0 100.0 Analog(0.001), "speed of the permeate pump";
    PermeateValve "FV301.STATUS" "" 0.0 1.0 Binary, "permeate valve open";
    BackPulseFlow "FIT601" "L/s" 0.0 1.5 Analog(0.003), "back-pulse flow";
    Conductivity "CIT101" "µS/cm" 0.0 500.0 Analog(0.001), "influent conductivity";
    Acidity "PHIT101" "pH" 0.0 14.0 Analog(0.0008), "influent pH";
    FeedTankLevel "LIT101" "mm" 400.0 900.0 Analog(0.002), "level of the feed tank";
    PermeateTurbidity "TUIT310" "NTU" 0.0 1.0 Analog(0.001), "permeate turbidity";
    AirPressure "PIT801" "kPa" 0.0 100.0 Analog(0.001), "pressure of the air header";
    Blower "B801.SCOUTPUT" "Hz" 0.0 60.0 Analog(0.0), "frequency of the air blower";
    TankTemperature "TIT302" "°C" 0.0 30.0 Analog(0.0004), "temperature in the membrane tank";
    SupplyValve "FV101.STATUS" "" 0.0 1.0 Binary, "supply valve of the feed tank open";
    DrainFlow "FIT201" "L/s" 0.0 1.5 Analog(0.003), "drain and waste flow";
    RecycleFlow "FIT701" "L/s" 0.0 1.2 Analog(0.003), "recycle flow";
    AirFlow "FIT801" "m³/h" 0.0 16.0 Analog(0.003), "scouring air flow";
    PermeateTemperature "TIT601" "°C" 0.0 30.0 Analog(0.0004), "permeate temperature";
    FeedPump "P201.SCOUTPUT" "%" 0.0 100.0 Analog(0.001), "speed of the feed pump";
    FeedPressure "PIT101" "kPa" 0.0 100.0 Analog(0.002), "supply pressure";
    BackPulseValve "FV303.STATUS" "" 0.0 1.0 Binary, "back-pulse valve open";
    DrainValve "FV603.STATUS" "" 0.0 1.0 Binary, "drain valve open";
    AirValve "FV801A.STATUS" "" 0.0 1.0 Binary, "air valve open";
    RecycleValve "FV202.STATUS" "" 0.0 1.0 Binary, "recycle valve open";
    FeedValve "FV201.STATUS" "" 0.0 1.0 Binary, "feed valve open";
    DistributionPump "P601.RUN" "" 0.0 1.0 Binary, "distribution pump running";
    Mixer "MX101.SCOUTPUT" "%" 0.0 100.0 Analog(0.0), "speed of the feed tank's mixer";
    FeedSetpoint "FIC201_P.SPProg" "L/s" 0.0 2.0 Exact, "set point of the feed flow";
    PermeateSetpoint "FIC301_P.SPProg" "L/s" 0.0 1.0 Exact, "set point of the permeate flow";
    ProductionSetpoint "PERM_SP.PROD_SP" "L/s" 0.0 1.0 Exact, "production target, lower at night";
    DosePump "PX730.SCOUTPUT" "%" 0.0 10.0 Analog(0.001), "hypochlorite dose pump";
    HypochloriteLevel "LITX730" "%" 0.0 60.0 Analog(0.001), "level of the hypochlorite tank";
    AirTemperature "TIT901" "°C" -10.0 40.0 Analog(0.0004), "air temperature in the hall";
    Permeability "KPERM.CALC" "L/(s·MPa)" 0.0 100.0 Analog(0.001), "temperature-corrected permeability";
    StepTimer "CTRL.STEP_TMR" "s" 0.0 100_000.0 Counter, "time in the operating mode";
    SyncTimer "PLC.SYNC_TMR.ACC" "ms" 0.0 120_000.0 Counter, "clock synchronisation timer";
    FeedTotal "FQT101" "m³" 0.0 10000.0 Counter, "feed volume, rolls over at 10,000";
    PermeateTotal "FQT301" "m³" 0.0 10000.0 Counter, "permeate volume, rolls over at 10,000";
    WasteTotal "FQT201" "m³" 0.0 10000.0 Counter, "waste volume, rolls over at 10,000";
    PumpHours "P301.HOURS" "h" 0.0 10000.0 Counter, "running hours of the permeate pump, roll over at 10,000";
    Cycles "CTRL.CYCLES" "" 0.0 10000.0 Counter, "number of back-pulses, rolls over at 10,000";
}

impl Signal {
    pub(crate) const COUNT: usize = SIGNALS.len();
}

/// All signals at one instant.
#[derive(Clone, Debug)]
pub(crate) struct Frame([f64; Signal::COUNT]);

impl Frame {
    pub(crate) fn zero() -> Self {
        Self([0.0; Signal::COUNT])
    }
}

impl Index<Signal> for Frame {
    type Output = f64;

    fn index(&self, signal: Signal) -> &f64 {
        &self.0[signal as usize]
    }
}

impl IndexMut<Signal> for Frame {
    fn index_mut(&mut self, signal: Signal) -> &mut f64 {
        &mut self.0[signal as usize]
    }
}

/// The signals of one day, and of the hour before it for filters and lags.
#[derive(Clone, Debug)]
pub(crate) struct Signals {
    before: usize,
    values: Vec<Vec<f32>>,
}

impl Signals {
    /// Returns an empty buffer with room for `before` rows of history.
    pub(crate) fn new(before: usize) -> Self {
        Self { before, values: vec![Vec::new(); Signal::COUNT] }
    }

    /// Clears all but the history; rows of a new day follow.
    pub(crate) fn begin_day(&mut self) {
        for values in &mut self.values {
            let drop = values.len().saturating_sub(self.before);
            values.drain(..drop);
        }
    }

    /// Appends the signals of the next row. The first row ever also stands for the history before it.
    pub(crate) fn push(&mut self, frame: &Frame) {
        for (values, &value) in self.values.iter_mut().zip(&frame.0) {
            if values.is_empty() {
                values.resize(self.before, value as f32);
            }
            values.push(value as f32);
        }
    }

    /// Returns the rows of the day.
    pub(crate) fn day(&self, signal: Signal) -> &[f32] {
        &self.values[signal as usize][self.before..]
    }

    /// Returns the rows of the day as they were `lag` rows earlier; `lag` is at most the history.
    pub(crate) fn lagged(&self, signal: Signal, lag: usize) -> &[f32] {
        let values = &self.values[signal as usize];
        &values[self.before - lag..values.len() - lag]
    }

    /// Returns history and day.
    pub(crate) fn with_history(&self, signal: Signal) -> &[f32] {
        &self.values[signal as usize]
    }

    /// Returns the number of rows of history.
    pub(crate) fn history(&self) -> usize {
        self.before
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_range_is_empty() {
        assert!(SIGNALS.iter().all(|info| info.range.0 < info.range.1));
    }

    fn push_pressure(signals: &mut Signals, value: f64) {
        let mut frame = Frame::zero();
        frame[Signal::Pressure] = value;
        signals.push(&frame);
    }

    #[test]
    fn history_reaches_into_the_day_before() {
        let mut signals = Signals::new(2);
        signals.begin_day();
        for value in [1.0, 2.0, 3.0] {
            push_pressure(&mut signals, value);
        }
        assert_eq!(signals.lagged(Signal::Pressure, 2), [1.0, 1.0, 1.0]);
        signals.begin_day();
        for value in [4.0, 5.0] {
            push_pressure(&mut signals, value);
        }
        assert_eq!(signals.day(Signal::Pressure), [4.0, 5.0]);
        assert_eq!(signals.lagged(Signal::Pressure, 1), [3.0, 4.0]);
        assert_eq!(signals.with_history(Signal::Pressure), [2.0, 3.0, 4.0, 5.0]);
    }
}
