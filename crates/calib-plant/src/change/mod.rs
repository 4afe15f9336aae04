//! What changes in a plant from year to year: dated events, drawn from the seed.
//!
//! Without events every year of the simulated plant is like the one before, but for weather and drift, so that
//! whatever was learnt from a year holds in the next one. Real plants are rebuilt while they run. [`ChangeOptions`]
//! say how much and how often, [`Change`]s what happened and when.
//!
//! - **New membranes** have another resistance, foul at another rate, and are clean. Where they are bad and the water cold,
//!   the pressure can leave the range of its transmitter, which shows the end of it then. They are fitted when the plant
//!   next stands still, within hours.
//! - **Another feed** is blended in over days: its mean temperature and the size and delay of its season, its
//!   turbidity in calm and in storms, its salt and pH, and the organic matter in it, which no channel measures: it
//!   fouls the membrane and takes more hypochlorite.
//! - **A sensor** is moved, exchanged or calibrated again: offset, gain, time constant and noise. All channels that are
//!   made from it (filtered, lagged, sums, differences, ratios) follow. The controller goes on with the true values.
//! - **Settings**: the target of production, and the time from one back-pulse to the next.
//! - **A pump** is replaced, of permeate or of feed: another speed for the same flow, other pulsation, other response.
//!   It is exchanged when the plant next stands still.
//!
//! An event stands for the state from then on and not for a step away from the one before, so that the plant stays a
//! membrane pilot however long it is simulated. The log before the first event is to the byte that of the
//! plant without change, and so is every channel that no event has touched.

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
