//! Parts of sentences.

use crate::{Setting, Sources};

/// A value of a field as one would type it. Where several fields vary, it names them already.
pub(in crate::report) fn assigned(field: &str, value: &Setting) -> String {
    if is_one(field) { format!("{field} = {value}") } else { value.to_string() }
}

/// "`learning_rate`", "gamma and `learning_rate`".
pub(super) fn fields(field: &str) -> String {
    listed(&field.split(SEPARATOR).map(str::to_owned).collect::<Vec<_>>())
}

/// What stands between the fields of a grid of several.
const SEPARATOR: &str = ", ";

fn is_one(field: &str) -> bool {
    !field.contains(SEPARATOR)
}

/// "2nd".
pub(super) fn ordinal(rank: usize) -> String {
    let suffix = match (rank % 10, rank % 100) {
        (1, tens) if tens != 11 => "st",
        (2, tens) if tens != 12 => "nd",
        (3, tens) if tens != 13 => "rd",
        _ => "th",
    };
    format!("{rank}{suffix}")
}

/// "a", "a and b", "a, b and c".
pub fn listed(items: &[String]) -> String {
    match items {
        [] => String::new(),
        [one] => one.clone(),
        [first @ .., last] => format!("{} and {last}", first.join(", ")),
    }
}

impl Sources {
    /// Where they were made: "in kNN and on the replayed log".
    pub(super) fn within(self, model: &str) -> String {
        match self {
            Self::Members => format!("in {model}"),
            Self::MembersAndLog => format!("in {model} and on the replayed log"),
            Self::Log => "on the replayed log".to_owned(),
        }
    }
}
