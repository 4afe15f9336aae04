use toml::Table;

use crate::written::quoted;

/// What stands behind a value that somebody gave.
const GIVEN: &str = "# given";

/// A study with keys that were given as `section.key=value`: each in its section, in the place of what stood there.
pub fn with_given(text: &str, given: &[String]) -> String {
    given.iter().fold(text.to_owned(), |text, one| match one.split_once('=') {
        Some((key, value)) => with(&text, key.trim(), value.trim()),
        None => text,
    })
}

fn with(text: &str, path: &str, value: &str) -> String {
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
        // A list over several lines ends with its bracket.
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

/// The first line of a section: below its header, or for keys without a section below the comments at the top.
fn start_of(lines: &[&str], section: &str, header: &str) -> Option<usize> {
    if section.is_empty() {
        return Some(lines.iter().take_while(|line| line.starts_with('#')).count());
    }
    lines.iter().position(|line| line.trim() == header).map(|at| at + 1)
}

/// A value as TOML has it: as it is if it is TOML, else as text.
fn toml(value: &str) -> String {
    match toml::from_str::<Table>(&format!("value = {value}")) {
        Ok(_) => value.to_owned(),
        Err(_) => quoted(value),
    }
}

#[cfg(test)]
mod tests {
    use toml::Value;

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
}
