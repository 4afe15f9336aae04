use std::{borrow::Cow, cell::RefCell, fmt, ops::Deref};

use calib_data::TimeRange;
use calib_knn::{IndexKind, ModelConfig};
use calib_model::ModelKind;
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::{
    Deserialize, Serialize,
    de::{self, DeserializeSeed, Deserializer, MapAccess, Visitor, value::MapAccessDeserializer},
};

/// The `[model]` section: the model, and what it is built from.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
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
    /// The same section with the search structure left to calib: what tables, draws and all that follows from them depend
    /// on.
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

/// The keys that are not about neighbours.
const PERIOD: &str = "period";
const KIND: &str = "kind";

impl JsonSchema for ModelSection {
    fn schema_name() -> Cow<'static, str> {
        "ModelSection".into()
    }

    /// That of the keys about neighbours, with the kind and the period.
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
            keys.insert(KIND.to_owned(), kind.into());
            keys.insert(PERIOD.to_owned(), period.into());
        }
        schema.insert("description".to_owned(), "The `[model]` section.".into());
        schema
    }
}

// Derived, flattening would lose what is said of unknown keys, and where they are.
impl<'de> Deserialize<'de> for ModelSection {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Section;

        impl<'de> Visitor<'de> for Section {
            type Value = ModelSection;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("the section [model]")
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<ModelSection, A::Error> {
                let own = RefCell::new(ModelSection::default());
                let rest = Rest { map, own: &own };
                let config = ModelConfig::deserialize(MapAccessDeserializer::new(rest))?;
                Ok(ModelSection { config, ..own.into_inner() })
            }
        }

        deserializer.deserialize_map(Section)
    }
}

/// The entries of the section that are about neighbours; the others are put aside.
struct Rest<'a, A> {
    map: A,
    own: &'a RefCell<ModelSection>,
}

impl<'de, A: MapAccess<'de>> MapAccess<'de> for Rest<'_, A> {
    type Error = A::Error;

    fn next_key_seed<K: DeserializeSeed<'de>>(
        &mut self,
        mut seed: K,
    ) -> Result<Option<K::Value>, A::Error> {
        loop {
            match self.map.next_key_seed(Key(seed))? {
                None => return Ok(None),
                Some(Found::Neighbors(key)) => return Ok(Some(key)),
                Some(Found::Period(again)) => {
                    self.own.borrow_mut().period = Some(self.map.next_value()?);
                    seed = again;
                }
                Some(Found::Kind(again)) => {
                    self.own.borrow_mut().kind = self.map.next_value()?;
                    seed = again;
                }
            }
        }
    }

    fn next_value_seed<V: DeserializeSeed<'de>>(&mut self, seed: V) -> Result<V::Value, A::Error> {
        self.map.next_value_seed(seed)
    }
}

/// A key, with what reads it or the next one.
struct Key<K>(K);

enum Found<K, T> {
    /// The period, with what reads the next key.
    Period(K),
    /// The kind, with what reads the next key.
    Kind(K),
    /// A key about neighbours, or an unknown one.
    Neighbors(T),
}

impl<'de, K: DeserializeSeed<'de>> DeserializeSeed<'de> for Key<K> {
    type Value = Found<K, K::Value>;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Self::Value, D::Error> {
        deserializer.deserialize_identifier(self)
    }
}

impl<'de, K: DeserializeSeed<'de>> Visitor<'de> for Key<K> {
    type Value = Found<K, K::Value>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a key of [model]")
    }

    fn visit_str<E: de::Error>(self, key: &str) -> Result<Self::Value, E> {
        match key {
            PERIOD => return Ok(Found::Period(self.0)),
            KIND => return Ok(Found::Kind(self.0)),
            _ => {}
        }
        let key = self.0.deserialize(de::value::StrDeserializer::<E>::new(key));
        key.map(Found::Neighbors).map_err(|error| {
            // The keys about neighbours do not know of the others, but whoever mistypes one should.
            let known = format!("expected one of `{PERIOD}`, `{KIND}`, ");
            E::custom(error.to_string().replacen("expected one of ", &known, 1))
        })
    }
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
