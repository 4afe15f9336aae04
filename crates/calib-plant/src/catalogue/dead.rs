use crate::{
    channel::{Availability, Channel, ChannelInfo, Fate, Instrument, Recipe, name_number},
    signal::{Nature, SIGNALS, SignalInfo},
};

/// Set points and switches that never change. Names and values are from the pilot's tag list.
const UNTOUCHED: [(&str, &str, f32, &str); 8] = [
    ("FEED_SP.WASTING_SP", "L/s", 0.85, "wasting set point"),
    ("B801.INISCSP", "Hz", 60.0, "initial frequency of the blower"),
    ("DRAIN_SP.FMI3820_SP", "s", 30.0, "drain delay"),
    ("FIC101_P.AUTO", "", 1.0, "feed controller in automatic"),
    ("FV901.STATUS", "", 0.0, "bypass valve open"),
    ("PX760.DOSMAX", "%", 10.0, "largest dose of coagulant"),
    ("FLIT101.DATA", "mm", -5.0, "unused float switch"),
    ("PX730.EN_STATUS", "", 1.0, "hypochlorite dosing enabled"),
];

/// Constants that come with every signal: suffix, description, value as a share of the range.
const LIMITS: [(&str, &str, f64); 6] = [
    ("HH_SP", "high-high alarm", 0.95),
    ("H_SP", "high alarm", 0.9),
    ("L_SP", "low alarm", 0.1),
    ("LL_SP", "low-low alarm", 0.05),
    ("SPAN_HI", "upper end of the range", 1.0),
    ("SPAN_LO", "lower end of the range", 0.0),
];

/// Returns the first `count` channels that preprocessing should drop. Every five are three
/// constants, one retired instrument and one scheduled analyser.
pub(super) fn channels(count: usize) -> Vec<Channel> {
    let mut constants = constants();
    (0..count)
        .filter_map(|position| match position % 5 {
            1 => Some(retired(position / 5 + 1)),
            2 => Some(analyser(position / 5 + 1)),
            _ => constants.next(),
        })
        .collect()
}

fn constants() -> impl Iterator<Item = Channel> {
    let untouched = UNTOUCHED.iter().map(|&(name, unit, value, words)| {
        constant(name.to_owned(), unit, words.to_owned(), value)
    });
    let limits = SIGNALS.iter().flat_map(|info| {
        LIMITS.iter().map(move |&(suffix, words, share)| {
            let (low, high) = info.range;
            let value = (low + share * (high - low)) as f32;
            let words = format!("{}, {words}", info.description);
            constant(format!("{}.{suffix}", info.tag), info.unit, words, value)
        })
    });
    // A live zero of 4 mA with nothing connected.
    let spare = (1..).map(|number| {
        let words = "spare analog input".to_owned();
        constant(format!("AI_SPARE{number:03}.DATA"), "mA", words, 4.0)
    });
    untouched.chain(limits).chain(spare)
}

fn constant(name: String, unit: &str, description: String, value: f32) -> Channel {
    Channel {
        info: ChannelInfo { name, unit: unit.to_owned(), description, fate: Fate::Constant },
        recipe: Recipe::Constant(value),
        instrument: Instrument::Exact,
        availability: Availability::Always,
    }
}

fn retired(number: usize) -> Channel {
    Channel {
        info: ChannelInfo {
            name: format!("AIT{number:03}.DATA"),
            unit: "mA".to_owned(),
            description: "retired instrument".to_owned(),
            fate: Fate::Missing,
        },
        recipe: Recipe::Constant(0.0),
        instrument: Instrument::Exact,
        availability: Availability::Never,
    }
}

/// Returns an analyser that samples one of the plant's quantities for 5 to 70 % of each cycle.
/// Cycles are whole fractions of a day, so that the share holds for every day and for coarse
/// periods too.
fn analyser(number: usize) -> Channel {
    let analog: Vec<&SignalInfo> =
        SIGNALS.iter().filter(|info| matches!(info.nature, Nature::Analog(_))).collect();
    let info = analog[number % analog.len()];
    let name = format!("LAB{number:03}.RESULT");
    let draw = name_number(&name);
    let [phase, share] = [16, 32].map(|shift: u32| f64::from((draw >> shift) as u16) / 65_536.0);
    let cycle_secs = 86_400.0 / (1 + draw % 4) as f64;
    Channel {
        instrument: Instrument::new(&name, info.nature, info.range),
        info: ChannelInfo {
            name,
            unit: info.unit.to_owned(),
            description: format!("{}, analyser on a time table", info.description),
            fate: Fate::Missing,
        },
        recipe: Recipe::Lagged { signal: info.signal, lag_secs: 0.0 },
        availability: Availability::Scheduled {
            cycle_secs,
            phase_secs: cycle_secs * phase,
            share: 0.05 + 0.6 * share,
        },
    }
}
