//! The schema of a study inside another document.

use std::borrow::Cow;

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};

/// The schema of a resolved study inside another document.
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
