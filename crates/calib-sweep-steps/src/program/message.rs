//! The messages of the protocol: one line of JSON each, followed by states as binary numbers.

use std::{collections::BTreeMap, ops::Range};

use calib_core::Stream;
use serde::{Deserialize, Serialize, de::DeserializeOwned};
use serde_json::Value;

/// The version of the protocol, which a program repeats.
pub const PROTOCOL_VERSION: u32 = 1;

/// The message that begins a run: the return to predict, and the agent.
#[derive(Serialize)]
pub(super) struct Begin<'a> {
    pub(super) sensor: &'a str,
    pub(super) column: usize,
    pub(super) columns: usize,
    pub(super) gamma: f64,
    pub(super) seed: u64,
    pub(super) steps: usize,
    pub(super) parameters: &'a BTreeMap<String, Value>,
}

/// A type of answer.
pub trait Answer: DeserializeOwned {
    /// Its form, for messages.
    const LIKE: &'static str;

    /// Whether it is valid in this version.
    fn is_valid(&self) -> bool;
}

/// The answer that the program has made the agent.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ready {
    ready: u32,
}

impl Answer for Ready {
    const LIKE: &'static str = "{\"ready\": 1}";

    fn is_valid(&self) -> bool {
        self.ready == PROTOCOL_VERSION
    }
}

/// One prediction per state. Null stands for one that is not finite.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Predictions {
    pub(super) predictions: Vec<Option<f64>>,
    #[serde(default)]
    pub(super) updates: u64,
}

impl Answer for Predictions {
    const LIKE: &'static str =
        "{\"predictions\": [0.5, 0.25], \"updates\": 2} (null is a prediction that is not finite)";

    fn is_valid(&self) -> bool {
        true
    }
}

impl Predictions {
    /// Returns the predictions before the first one that is not finite in single precision.
    pub(super) fn finite(&self) -> Vec<f32> {
        self.predictions
            .iter()
            .map_while(|value| value.filter(|value| value.abs() <= f64::from(f32::MAX)))
            .map(|value| value as f32)
            .collect()
    }
}

/// The answer that the program cannot continue.
#[derive(Deserialize)]
pub(super) struct Failure {
    pub(super) error: String,
}

pub(super) fn begin(told: &Begin<'_>) -> Vec<u8> {
    line(&serde_json::json!({ "calib": PROTOCOL_VERSION, "begin": told }))
}

/// Returns the message with the states of `part`, which lies in the unbroken `piece`: a line, then each state as
/// numbers in single precision, in little-endian byte order.
pub(super) fn states(stream: &dyn Stream, part: &Range<usize>, piece: &Range<usize>) -> Vec<u8> {
    let begins = part.start == piece.start;
    let ends = part.end == piece.end;
    let mut message =
        line(&serde_json::json!({ "states": part.len(), "begins": begins, "ends": ends }));
    message.reserve(4 * part.len() * stream.width());
    let values = part.clone().flat_map(|t| stream.state(t));
    message.extend(values.flat_map(|value| value.to_le_bytes()));
    message
}

/// Returns a message of one line.
pub fn line(message: &impl Serialize) -> Vec<u8> {
    let mut text = serde_json::to_vec(message)
        .unwrap_or_else(|error| unreachable!("a message has text keys only: {error}"));
    text.push(b'\n');
    text
}
