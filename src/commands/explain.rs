//! `calib explain`: the meaning of a key of a study, from the JSON Schema that editors use.

use schemars::JsonSchema;
use serde::Serialize;
use serde_json::Value;

use calib_pipeline::{Outcome, Printer, StepError, bail};

/// Most keys that are suggested for an unknown one.
const SUGGESTED: usize = 6;
/// Smallest similarity of a suggested name.
const ALIKE: f64 = 0.85;

/// The output of `--json`.
#[derive(Serialize, JsonSchema)]
pub(crate) struct Explained {
    key: String,
    /// The part of the schema of a study that describes the key.
    schema: Value,
}

/// Explains a key, or a section with its keys, or all sections if there is no name.
pub(super) fn run(key: Option<&str>, printer: &Printer) -> Result<Outcome, StepError> {
    let schema = calib_study::schema();
    let Some(path) = key else {
        printer.lines(&list(&schema, &schema, ""))?;
        return Ok(Outcome::Done);
    };
    let path = path.trim().trim_matches(['[', ']']);
    let Some(found) = find_key(&schema, path) else {
        let all = keys(&schema, &schema, "");
        let last = path.rsplit('.').next().unwrap_or(path);
        let known = calib_study::meant_key(last).or_else(|| value_above(&schema, path));
        let meant = known.map_or_else(|| similar_keys(path, &all), |key| vec![key]);
        let hint = match meant.as_slice() {
            [] => "`calib explain` lists all sections".to_owned(),
            meant => format!("did you mean {}?", meant.join(", ")),
        };
        bail!("no key `{path}`; {hint}");
    };
    if printer.is_json() {
        printer.json(&Explained { key: path.to_owned(), schema: resolved(&schema, found) })?;
    } else {
        printer.lines(&describe(&schema, found, path))?;
    }
    Ok(Outcome::Done)
}

/// Returns the part of the schema that describes a key.
fn find_key<'a>(schema: &'a Value, path: &str) -> Option<&'a Value> {
    path.split('.').try_fold(schema, |at, part| child(schema, at, part))
}

/// Returns the key of a value that `path` treats as a section, as in `control.reward.column`.
fn value_above<'a>(schema: &Value, path: &'a str) -> Option<&'a str> {
    // Messages number the entries of a list, as in `control.reward[0].column`.
    let mut above = path.split('[').next().unwrap_or(path);
    loop {
        if let Some(node) = find_key(schema, above) {
            let is_section = dereferenced(schema, node)["properties"].is_object();
            return (!is_section).then_some(above);
        }
        (above, _) = above.rsplit_once('.')?;
    }
}

/// Follows a reference in the schema.
fn dereferenced<'a>(schema: &'a Value, node: &'a Value) -> &'a Value {
    let reference = node["$ref"].as_str().or_else(|| {
        ["allOf", "anyOf", "oneOf"].iter().find_map(|key| node[*key][0]["$ref"].as_str())
    });
    match reference.and_then(|path| path.rsplit('/').next()) {
        Some(name) => &schema["definitions"][name],
        None => node,
    }
}

/// Returns a key in a section, or an entry of a table of names.
fn child<'a>(schema: &'a Value, at: &'a Value, part: &str) -> Option<&'a Value> {
    let at = dereferenced(schema, at);
    let named = at["additionalProperties"].as_object().map(|_| &at["additionalProperties"]);
    at["properties"].get(part).or(named)
}

/// Returns a definition merged with the keys beside its reference.
fn resolved(schema: &Value, node: &Value) -> Value {
    let mut whole = dereferenced(schema, node).clone();
    if let (Some(whole), Some(own)) = (whole.as_object_mut(), node.as_object()) {
        whole.extend(own.iter().map(|(key, value)| (key.clone(), value.clone())));
    }
    whole
}

/// Returns all keys below one, as `section.key`.
fn keys(schema: &Value, at: &Value, above: &str) -> Vec<String> {
    let mut all = Vec::new();
    for (name, node) in dereferenced(schema, at)["properties"].as_object().into_iter().flatten() {
        let path = if above.is_empty() { name.clone() } else { format!("{above}.{name}") };
        // Two levels are enough: profiles and models repeat all keys.
        if above.is_empty() {
            all.extend(keys(schema, node, &path));
        }
        all.push(path);
    }
    all
}

/// Returns keys with a similar name, the most similar first.
fn similar_keys<'a>(path: &str, all: &'a [String]) -> Vec<&'a str> {
    let wanted = path.rsplit('.').next().unwrap_or(path).to_lowercase();
    let mut found: Vec<(f64, &str)> = all
        .iter()
        .map(|key| {
            let name = key.rsplit('.').next().unwrap_or(key);
            let contains = wanted.len() > 2 && (name.contains(&wanted) || wanted.contains(name));
            let likeness = strsim::jaro_winkler(&wanted, name) + f64::from(u8::from(contains));
            (likeness, key.as_str())
        })
        .filter(|key| key.0 > ALIKE)
        .collect();
    found.sort_by(|left, right| right.0.total_cmp(&left.0));
    found.into_iter().map(|(_, key)| key).take(SUGGESTED).collect()
}

