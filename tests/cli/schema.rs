//! Validation of a document against its schema: the part of JSON Schema that calib's schemas use. Other keywords cause a panic.
//!  It is stricter than a validator in one respect: a key that the schema does not know is a problem, as if `unevaluatedProperties`
//! were `false` everywhere. The schemas themselves allow unknown keys, so that documents with keys of a later version stay valid.

use std::collections::BTreeSet;

use serde_json::{Map, Value};

/// Returns the schema of the output of `command`.
pub(crate) fn of(command: &str) -> Value {
    let mut schemas = calib::json_schemas();
    let schema = schemas.remove(command).unwrap_or_else(|| panic!("no schema of {command}"));
    schema.into()
}

/// Returns the first violation of `schema` in `value`, and its place.
pub(crate) fn problem(schema: &Value, value: &Value) -> Option<String> {
    Checker { root: schema }.whole(schema, value, "$").err()
}

struct Checker<'a> {
    root: &'a Value,
}

/// Keywords that only describe a value for readers.
const NOTES: [&str; 9] = [
    "title",
    "description",
    "default",
    "$schema",
    "$defs",
    "examples",
    "deprecated",
    "readOnly",
    "writeOnly",
];

/// Keys that an object may have.
enum Keys {
    /// Any key: the object is a map, or JSON of unknown form.
    Any,
    These(BTreeSet<String>),
}

