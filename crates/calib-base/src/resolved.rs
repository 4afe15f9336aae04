//! A study inside of another document, in the schema of that.

use std::borrow::Cow;

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};

/// A study as it was resolved, where it stands in another document.
pub struct ResolvedStudy;

impl JsonSchema for ResolvedStudy {
    fn schema_name() -> Cow<'static, str> {
        "ResolvedStudy".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        let description =
            "The study as it was resolved, with the keys of configs/study.schema.json";
        json_schema!({ "type": "object", "description": description })
    }
}
