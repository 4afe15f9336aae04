//! Changes of a plant from year to year: dated events, drawn from the seed.
//!
//! Without events, every year of the simulated plant is like the one before, except for weather and drift. A model
//! learned from one year then holds in the next. Real plants are rebuilt while they run. [`ChangeOptions`] set the size
//! and rate of changes; each [`Change`] is an event with its date.
//!
//! - **New membranes** have another resistance, foul at another rate, and are clean. Where they are bad and the water
//!   cold, the pressure can leave the range of its transmitter, which then shows the end of the range. They are fitted
//!   when the plant next stops, within hours.
//! - **Another feed** is blended in over days. Its mean temperature changes, the size and delay of its season, its
//!   turbidity in calm and in storms, its salt and pH. The organic matter in it changes too, which no channel measures:
//!   it fouls the membrane and takes more hypochlorite.
//! - **A sensor** is moved, exchanged or calibrated again: offset, gain, time constant and noise. All channels that are
//!   made from it (filtered, lagged, sums, differences, ratios) follow. The controller continues with the true values.
//! - **Settings**: the target of production, and the time from one back-pulse to the next.
//! - **A pump** is replaced, of permeate or of feed: another speed for the same flow, other pulsation, other response.
//!   It is exchanged when the plant next stops.
//!
//! An event sets the state from then on; it is not a step relative to the state before. The plant therefore stays a
//! membrane pilot however long it is simulated. The log before the first event is to the byte that of the plant without
//! change, and so is every channel that no event has affected.

mod draw;
mod feeds;
mod kind;
mod options;
mod sensors;
mod timeline;

pub(crate) use draw::Changes;
pub(crate) use feeds::Feeds;
pub use kind::{Change, ChangeKind, Feed, Membranes, Pump, PumpDuty, Sensor, Settings};
pub use options::ChangeOptions;
pub(crate) use sensors::Sensors;
pub(crate) use timeline::{Dated, Timeline};