impl Checker<'_> {
    /// Checks a value, and whether all of its keys are known.
    fn whole(&self, schema: &Value, value: &Value, at: &str) -> Result<(), String> {
        self.check(schema, value, at)?;
        let (Value::Object(object), Keys::These(known)) = (value, self.keys(schema, value)) else {
            return Ok(());
        };
        match object.keys().find(|key| !known.contains(*key)) {
            Some(key) => Err(format!("{at}: {key} is in no schema")),
            None => Ok(()),
        }
    }

    /// Returns the keys that `schema` knows for `value`: its own keys, and those of every part that applies to the value.
    fn keys(&self, schema: &Value, value: &Value) -> Keys {
        let Value::Object(rules) = schema else { return Keys::Any };
        let mut parts: Vec<&Value> = Vec::new();
        parts.extend(rules.get("$ref").map(|path| self.target(path)));
        for rule in ["anyOf", "oneOf", "allOf"] {
            let all = rules.get(rule).and_then(Value::as_array).into_iter().flatten();
            parts.extend(all.filter(|part| self.check(part, value, "$").is_ok()));
        }
        let own = rules.get("properties").and_then(Value::as_object);
        let is_open = rules.get("additionalProperties").is_some_and(|says| *says != false);
        if is_open || (own.is_none() && parts.is_empty()) {
            return Keys::Any;
        }
        let mut known: BTreeSet<String> = own.into_iter().flat_map(Map::keys).cloned().collect();
        for part in parts {
            match self.keys(part, value) {
                Keys::Any => return Keys::Any,
                Keys::These(keys) => known.extend(keys),
            }
        }
        Keys::These(known)
    }

    /// Follows a reference.
    fn target(&self, path: &Value) -> &Value {
        let path = path.as_str().and_then(|path| path.strip_prefix('#')).expect("local");
        self.root.pointer(path).expect("a definition")
    }

    fn check(&self, schema: &Value, value: &Value, at: &str) -> Result<(), String> {
        let rules: &Map<String, Value> = match schema {
            Value::Bool(true) => return Ok(()),
            Value::Object(rules) => rules,
            other => panic!("{at}: no schema: {other}"),
        };
        for (rule, says) in rules {
            self.rule(rules, (rule, says), value, at)?;
        }
        Ok(())
    }

    fn rule(
        &self,
        rules: &Map<String, Value>,
        (rule, says): (&str, &Value),
        value: &Value,
        at: &str,
    ) -> Result<(), String> {
        // Bounds apply to numbers only.
        let number = value.as_f64().zip(says.as_f64());
        let refused = |why: &str| Err(format!("{at}: {value} is {why} ({rule}: {says})"));
        match rule {
            "$ref" => self.check(self.target(says), value, at),
            "anyOf" | "oneOf" => {
                let why: Vec<String> = list(says)
                    .iter()
                    .filter_map(|schema| self.check(schema, value, at).err())
                    .collect();
                if why.len() < list(says).len() { Ok(()) } else { Err(why.join("; or ")) }
            }
            "allOf" => list(says).iter().try_for_each(|schema| self.check(schema, value, at)),
            "type" => {
                let names = says.as_array().map_or(std::slice::from_ref(says), Vec::as_slice);
                let is = names.iter().any(|name| is_a(name.as_str().expect("a name"), value));
                if is { Ok(()) } else { refused("of another type") }
            }
            "const" if value != says => refused("another"),
            "enum" if !list(says).contains(value) => refused("none of these"),
            "minimum" if number.is_some_and(|(is, bound)| is < bound) => refused("too small"),
            "maximum" if number.is_some_and(|(is, bound)| is > bound) => refused("too large"),
            "exclusiveMinimum" if number.is_some_and(|(is, bound)| is <= bound) => {
                refused("too small")
            }
            "exclusiveMaximum" if number.is_some_and(|(is, bound)| is >= bound) => {
                refused("too large")
            }
            "minItems" | "maxItems" => {
                let (has, bound) = (value.as_array().map(Vec::len), says.as_u64());
                let few = has.is_some_and(|has| (has as u64) < bound.expect("a number"));
                let many = has.is_some_and(|has| (has as u64) > bound.expect("a number"));
                if if rule == "minItems" { few } else { many } {
                    refused("a list of another length")
                } else {
                    Ok(())
                }
            }
            "format"
                if says == "date-time"
                    && value.as_str().is_some_and(|text| {
                        text.parse::<jiff::Timestamp>().is_err() || !text.contains('T')
                    }) =>
            {
                refused("no time as RFC 3339 has it")
            }
            "required" => {
                match list(says)
                    .iter()
                    .find(|key| value.get(key.as_str().expect("a key")).is_none())
                {
                    Some(key) if value.is_object() => Err(format!("{at}: {key} is missing")),
                    _ => Ok(()),
                }
            }
            "properties" => {
                says.as_object().expect("properties").iter().try_for_each(|(key, schema)| {
                    value
                        .get(key)
                        .map_or(Ok(()), |value| self.whole(schema, value, &format!("{at}.{key}")))
                })
            }
            "additionalProperties" => {
                let named = rules.get("properties");
                let others = value
                    .as_object()
                    .into_iter()
                    .flatten()
                    .filter(|(key, _)| named.is_none_or(|named| named.get(key).is_none()));
                others.into_iter().try_for_each(|(key, value)| match says {
                    Value::Bool(false) => Err(format!("{at}: {key} is in no schema")),
                    schema => self.whole(schema, value, &format!("{at}.{key}")),
                })
            }
            "items" => {
                value.as_array().into_iter().flatten().enumerate().try_for_each(|(place, value)| {
                    if rules
                        .get("prefixItems")
                        .and_then(Value::as_array)
                        .is_some_and(|items| place < items.len())
                    {
                        return Ok(());
                    }
                    self.whole(says, value, &format!("{at}[{place}]"))
                })
            }
            "prefixItems" => {
                let values = value.as_array().into_iter().flatten();
                list(says).iter().zip(values).enumerate().try_for_each(
                    |(place, (schema, value))| self.whole(schema, value, &format!("{at}[{place}]")),
                )
            }
            "const" | "enum" | "minimum" | "maximum" | "exclusiveMinimum" | "exclusiveMaximum"
            | "format" => Ok(()),
            note if NOTES.contains(&note) => Ok(()),
            unknown => panic!("{at}: this test knows no rule {unknown}"),
        }
    }
}

fn list(value: &Value) -> &[Value] {
    value.as_array().expect("a list")
}

fn is_a(name: &str, value: &Value) -> bool {
    match name {
        "null" => value.is_null(),
        "boolean" => value.is_boolean(),
        "integer" => value.is_i64() || value.is_u64(),
        "number" => value.is_number(),
        "string" => value.is_string(),
        "array" => value.is_array(),
        "object" => value.is_object(),
        other => panic!("no type {other}"),
    }
}
