use crate::{
    channel::{Availability, Channel, ChannelInfo, Fate, Instrument, Recipe},
    signal::{
        Nature, SIGNALS,
        Signal::{
            self, Acidity, AirPressure, AirTemperature, BackPulseFlow, Conductivity, DrainFlow,
            FeedFlow, FeedPressure, FeedSetpoint, FeedTankLevel, MembraneTankLevel, PermeateFlow,
            PermeateSetpoint, PermeateTankLevel, PermeateTemperature, PermeateTurbidity, Pressure,
            PumpPressure, RecycleFlow, TankTemperature, Temperature, Turbidity,
        },
        SignalInfo,
    },
};

/// A channel computed by the controller from two signals.
struct Derived {
    name: &'static str,
    unit: &'static str,
    description: &'static str,
    range: (f64, f64),
    recipe: Recipe,
}

#[rustfmt::skip]
const DERIVED: [Derived; 16] = [
    derived("PDI300", "kPa", "membrane pressure less pressure after the feed pump", (-160.0, 90.0), Recipe::Difference(Pressure, PumpPressure)),
    derived("RECOVERY.CALC", "", "permeate flow per feed flow", (0.0, 25.0), Recipe::Ratio(PermeateFlow, FeedFlow, 0.05)),
    derived("FDI301", "L/s", "feed flow less permeate flow", (-1.2, 2.0), Recipe::Difference(FeedFlow, PermeateFlow)),
    derived("TDI302", "°C", "membrane tank less influent temperature", (-15.0, 15.0), Recipe::Difference(TankTemperature, Temperature)),
    derived("FSI701", "L/s", "feed and recycle flow together", (0.0, 3.0), Recipe::Sum(FeedFlow, RecycleFlow)),
    derived("PDI101", "kPa", "supply pressure less pressure after the feed pump", (-100.0, 100.0), Recipe::Difference(FeedPressure, PumpPressure)),
    derived("TDI601", "°C", "permeate less membrane tank temperature", (-15.0, 15.0), Recipe::Difference(PermeateTemperature, TankTemperature)),
    derived("FSI201", "L/s", "drain and back-pulse flow together", (0.0, 3.0), Recipe::Sum(DrainFlow, BackPulseFlow)),
    derived("REJECTION.CALC", "", "permeate turbidity per influent turbidity", (0.0, 20.0), Recipe::Ratio(PermeateTurbidity, Turbidity, 0.02)),
    derived("LDI301", "mm", "membrane tank less feed tank level", (-1000.0, 2500.0), Recipe::Difference(MembraneTankLevel, FeedTankLevel)),
    derived("PDI801", "kPa", "air header less membrane pressure", (-100.0, 200.0), Recipe::Difference(AirPressure, Pressure)),
    derived("FIC201_P.ERR", "L/s", "error of the feed flow's controller", (-2.0, 2.0), Recipe::Difference(FeedSetpoint, FeedFlow)),
    derived("FIC301_P.ERR", "L/s", "error of the permeate flow's controller", (-1.0, 1.0), Recipe::Difference(PermeateSetpoint, PermeateFlow)),
    derived("TDI901", "°C", "hall less permeate temperature", (-40.0, 40.0), Recipe::Difference(AirTemperature, PermeateTemperature)),
    derived("CPI101", "", "conductivity per pH", (0.0, 80.0), Recipe::Ratio(Conductivity, Acidity, 1.0)),
    derived("LSI602", "mm", "membrane and permeate tank level together", (0.0, 4000.0), Recipe::Sum(MembraneTankLevel, PermeateTankLevel)),
];

const fn derived(
    name: &'static str,
    unit: &'static str,
    description: &'static str,
    range: (f64, f64),
    recipe: Recipe,
) -> Derived {
    Derived { name, unit, description, range, recipe }
}

/// Number of signals before the first derived channel.
const SIGNALS_FIRST: usize = 17;

/// Returns the first `count` living channels. Signals come first, then two signals to one
/// derived channel, then limit switches of the valves. Filtered and lagged copies follow
/// without end.
pub(super) fn channels(count: usize) -> Vec<Channel> {
    let (first, later) = SIGNALS.split_at(SIGNALS_FIRST);
    let mut computed = DERIVED.iter().map(computed);
    let mut channels: Vec<Channel> = first.iter().map(direct).collect();
    for pair in later.chunks(2) {
        channels.extend(computed.next());
        channels.extend(pair.iter().map(direct));
    }
    channels.extend(computed);
    let binary = SIGNALS.iter().filter(|info| info.nature == Nature::Binary);
    channels.extend(binary.map(limit_switch));
    let analog: Vec<&SignalInfo> =
        SIGNALS.iter().filter(|info| matches!(info.nature, Nature::Analog(_))).collect();
    for round in 0.. {
        if channels.len() >= count {
            break;
        }
        channels.extend(analog.iter().map(|info| copy(info, round)));
    }
    channels.truncate(count);
    channels
}

/// Returns a living channel that shows `recipe` through an instrument of this nature and range.
fn living(
    name: String,
    unit: &str,
    description: String,
    recipe: Recipe,
    nature: Nature,
    range: (f64, f64),
) -> Channel {
    Channel {
        instrument: Instrument::new(&name, nature, range),
        info: ChannelInfo { name, unit: unit.to_owned(), description, fate: Fate::Alive },
        recipe,
        availability: Availability::Always,
    }
}

/// Returns a channel with the unit and the instrument of a signal.
fn of_signal(info: &SignalInfo, name: String, description: String, recipe: Recipe) -> Channel {
    living(name, info.unit, description, recipe, info.nature, info.range)
}

fn lagged(signal: Signal, lag_secs: f64) -> Recipe {
    Recipe::Lagged { signal, lag_secs }
}

fn direct(info: &SignalInfo) -> Channel {
    of_signal(info, info.tag.to_owned(), info.description.to_owned(), lagged(info.signal, 0.0))
}

fn computed(derived: &Derived) -> Channel {
    let &Derived { name, unit, description, range, recipe } = derived;
    living(name.to_owned(), unit, description.to_owned(), recipe, Nature::Analog(0.0005), range)
}

/// Returns the switch at the end of a valve's travel, which answers three seconds later.
fn limit_switch(info: &SignalInfo) -> Channel {
    let valve = info.tag.split('.').next().unwrap_or(info.tag);
    let description = format!("{}, limit switch", info.description);
    of_signal(info, format!("{valve}.ZSO"), description, lagged(info.signal, 3.0))
}

/// Returns the copy of a signal in round `round`: filtered in even rounds, lagged in odd ones.
fn copy(info: &SignalInfo, round: u32) -> Channel {
    let step = round / 2 + 1;
    let (suffix, words, recipe) = if round.is_multiple_of(2) {
        let secs = 30 * step;
        let filtered = Recipe::Filtered { signal: info.signal, tau_secs: f64::from(secs) };
        (format!("AVG{secs}"), format!("filtered over {secs} s"), filtered)
    } else {
        let secs = 20 * step;
        let recipe = lagged(info.signal, f64::from(secs));
        (format!("LAG{secs}"), format!("{secs} s earlier"), recipe)
    };
    let description = format!("{}, {words}", info.description);
    of_signal(info, format!("{}.{suffix}", info.tag), description, recipe)
}
