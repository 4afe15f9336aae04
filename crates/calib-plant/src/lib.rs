//! A simulated membrane-filtration pilot with known ground truth: a stand-in for plant data, for demonstrations, tests
//! and benchmarks. It is a pure library: options in, days of a log out.
//!
//! [`PlantOptions`] describe the plant, [`Plant`] yields one [`DayLog`] after the other, and [`Plant::schema`] gives
//! for every channel the expected decision of preprocessing ([`Fate`]).
//!
//! # What is simulated
//!
//! - **Operating modes** follow a semi-Markov process with the transition frequencies and duration quantiles of a real
//!   plant: 20 minutes of production ([`Mode::Production`]), a back-pulse of 101 s, draining and refilling for 289 s,
//!   standby, an integrity test about once a day; and a chemical clean about every three weeks.
//! - **PIT300**, the membrane pressure, follows Darcy's law with the viscosity of water. It rises as a cake builds up
//!   in production, is negative during a back-pulse, is lower after it, and rises over weeks as pores clog, until the
//!   clean. (The sign is our choice: the real plant logs suction.)
//! - **TIT101**, the influent temperature, has a yearly and a daily cycle, weather of a few days, and standing water
//!   that warms up in standby.
//! - **TUIT101**, the influent turbidity, is near zero except for bursts that arrive at random, rise within minutes and
//!   decay over an hour.
//! - Around them: flows, levels with hysteresis, pumps, valves, set points, doses, clocks, totalisers; sums,
//!   differences, ratios, filtered and lagged copies of these; constants, retired instruments, scheduled analysers. Of
//!   480 channels 142 are alive, as in the paper.
//! - **Instruments and historian**: noise, drift, quantisation, dead-band, frozen periods, outages of input cards
//!   (missing values), outages of the historian (absent rows), rows written twice.
//! - **Change from year to year**, if requested ([`ChangeOptions`]): new membranes, other feeds, moved sensors, changed
//!   settings, new pumps. [`Plant::changes`] lists them with their dates.
//!
//! # Operation by a policy
//!
//! [`OperatedPlant`] is the membrane of such a plant without a fixed recipe: a policy chooses one of [`RECIPES`] every
//! half hour. An [`Account`] holds the yield and cost of each half hour.
//!
//! # Sources
//!
//! Tags, most ranges and the statistics of the schedule come from `normalization_ranges.json` and `november_modes.json`
//! of <https://github.com/haseebs/gvf-real-world> (MIT licence), the code of Janjua et al., "GVFs in the real world:
//! making predictions online for water treatment", Machine Learning 2023, doi:10.1007/s10994-023-06413-x. No sensor
//! series are published there: all series here follow from the equations in the source, whose constants are our choice.
//!
//! ```
//! use calib_plant::{Plant, PlantOptions};
//!
//! let minute = calib_core::Period::from_secs(60.0).expect("positive");
//! let options = PlantOptions { days: 2.0, channels: 12, period: minute, ..PlantOptions::default() };
//! let plant = Plant::new(options)?;
//! let days: Vec<_> = plant.collect();
//! assert_eq!(days.len(), 2);
//! # Ok::<(), calib_plant::OptionsError>(())
//! ```

mod catalogue;
mod change;
mod channel;
mod faults;
mod fluctuation;
mod hydraulics;
mod membrane;
mod mode;
mod operated;
mod options;
mod options_error;
mod plant;
mod process;
mod quality;
mod recipe;
mod schedule;
mod signal;
mod statistics;
mod synthesis;
mod weather;

pub use change::{
    Change, ChangeKind, ChangeOptions, Feed, Membranes, Pump, PumpDuty, Sensor, Settings,
};
pub use channel::{ChannelInfo, Fate};
pub use mode::Mode;
pub use operated::{Account, DECISION_SECS, OperatedPlant, Reading, TRIP_KPA};
pub use options::PlantOptions;
pub use options_error::OptionsError;
pub use plant::{DayLog, Plant};
pub use recipe::{RECIPES, Recipe, operators_rule};

/// The three sensors that the paper predicts: membrane pressure, influent temperature, influent
/// turbidity. They are the first three channels of every plant.
pub const ROLES: [&str; 3] = ["PIT300", "TIT101", "TUIT101"];

/// The channel with the number of the operating mode ([`Mode::number`]), the fourth.
pub const MODE_CHANNEL: &str = "MODE";
