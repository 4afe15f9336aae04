use std::{
    fmt,
    ops::Range,
    path::{Path, PathBuf},
};

use toml::de::{DeTable, DeValue};

/// The text of a study with the positions of its keys.
#[derive(Clone, Debug)]
pub(crate) struct StudyText {
    path: PathBuf,
    text: String,
    /// Each key with the byte range of its last part: `sweep.steps` has the range of `steps`.
    keys: Vec<(String, Range<usize>)>,
}

/// A position in a file, for messages.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Place {
    /// Path of the file.
    pub file: PathBuf,
    /// Line number, counted from 1.
    pub line: usize,
    /// Column in characters, counted from 1.
    pub column: usize,
    /// Text of the whole line.
    excerpt: String,
    /// Number of characters at fault.
    width: usize,
}

impl Place {
    /// Returns the line with carets below the characters at fault.
    pub fn excerpt(&self) -> String {
        let number = self.line.to_string();
        let margin = " ".repeat(number.len());
        // Tabs stay tabs, so that the carets align with the line above.
        let before = self.excerpt.chars().take(self.column - 1);
        let before: String = before.map(|letter| if letter == '\t' { '\t' } else { ' ' }).collect();
        let carets = "^".repeat(self.width.max(1));
        format!("{margin} |\n{number} | {}\n{margin} | {before}{carets}", self.excerpt)
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}:{}", self.file.display(), self.line, self.column)
    }
}

impl StudyText {
    pub(crate) fn new(path: &Path, text: String) -> Self {
        let mut keys = Vec::new();
        // Text that is not TOML has no keys. The parser reports its own position.
        if let Ok(table) = DeTable::parse(&text) {
            collect(table.get_ref(), "", &mut keys);
        }
        Self { path: path.to_owned(), text, keys }
    }

    pub(crate) fn text(&self) -> &str {
        &self.text
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the position of a byte range.
    pub(crate) fn place(&self, span: Range<usize>) -> Place {
        let start = span.start.min(self.text.len());
        let line_start = self.text[..start].rfind('\n').map_or(0, |at| at + 1);
        let line_end = self.text[start..].find('\n').map_or(self.text.len(), |at| start + at);
        let meant = &self.text[start..span.end.clamp(start, line_end)];
        Place {
            file: self.path.clone(),
            line: self.text[..start].matches('\n').count() + 1,
            column: self.text[line_start..start].chars().count() + 1,
            excerpt: self.text[line_start..line_end].trim_end().to_owned(),
            width: meant.trim_end().chars().count(),
        }
    }

    /// Returns the positions of renamed keys, each with the new name.
    pub(crate) fn renamed(&self) -> Vec<(Place, &'static str)> {
        let renamed = self.keys.iter().flat_map(|(key, span)| {
            let new = RENAMED.iter().filter(|(old, _)| ends_in(key, old));
            new.map(|(_, new)| (self.place(span.clone()), *new))
        });
        renamed.collect()
    }

    /// Returns the position of a key, if the text contains it.
    pub(crate) fn place_of(&self, key: &str) -> Option<Place> {
        let (_, span) = self.keys.iter().find(|(known, _)| known == key)?;
        Some(self.place(span.clone()))
    }
}

/// Whether the last part of `key` is `last`, in any section.
fn ends_in(key: &str, last: &str) -> bool {
    key.strip_suffix(last).is_some_and(|above| above.is_empty() || above.ends_with('.'))
}

/// Renamed keys, old and new. The old name is still read.
const RENAMED: [(&str, &str); 1] = [("model.recurrent", "model.remove_traps")];

fn collect(table: &DeTable<'_>, above: &str, keys: &mut Vec<(String, Range<usize>)>) {
    for (key, value) in table {
        let name = key.get_ref().as_ref();
        let path = if above.is_empty() { name.to_owned() } else { format!("{above}.{name}") };
        keys.push((path.clone(), key.span()));
        if let DeValue::Table(table) = value.get_ref() {
            collect(table, &path, keys);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn source(text: &str) -> StudyText {
        StudyText::new(Path::new("study.toml"), text.to_owned())
    }

    /// Returns the line and the column of a key.
    fn at(source: &StudyText, key: &str) -> Option<(usize, usize)> {
        source.place_of(key).map(|place| (place.line, place.column))
    }

    #[test]
    fn keys_are_found_wherever_they_are_written() {
        let text = "seed = 1\n[agent]\ngamma = 2\n[models.a]\nmodel.members = 3\nx = { y = 4 }\n";
        let parsed = source(text);
        assert_eq!(at(&parsed, "seed"), Some((1, 1)));
        assert_eq!(at(&parsed, "agent.gamma"), Some((3, 1)));
        assert_eq!(at(&parsed, "models.a.model.members"), Some((5, 7)));
        assert_eq!(at(&parsed, "models.a.x.y"), Some((6, 7)));
        assert_eq!(at(&parsed, "agent.beta"), None);
        assert!(parsed.renamed().is_empty());
        let old = source("[model]\nrecurrent = false\n[models.a.model]\nrecurrent = true\n");
        let told: Vec<(usize, &str)> =
            old.renamed().iter().map(|(place, new)| (place.line, *new)).collect();
        assert_eq!(told, [(2, "model.remove_traps"), (4, "model.remove_traps")]);
    }

    #[test]
    fn an_excerpt_points_at_what_is_meant() {
        let parsed = source("[agent]\n\t\"gämma\" = 2.0  # too large\n");
        let place = parsed.place_of("agent.gämma").expect("there");
        assert_eq!(place.to_string(), "study.toml:2:2");
        let excerpt = "  |\n2 | \t\"gämma\" = 2.0  # too large\n  | \t^^^^^^^";
        assert_eq!(place.excerpt(), excerpt);
        assert_eq!(parsed.place(9_999..9_999).line, 3, "beyond the end is the end");
        assert_eq!(source("").place(0..5).excerpt(), "  |\n1 | \n  | ^");
        let lines = source("a = [1,\n2]\n").place(4..10);
        assert!(lines.excerpt().ends_with("  |     ^^^"), "{}", lines.excerpt());
    }
}
