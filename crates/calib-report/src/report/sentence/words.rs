//! Parts of sentences.

use crate::{Setting, Sources};

/// Formats a value with its field, as it is typed. With several fields,
/// the value already contains their names.
pub(in crate::report) fn assigned(field: &str, value: &Setting) -> String {
    if is_one(field) { format!("{field} = {value}") } else { value.to_string() }
}

/// Lists the fields: "`learning_rate`", "gamma and `learning_rate`".
pub(super) fn fields(field: &str) -> String {
    listed(&field.split(SEPARATOR).map(str::to_owned).collect::<Vec<_>>())
}

/// Separator between the fields of a grid of several.
const SEPARATOR: &str = ", ";

fn is_one(field: &str) -> bool {
    !field.contains(SEPARATOR)
}

/// Formats a rank as an ordinal: "2nd".
pub(super) fn ordinal(rank: usize) -> String {
    let suffix = match (rank % 10, rank % 100) {
        (1, tens) if tens != 11 => "st",
        (2, tens) if tens != 12 => "nd",
        (3, tens) if tens != 13 => "rd",
        _ => "th",
    };
    format!("{rank}{suffix}")
}

/// Joins items: "a", "a and b", "a, b and c".
pub fn listed(items: &[String]) -> String {
    joined(items, "and")
}

/// Joins items, the last of them with a word: "a, b or c".
pub fn joined(items: &[String], word: &str) -> String {
    match items {
        [] => String::new(),
        [one] => one.clone(),
        [first @ .., last] => format!("{} {word} {last}", first.join(", ")),
    }
}

impl Sources {
    /// Returns where the training runs took place: "in kNN and on the replayed log".
    pub(super) fn within(self, model: &str) -> String {
        match self {
            Self::Members => format!("in {model}"),
            Self::MembersAndLog => format!("in {model} and on the replayed log"),
            Self::Log => "on the replayed log".to_owned(),
        }
    }
}