/// Lists the keys of a section, each with the first sentence of its description.
fn list(schema: &Value, at: &Value, above: &str) -> String {
    let keys = dereferenced(schema, at)["properties"].as_object();
    let rows: Vec<[String; 2]> = keys
        .into_iter()
        .flatten()
        .map(|(name, node)| {
            let about = about(schema, node);
            let first = about.split_inclusive(". ").next().unwrap_or_default().trim().to_owned();
            let path = if above.is_empty() { name.clone() } else { format!("{above}.{name}") };
            [path, first]
        })
        .collect();
    let width = rows.iter().map(|[key, _]| key.chars().count()).max().unwrap_or(0);
    let lines = rows.iter().map(|[key, meaning]| format!(" {key:width$}  {meaning}"));
    lines.collect::<Vec<_>>().join("\n")
}

/// Returns the description of a key. Each paragraph is one line, except for tables.
fn about(schema: &Value, node: &Value) -> String {
    let own = node["description"].as_str();
    let text =
        own.or_else(|| dereferenced(schema, node)["description"].as_str()).unwrap_or_default();
    text.split("\n\n")
        .map(|text| match text {
            table if table.starts_with('|') => table.to_owned(),
            wrapped => wrapped.replace('\n', " "),
        })
        .collect::<Vec<_>>()
        .join("\n\n")
}

fn describe(schema: &Value, node: &Value, path: &str) -> String {
    let is_section = dereferenced(schema, node)["properties"].is_object();
    let text = format!("{path}: {}\n", about(schema, node));
    if is_section {
        return format!("{text}\n{}", list(schema, node, path));
    }
    let allowed = match allowed(schema, node) {
        none if none.is_empty() => none,
        allowed => format!("allowed: {allowed}\n"),
    };
    let default = match &node["default"] {
        Value::Null => String::new(),
        default => format!("default: {default}\n"),
    };
    format!(
        "{text}{allowed}{default}for one run: --set {path}=VALUE\nmore: https://github.com/calib-rs/calib/blob/main/docs/study.md\n"
    )
}

/// Describes the allowed values of a key in words.
fn allowed(schema: &Value, node: &Value) -> String {
    let node = dereferenced(schema, node);
    for alternatives in ["oneOf", "anyOf"] {
        if let Some(all) = node[alternatives].as_array() {
            let all: Vec<String> = all.iter().map(|one| allowed(schema, one)).collect();
            return all.join(", or ");
        }
    }
    if let Some(value) = node.get("const") {
        let about =
            node["description"].as_str().map(|text| format!(" ({})", text.trim_end_matches('.')));
        return format!("{value}{}", about.unwrap_or_default());
    }
    if let Some(values) = node["enum"].as_array() {
        return values.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ");
    }
    let bounds = [
        ("minimum", "at least"),
        ("exclusiveMinimum", "above"),
        ("maximum", "at most"),
        ("exclusiveMaximum", "below"),
    ];
    let bounds: Vec<String> = bounds
        .into_iter()
        .filter_map(|(key, word)| Some(format!("{word} {}", node[key].as_f64()?)))
        .collect();
    let kind = match node["type"].as_str() {
        Some("integer") => "a whole number",
        Some("number") => "a number",
        Some("string") => "text",
        Some("boolean") => "true or false",
        Some("array") => "a list",
        Some("object") => "a table",
        _ => return String::new(),
    };
    [vec![kind.to_owned()], bounds].concat().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn explained(path: &str) -> String {
        let schema = calib_study::schema();
        describe(&schema, find_key(&schema, path).expect(path), path)
    }

    #[test]
    fn keys_and_sections_are_explained() {
        let gamma = explained("agent.gamma");
        assert!(gamma.starts_with("agent.gamma: ") && gamma.contains("default: 0.99"), "{gamma}");
        let missing = explained("preprocess.missing");
        assert!(missing.contains("\"forward_fill\""), "{missing}");
        let levels = explained("control.levels");
        assert!(levels.contains("a whole number, at least 2, at most 1024"), "{levels}");
        assert!(explained("sweep").contains("sweep.member_runs"));
        assert!(explained("deployments.april.start").starts_with("deployments.april.start: "));
        assert!(explained("models.big.model.kind").starts_with("models.big.model.kind: "));
    }

    #[test]
    fn every_key_has_a_meaning() {
        let schema = calib_study::schema();
        for key in keys(&schema, &schema, "") {
            let text = explained(&key);
            assert!(text.len() > key.len() + 12, "{key}: {text}");
        }
    }

    #[test]
    fn what_is_said_is_for_people() {
        let schema = calib_study::schema();
        for key in keys(&schema, &schema, "") {
            let text = explained(&key);
            assert!(!text.contains("[`") && !text.contains("::"), "a link of the code: {text}");
        }
        let sections = list(&schema, &schema, "");
        assert!(sections.lines().all(|line| !line.contains("\\n")), "{sections}");
        let [data, output] = ["Where the log is", "Where results go"].map(|meaning| {
            sections.lines().find_map(|line| line.find(meaning)).expect("it is there")
        });
        assert_eq!(data, output, "meanings begin below each other: {sections}");
        assert!(sections.contains("without `.toml`, followed by `-results`"), "{sections}");
    }

    #[test]
    fn near_keys_are_suggested() {
        let schema = calib_study::schema();
        let all = keys(&schema, &schema, "");
        assert_eq!(similar_keys("agent.gama", &all)[0], "agent.gamma");
        assert!(similar_keys("batch_size", &all).contains(&"agent.batch_size"));
        assert!(similar_keys("zz", &all).is_empty());
        for (path, above) in [
            ("control.reward.column", Some("control.reward")),
            ("control.reward[0].column", Some("control.reward")),
            ("control.steps.a.b", Some("control.steps")),
            ("agent.gama", None),
            ("zz.a", None),
        ] {
            assert_eq!(value_above(&schema, path), above, "{path}");
        }
    }
}
