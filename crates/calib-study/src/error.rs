use std::{fmt, io, path::PathBuf};

use crate::source::Place;

/// Reason why a study cannot be used. The message gives the place, the expectation and the remedy.
#[derive(Debug, thiserror::Error)]
pub enum StudyError {
    /// The file cannot be read.
    #[error(
        "cannot read the study {}; expected a TOML file such as configs/quickstart.toml",
        path.display()
    )]
    Unreadable {
        /// Path of the study file.
        path: PathBuf,
        /// Error of the operating system.
        source: io::Error,
    },
    /// A mistake in the text of the file.
    #[error("{place}: {message}")]
    Written {
        /// Position in the file.
        place: Box<Place>,
        /// The mistake, the expectation and the remedy.
        message: String,
    },
    /// A mistake outside the text of the file: a missing key, or an option given on the command line.
    #[error("{study}: {message}")]
    Given {
        /// The file, followed by the options that were given with it.
        study: String,
        /// The mistake, the expectation and the remedy.
        message: String,
    },
    /// An invalid value that belongs to no file.
    #[error("{0}")]
    Value(String),
    /// A mistake in a study that was drawn from a protocol.
    #[error("{plant} as the protocol draws it")]
    Drawn {
        /// Name of the plant that the study describes.
        plant: String,
        /// The mistake in the drawn study.
        source: Box<StudyError>,
    },
    /// An environment variable that a path names is not set.
    #[error(
        "{}: data.path = \"{path}\": the environment variable {name} is not set; \
         set it to the folder of the data, or say --set data.path=FOLDER",
        study.display()
    )]
    UnsetVariable {
        /// Path of the study file.
        study: PathBuf,
        /// The path that names the variable.
        path: String,
        /// Name of the variable.
        name: String,
    },
}

impl StudyError {
    /// Returns the position in the file, with the line and carets below the mistake. `None` outside a file.
    pub fn place(&self) -> Option<&Place> {
        match self {
            Self::Written { place, .. } => Some(place),
            Self::Drawn { source, .. } => source.place(),
            _ => None,
        }
    }
}

/// A mistake whose position is not known yet. It does not implement
/// [`std::error::Error`], so that every such error converts to it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Problem {
    /// The key at fault, if known. Otherwise the message names it.
    key: Option<String>,
    /// The enclosing sections, outermost first.
    sections: Vec<String>,
    message: String,
}

impl Problem {
    /// Creates a problem. Without a key from [`Problem::of_key`], the first word of the message may be the key.
    pub(crate) fn new(message: impl Into<String>) -> Self {
        Self { key: None, sections: Vec::new(), message: message.into() }
    }

    /// Creates a problem with `key`, relative to the section that [`within`](Self::within) adds.
    pub(crate) fn of_key(key: impl Into<String>, message: impl Into<String>) -> Self {
        Self { key: Some(key.into()), ..Self::new(message) }
    }

    /// Adds an enclosing section, such as `profiles.tiny`.
    pub(crate) fn within(mut self, section: &str) -> Self {
        let key = self.key.take().or_else(|| self.told_key());
        // Some messages name their key together with its section.
        let is_told = key
            .as_deref()
            .is_some_and(|key| key.strip_prefix(section).is_some_and(|rest| rest.starts_with('.')));
        if is_told {
            self.key = key;
        } else {
            self.key = key.map(|key| format!("{section}.{key}"));
            self.message = format!("[{section}]: {}", self.message);
        }
        self.sections.insert(0, section.to_owned());
        self
    }

    /// Puts `words` and a colon before the message.
    pub(crate) fn after(mut self, words: &str) -> Self {
        self.message = format!("{words}: {}", self.message);
        self
    }

    /// Returns the keys that may be at fault: the most precise one first, then its sections.
    pub(crate) fn keys(&self) -> Vec<String> {
        let key = self.key.clone().or_else(|| self.told_key());
        let mut keys = Vec::new();
        let mut rest = key.as_deref().or(self.sections.first().map(String::as_str));
        while let Some(key) = rest {
            keys.push(key.to_owned());
            rest = key.rsplit_once('.').map(|(section, _)| section);
        }
        keys
    }

