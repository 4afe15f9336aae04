//! `agent.baseline` in a study: the name of a simple predictor, or `none`.

use schemars::JsonSchema;
use serde::{
    Deserialize as _, Deserializer, Serializer,
    de::{Error as _, IntoDeserializer as _, value},
};

use crate::SimplePredictor;

const NONE: &str = "none";

/// The allowed values.
#[derive(JsonSchema)]
#[serde(rename_all = "snake_case")]
#[expect(dead_code, reason = "only its schema is used")]
pub(super) enum Names {
    /// Random initial weights.
    None,
    #[serde(untagged)]
    Simple(SimplePredictor),
}

pub(super) fn name(baseline: Option<SimplePredictor>) -> &'static str {
    baseline.map_or(NONE, SimplePredictor::name)
}

#[expect(
    clippy::ref_option,
    clippy::trivially_copy_pass_by_ref,
    reason = "serde prescribes the signature"
)]
pub(super) fn serialize<S: Serializer>(
    baseline: &Option<SimplePredictor>,
    serializer: S,
) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(name(*baseline))
}

pub(super) fn deserialize<'de, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<Option<SimplePredictor>, D::Error> {
    let text = String::deserialize(deserializer)?;
    if text == NONE {
        return Ok(None);
    }
    let parsed: Result<_, value::Error> =
        SimplePredictor::deserialize(text.as_str().into_deserializer());
    parsed.map(Some).map_err(|_| {
        let names: Vec<&str> = SimplePredictor::ALL
            .into_iter()
            .chain([SimplePredictor::Best, SimplePredictor::Mixture])
            .map(SimplePredictor::name)
            .collect();
        D::Error::custom(format!(
            "unknown baseline {text:?}: expected \"{NONE}\" or one of {}",
            names.join(", ")
        ))
    })
}
