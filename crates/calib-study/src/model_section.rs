use std::{borrow::Cow, ops::Deref};

use calib_data::TimeRange;
use calib_knn::{IndexKind, ModelConfig, PrototypeKind, WeightsKind};
use calib_model::ModelKind;
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::{Deserialize, Serialize};

/// The `[model]` section: the model, and what it is built from.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(from = "Written")]
pub struct ModelSection {
    /// What kind of model; most other keys are about `"knn"` (default: `"knn"`).
    pub kind: ModelKind,
    /// Keys about neighbours.
    #[serde(flatten)]
    pub config: ModelConfig,
    /// The part of the training range that the model is built from (default: all that is not for pre-training).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub period: Option<TimeRange>,
}

impl ModelSection {
    /// Returns the section with the default search structure. Tables, sampled transitions and all results that
    /// depend on them are the same for every structure.
    #[must_use]
    pub fn of_any_index(&self) -> Self {
        let config = ModelConfig { index: IndexKind::Auto, ..self.config };
        Self { kind: self.kind, config, period: self.period.clone() }
    }
}

impl Deref for ModelSection {
    type Target = ModelConfig;

    fn deref(&self) -> &ModelConfig {
        &self.config
    }
}

impl JsonSchema for ModelSection {
    fn schema_name() -> Cow<'static, str> {
        "ModelSection".into()
    }

    /// Returns the schema of `ModelConfig` with the kind and the period added.
    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let mut schema = ModelConfig::json_schema(generator);
        let mut period = generator.subschema_for::<Option<TimeRange>>();
        period.insert(
            "description".to_owned(),
            "The part of the training range that the model is built from (default: all that is not for pre-training)."
                .into(),
        );
        let mut kind = generator.subschema_for::<ModelKind>();
        kind.insert("default".to_owned(), "knn".into());
        kind.insert(
            "description".to_owned(),
            "What kind of model; the other keys are about `\"knn\"`.".into(),
        );
        let keys = schema.get_mut("properties").and_then(serde_json::Value::as_object_mut);
        if let Some(keys) = keys {
            keys.insert("kind".to_owned(), kind.into());
            keys.insert("period".to_owned(), period.into());
        }
        schema.insert("description".to_owned(), "The `[model]` section.".into());
        schema
    }
}

/// Lists every key of the section. Flattening would lose the messages about unknown keys and their places.
macro_rules! written_keys {
    ($($(#[$attribute:meta])* $key:ident: $kind:ty),* $(,)?) => {
        #[derive(Deserialize)]
        #[serde(deny_unknown_fields, default)]
        struct Written {
            period: Option<TimeRange>,
            kind: ModelKind,
            $($(#[$attribute])* $key: $kind,)*
        }

        impl Default for Written {
            fn default() -> Self {
                let ModelSection { kind, config, period } = ModelSection::default();
                Self { period, kind, $($key: config.$key,)* }
            }
        }

        impl From<Written> for ModelSection {
            fn from(written: Written) -> Self {
                let Written { period, kind, $($key,)* } = written;
                Self { kind, config: ModelConfig { $($key,)* }, period }
            }
        }
    };
}

written_keys! {
    members: usize,
    neighbors: usize,
    exclude_self: bool,
    theiler: u32,
    weights: WeightsKind,
    temperature: f64,
    prototypes: u32,
    prototype_kind: PrototypeKind,
    components: usize,
    leaf_budget: usize,
    #[serde(alias = "recurrent")]
    remove_traps: bool,
    index: IndexKind,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn period_and_kind_are_keys_beside_those_of_neighbors() {
        let text = "neighbors = 5\nperiod = { start = 2022-11-01 }\nkind = \"nn\"\nmembers = 3\n";
        let section: ModelSection = toml::from_str(text).expect("valid");
        assert_eq!((section.kind, section.neighbors, section.members), (ModelKind::Nn, 5, 3));
        let period = section.period.as_ref().expect("given");
        assert_eq!(period.to_string(), "2022-11-01 .. end of the log");
        let written = toml::to_string(&section).expect("TOML");
        assert_eq!(toml::from_str::<ModelSection>(&written).expect("valid"), section);
        let json = serde_json::to_string(&section).expect("JSON");
        assert_eq!(serde_json::from_str::<ModelSection>(&json).expect("valid"), section);
        assert_eq!(toml::from_str::<ModelSection>("").expect("empty"), ModelSection::default());
    }

    #[test]
    fn unknown_keys_have_a_place_and_neighbours() {
        let error =
            toml::from_str::<ModelSection>("members = 3\nperiot = 1\n").expect_err("unknown");
        assert!(
            error.message().contains("unknown field `periot`, expected one of `period`, `kind`")
        );
        assert_eq!(error.span(), Some(12..18));
    }
}