    /// Finds the key that the message names: in the first backticks, or at the beginning.
    fn told_key(&self) -> Option<String> {
        let text = match self.sections.first() {
            Some(section) => self.message.strip_prefix(&format!("[{section}]: ")),
            None => Some(self.message.as_str()),
        }?;
        let quoted = text.split('`').nth(1).map(without_entry).filter(|word| is_key(word));
        let first = text.trim_start_matches('[').split([' ', ':', ',']).next().map(|word| {
            let word = without_entry(word);
            word.split(']').next().unwrap_or_default().to_owned()
        });
        quoted.or(first).filter(|word| is_key(word))
    }
}

/// Removes the index of a list entry from a key: `reward[0].power` becomes `reward.power`.
fn without_entry(word: &str) -> String {
    let parts = word.split_once('[').and_then(|(list, rest)| Some((list, rest.split_once(']')?)));
    match parts {
        Some((list, (number, below))) if number.parse::<usize>().is_ok() => {
            format!("{list}{below}")
        }
        _ => word.to_owned(),
    }
}

/// Whether a word can be a key, with or without its sections.
fn is_key(word: &str) -> bool {
    !word.is_empty()
        && word
            .chars()
            .all(|letter| letter.is_ascii_alphanumeric() || ['_', '-', '.'].contains(&letter))
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl From<Problem> for StudyError {
    fn from(problem: Problem) -> Self {
        Self::Value(problem.to_string())
    }
}

/// Converts the error of another package, with all its causes, each mentioned once.
impl<E: std::error::Error> From<E> for Problem {
    fn from(error: E) -> Self {
        let mut message = error.to_string();
        let mut cause = error.source();
        while let Some(inner) = cause {
            let told = inner.to_string();
            if !message.contains(&told) {
                message = format!("{message}: {told}");
            }
            cause = inner.source();
        }
        Self::new(message)
    }
}

/// Returns a [`Problem`] with a formatted message from the enclosing function.
macro_rules! refuse {
    ($($format:tt)*) => { return Err($crate::error::Problem::new(format!($($format)*))) };
}

/// Returns a [`Problem`] from the enclosing function unless a condition holds.
macro_rules! require {
    ($holds:expr, $($format:tt)*) => { if !$holds { $crate::error::refuse!($($format)*); } };
}

pub(crate) use {refuse, require};

#[cfg(test)]
mod tests {
    use super::*;

    fn keys(problem: &Problem) -> String {
        problem.keys().join(" ")
    }

    #[test]
    fn a_problem_knows_its_key() {
        assert_eq!(keys(&Problem::new("sweep.steps must be from 2")), "sweep.steps sweep");
        let agent = Problem::new("agent hyperparameter `gamma`: expected").within("agent");
        assert_eq!(keys(&agent), "agent.gamma agent");
        assert_eq!(agent.to_string(), "[agent]: agent hyperparameter `gamma`: expected");
        let nested = agent.within("profiles.tiny");
        assert_eq!(
            keys(&nested),
            "profiles.tiny.agent.gamma profiles.tiny.agent profiles.tiny profiles"
        );
        assert_eq!(keys(&Problem::of_key("a.b", "no")), "a.b a");
        let term = Problem::new("`reward[0].power` is 3").within("control");
        assert_eq!(keys(&term), "control.reward.power control.reward control");
        assert_eq!(
            keys(&Problem::new("reward[12] has both").within("control")),
            "control.reward control"
        );
        let whole = Problem::new("control.models is empty").within("control");
        assert_eq!(
            (keys(&whole).as_str(), whole.to_string().as_str()),
            ("control.models control", "control.models is empty")
        );
        assert_eq!(keys(&Problem::new("[models.\"x y\"]: names")), "");
    }
}
