use toml::{Table, Value};

use crate::written::{key as key_of, quoted};

/// Comment after a value that the user gave.
const GIVEN: &str = "# given";

/// Sets keys that the user gave as `section.key=value` in the text of a study. Each key replaces the line of the same key in its
/// section. A table replaces a whole section with all its subsections.
pub fn with_given(text: &str, given: &[String]) -> String {
    given.iter().fold(text.to_owned(), |text, one| match one.split_once('=') {
        Some((key, value)) => with(&text, key.trim(), value.trim()),
        None => text,
    })
}

fn with(text: &str, path: &str, value: &str) -> String {
    if let Some(text) = with_table(text, path, value) {
        return text;
    }
    let (section, key) = path.rsplit_once('.').unwrap_or(("", path));
    let line = format!("{key} = {}  {GIVEN}", toml(value));
    let lines: Vec<&str> = text.lines().collect();
    let header = format!("[{section}]");
    let Some(start) = start_of(&lines, section, &header) else {
        return format!("{text}\n{header}\n{line}\n");
    };
    let length = lines[start..].iter().position(|line| line.starts_with('['));
    let end = length.map_or(lines.len(), |length| start + length);
    let mut all: Vec<&str> = lines[..start].to_vec();
    if let Some(at) = lines[start..end].iter().position(|line| {
        line.strip_prefix(key).is_some_and(|rest| rest.trim_start().starts_with('='))
    }) {
        let at = start + at;
        // A list over several lines ends at its bracket.
        let rows = if lines[at].trim_end().ends_with('[') {
            lines[at..end].iter().position(|line| line.trim() == "]").unwrap_or(0)
        } else {
            0
        };
        all.extend(&lines[start..at]);
        all.push(&line);
        all.extend(&lines[at + rows + 1..]);
    } else {
        all.push(&line);
        all.extend(&lines[start..]);
    }
    all.join("\n") + "\n"
}

/// Replaces the section `path` by the table `value`; `None` if the study has no such section, or the value is not a table.
fn with_table(text: &str, path: &str, value: &str) -> Option<String> {
    let Some(Value::Table(table)) = parsed(value) else { return None };
    let mut all: Vec<String> = Vec::new();
    let mut is_written = false;
    let mut is_replaced = false;
    for line in text.lines() {
        if line.starts_with('[') {
            is_replaced = is_header_inside(line, path);
        }
        if is_replaced && !is_written {
            is_written = true;
            all.push(format!("[{path}]"));
            let keys = table.iter();
            all.extend(keys.map(|(key, value)| format!("{} = {value}  {GIVEN}", key_of(key))));
        }
        // Blank lines between sections stay.
        if !is_replaced || line.is_empty() {
            all.push(line.to_owned());
        }
    }
    is_written.then(|| all.join("\n") + "\n")
}

/// Whether a line is the header of the section `path` or of one of its subsections.
fn is_header_inside(line: &str, path: &str) -> bool {
    let name = line.trim().strip_prefix('[').and_then(|line| line.strip_suffix(']'));
    let rest = name.and_then(|name| name.strip_prefix(path));
    rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
}

/// Finds the first line of a section: below its header, or below the comments at the top for keys without a section.
fn start_of(lines: &[&str], section: &str, header: &str) -> Option<usize> {
    if section.is_empty() {
        return Some(lines.iter().take_while(|line| line.starts_with('#')).count());
    }
    lines.iter().position(|line| line.trim() == header).map(|at| at + 1)
}

/// Returns the value unchanged if it is TOML, otherwise as a TOML string.
fn toml(value: &str) -> String {
    if parsed(value).is_some() { value.to_owned() } else { quoted(value) }
}

/// Parses a value as TOML; `None` if it is not TOML.
pub(crate) fn parsed(value: &str) -> Option<Value> {
    toml::from_str::<Table>(&format!("value = {value}")).ok()?.remove("value")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_given_takes_its_place() {
        let text = "# top\n\nseed = 0\n\n[data]\npath = \"x\"\nexclude = [\n    \"a\",\n]\n\n[model]\nmembers = 5\n";
        let given = [
            "data.time_zone=Europe/Paris",
            "data.exclude=[\"b\"]",
            "model.members = 3",
            "seed=7",
            "rollout.steps=100",
        ]
        .map(str::to_owned);
        let read: Table = toml::from_str(&with_given(text, &given)).expect("TOML");
        assert_eq!(read["data"]["time_zone"].as_str(), Some("Europe/Paris"));
        assert_eq!(read["data"]["path"].as_str(), Some("x"));
        assert_eq!(read["data"]["exclude"], Value::Array(vec!["b".into()]));
        assert_eq!(read["model"]["members"].as_integer(), Some(3));
        assert_eq!(read["seed"].as_integer(), Some(7));
        assert_eq!(read["rollout"]["steps"].as_integer(), Some(100));
    }

    #[test]
    fn a_table_takes_the_place_of_a_section() {
        let text = "[control]\nsteps = 9\n\n[control.grid]\nstep_size = [0.1]   # a\ntemperature = [1.0]\n\n[control.grid.more]\nx = 1\n\n\
                    [control.gridded]\ny = 2\n";
        let given = [
            "control.grid={ step_size = [0.3, 0.5], 'a b' = { c = \"x\" } }",
            "control.grid.beta1=[0.9]",
            "control.model={ members = 2 }",
        ]
        .map(str::to_owned);
        let written = with_given(text, &given);
        let read: Table =
            toml::from_str(&written).unwrap_or_else(|error| panic!("{written}{error}"));
        let control = &read["control"];
        assert_eq!(control["steps"].as_integer(), Some(9));
        let expected = "step_size = [0.3, 0.5]\nbeta1 = [0.9]\n'a b' = { c = 'x' }";
        let expected: Table = toml::from_str(expected).expect("TOML");
        assert_eq!(control["grid"].as_table(), Some(&expected));
        assert_eq!(control["gridded"]["y"].as_integer(), Some(2));
        assert_eq!(control["model"]["members"].as_integer(), Some(2));
    }
}
