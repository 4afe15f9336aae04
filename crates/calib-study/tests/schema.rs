//! Tests that the stored schema is current, every study names it, every protocol draws studies, and the guide has the same
//! keys and defaults.

use std::{collections::BTreeMap, fs, path::PathBuf};

use calib_study::{Protocol, schema};
use serde_json::{Map, Value};
use toml::Table;

/// Returns the path of a file of the repository.
fn file(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../..").join(name)
}

fn read(name: &str) -> String {
    fs::read_to_string(file(name)).expect("it is in the repository")
}

const SCHEMA: &str = "configs/study.schema.json";

fn written() -> String {
    serde_json::to_string_pretty(&schema()).expect("JSON") + "\n"
}

#[test]
fn the_schema_is_that_of_the_structs() {
    assert!(
        read(SCHEMA) == written(),
        "{SCHEMA} is not current; run `cargo test --workspace --test schema write_the_schema -- --ignored`"
    );
}

#[test]
#[ignore = "writes the schema"]
fn write_the_schema() {
    fs::write(file(SCHEMA), written()).expect("writable");
}

#[test]
fn every_study_of_the_repository_names_the_schema() {
    let mut folders = vec![file("configs")];
    let mut studies = 0;
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).expect("a folder").flatten() {
            let path = entry.path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|ending| ending == "toml") {
                let text = fs::read_to_string(&path).expect("readable");
                let table: Table = toml::from_str(&text).expect("TOML");
                let first = text.lines().next().unwrap_or_default();
                let Some(named) = first.strip_prefix("#:schema ") else {
                    assert!(table.contains_key("validity"), "{} names no schema", path.display());
                    continue;
                };
                let named = path.parent().expect("a folder").join(named).canonicalize();
                let schema = file(SCHEMA).canonicalize().expect("there");
                assert_eq!(named.expect("there"), schema, "{}", path.display());
                studies += 1;
            }
        }
    }
    assert!(studies > 8, "{studies} studies");
}

#[test]
fn every_protocol_of_the_repository_draws_valid_studies() {
    let folder = file("configs/validity");
    let mut plants = BTreeMap::new();
    for entry in fs::read_dir(&folder).expect("a folder").flatten() {
        let path = entry.path();
        let Some(protocol) = Protocol::find(&path).expect("valid") else { continue };
        let drawn = protocol.draw(&path, &folder, &[]).expect("plants and tasks");
        for study in &drawn {
            let job = study.job(&folder).expect("a valid study");
            assert!(!job.study().sweep.sensors.is_empty(), "{}", study.plant);
        }
        plants.insert(entry.file_name().into_string().expect("text"), drawn.len());
    }
    assert_eq!((plants["protocol.toml"], plants["warm.toml"]), (29, 29));
    assert_eq!((plants["wastewater.toml"], plants["wastewater-warm.toml"]), (20, 20));
}

/// Row of a table in docs/study.md: a key and its default.
struct Row {
    key: String,
    default: String,
}

/// Returns the tables of keys, each with the heading above it.
fn tables(text: &str) -> Vec<(String, Vec<Row>)> {
    let mut tables: Vec<(String, Vec<Row>)> = Vec::new();
    let mut heading = String::new();
    let mut inside = false;
    for line in text.lines() {
        if let Some(title) = line.strip_prefix("### ") {
            title.trim_matches(['[', ']']).clone_into(&mut heading);
        } else if line.starts_with("## ") {
            heading = String::new();
        }
        let cells: Vec<&str> = line.trim_matches('|').split(" | ").map(str::trim).collect();
        if line.starts_with("| key | default |") {
            inside = true;
            tables.push((heading.clone(), Vec::new()));
        } else if !line.starts_with('|') {
            inside = false;
        } else if inside
            && !line.starts_with("|---")
            && let Some((_, rows)) = tables.last_mut()
        {
            let key = cells[0].trim_matches('`').to_owned();
            rows.push(Row { key, default: cells[1].to_owned() });
        }
    }
    tables
}

/// Returns the keys of a section of the study; `None` if it is not a section.
fn keys<'a>(schema: &'a Value, section: &str) -> Option<&'a Map<String, Value>> {
    if section == "Top level" {
        return schema["properties"].as_object();
    }
    let property = &schema["properties"][section];
    let reference = property["$ref"].as_str().or_else(|| property["allOf"][0]["$ref"].as_str());
    let name = reference?.rsplit('/').next()?;
    schema["definitions"][name]["properties"].as_object()
}

/// Returns the value at the beginning of a cell, if there is one.
fn literal(cell: &str) -> Option<Value> {
    let text = cell.strip_prefix('`')?.split('`').next()?;
    let table: Table = toml::from_str(&format!("value = {text}")).ok()?;
    match &table["value"] {
        toml::Value::Datetime(time) => Some(time.to_string().into()),
        value => serde_json::to_value(value).ok(),
    }
}

/// Whether both values are equal; numbers are compared by value.
fn same(one: &Value, other: &Value) -> bool {
    match (one, other) {
        (Value::Array(a), Value::Array(b)) => {
            a.len() == b.len() && a.iter().zip(b).all(|(a, b)| same(a, b))
        }
        (Value::Number(a), Value::Number(b)) => a.as_f64() == b.as_f64(),
        _ => one == other,
    }
}

fn is_nothing(value: &Value) -> bool {
    match value {
        Value::Null => true,
        Value::String(text) => text.is_empty(),
        Value::Array(values) => values.is_empty(),
        Value::Object(keys) => keys.is_empty(),
        _ => false,
    }
}

#[test]
fn the_guide_names_every_key_with_its_default() {
    let schema = schema();
    let text = read("docs/study.md");
    let tables = tables(&text);
    let mut wrong = Vec::new();
    let mut sections: Vec<String> =
        schema["properties"].as_object().expect("keys").keys().cloned().collect();
    for (section, rows) in &tables {
        let Some(known) = keys(&schema, section) else { continue };
        sections.retain(|other| other != section);
        for Row { key, default } in rows {
            let Some(property) = known.get(key) else {
                wrong.push(format!("[{section}] {key} is no key"));
                continue;
            };
            let own = property.get("default").unwrap_or(&Value::Null);
            // A key that follows from other keys has no default of its own. The guide names the other keys.
            let is_told = default.contains("` ") || default.contains("`;");
            let right = match literal(default) {
                Some(told) if is_nothing(own) => is_nothing(&told) || is_told,
                Some(told) => same(&told, own),
                None => is_nothing(own),
            };
            if !right {
                wrong.push(format!(
                    "[{section}] {key}: the guide says {default}, the default is {own}"
                ));
            }
        }
        for key in known.keys().filter(|key| !rows.iter().any(|row| row.key == **key)) {
            let is_section = section == "Top level" && text.contains(&format!("\n### [{key}"));
            if !is_section && key != "grid" {
                wrong.push(format!("[{section}] {key} is not in the guide"));
            }
        }
    }
    for section in sections {
        if !text.contains(&format!("\n### [{section}.NAME]"))
            && !["seed", "compare", "output"].contains(&section.as_str())
        {
            wrong.push(format!("[{section}] is not in the guide"));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
