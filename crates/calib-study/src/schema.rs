//! JSON Schema of a study for editors: every key with type, default and meaning, derived from the structs that read it.

use calib_plant::ChangeOptions;
use schemars::{JsonSchema as _, Schema, SchemaGenerator, generate::SchemaSettings, json_schema};
use serde_json::{Map, Value, json};

use crate::{SimulateConfig, Study, models, profiles};

/// Returns the JSON Schema of a study file.
pub fn schema() -> Value {
    let mut settings = SchemaSettings::draft07();
    settings.inline_subschemas = false;
    let mut schema = settings.into_generator().into_root_schema_for::<Study>().to_value();
    with_rates(&mut schema);
    without_null(&mut schema);
    let parts =
        [("Profile", profile(&schema["properties"])), ("Model", model(&schema["properties"]))];
    if let Some(definitions) = schema["definitions"].as_object_mut() {
        definitions.extend(parts.map(|(name, part)| (name.to_owned(), part)));
    }
    schema["title"] = json!("A study of calib");
    schema
}

/// Returns the schema of `[profiles.NAME]`.
pub(crate) fn profiles(_: &mut SchemaGenerator) -> Schema {
    json_schema!({ "type": "object", "additionalProperties": { "$ref": "#/definitions/Profile" } })
}

/// Returns the schema of `[models.NAME]`.
pub(crate) fn models(_: &mut SchemaGenerator) -> Schema {
    json_schema!({ "type": "object", "additionalProperties": { "$ref": "#/definitions/Model" } })
}

/// Returns the schema of a profile: every key of the study except `profiles`, and `base`.
fn profile(keys: &Value) -> Value {
    let mut keys = keys.as_object().cloned().unwrap_or_default();
    keys.remove(profiles::KEY);
    let base =
        json!({ "description": "The profile that this one is laid over.", "type": "string" });
    keys.insert(profiles::BASE.to_owned(), base);
    section("The study at another size: what it says is laid over the rest of the file.", keys)
}

/// Returns the schema of a model: the sections in which models may differ.
fn model(keys: &Value) -> Value {
    let keys = models::SECTIONS.map(|key| (key.to_owned(), keys[key].clone()));
    section("How a model differs from the rest of the study.", keys.into_iter().collect())
}

/// Returns the schema of a section whose keys are all optional and have no defaults of their own.
fn section(description: &str, mut keys: Map<String, Value>) -> Value {
    for key in keys.values_mut().filter_map(Value::as_object_mut) {
        key.remove("default");
    }
    json!({ "description": description, "type": "object", "properties": keys, "additionalProperties": false })
}

/// Adds the default rates at which a plant changes, taken from the simulator.
fn with_rates(schema: &mut Value) {
    let ChangeOptions {
        strength,
        membranes_per_year,
        feeds_per_year,
        sensors_per_year,
        settings_per_year,
        pumps_per_year,
    } = ChangeOptions::default();
    let rates = [
        ("change", strength),
        ("membranes_per_year", membranes_per_year),
        ("feeds_per_year", feeds_per_year),
        ("sensors_per_year", sensors_per_year),
        ("settings_per_year", settings_per_year),
        ("pumps_per_year", pumps_per_year),
    ];
    let name = SimulateConfig::schema_name();
    let keys = &mut schema["definitions"][name.as_ref()]["properties"];
    for (key, default) in rates {
        keys[key]["default"] = json!(default);
    }
}

/// Removes null from the schema. TOML has no null: an optional key is left out instead.
fn without_null(value: &mut Value) {
    match value {
        Value::Array(values) => values.iter_mut().for_each(without_null),
        Value::Object(keys) => {
            if keys.get("default").is_some_and(Value::is_null) {
                keys.remove("default");
            }
            if let Some(Value::Array(types)) = keys.get_mut("type") {
                types.retain(|kind| kind != "null");
                if let [only] = types.as_slice() {
                    let only = only.clone();
                    keys.insert("type".to_owned(), only);
                }
            }
            if let Some(Value::Array(any)) = keys.get_mut("anyOf") {
                any.retain(|schema| schema.get("type").is_none_or(|kind| kind != "null"));
                if let [only] = any.as_slice() {
                    let only = only.clone();
                    keys.remove("anyOf");
                    keys.insert("allOf".to_owned(), json!([only]));
                }
            }
            keys.values_mut().for_each(without_null);
        }
        _ => {}
    }
}
