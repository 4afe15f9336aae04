use std::{fmt, io, path::PathBuf};

use crate::source::Place;

/// Why a study cannot be used: what is wrong, where, what was expected, and what to do.
#[derive(Debug, thiserror::Error)]
pub enum StudyError {
    /// The file cannot be read.
    #[error(
        "cannot read the study {}; expected a TOML file such as configs/quickstart.toml",
        path.display()
    )]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// Something that stands in the file.
    #[error("{place}: {message}")]
    Written {
        /// Where it stands.
        place: Box<Place>,
        /// What is wrong, what was expected, and what to do.
        message: String,
    },
    /// Something that does not stand in the file: it is missing there, or was given beside it.
    #[error("{study}: {message}")]
    Given {
        /// The file, with what was given beside it.
        study: String,
        /// What is wrong, what was expected, and what to do.
        message: String,
    },
    /// Something that is of no file.
    #[error("{0}")]
    Value(String),
    /// The study was drawn from a protocol.
    #[error("{plant} as the protocol draws it")]
    Drawn {
        /// The plant that the study stands for.
        plant: String,
        /// What is wrong with it.
        source: Box<StudyError>,
    },
    /// A variable of the environment that a path names, and that is not set.
    #[error(
        "{}: data.path = \"{path}\": the environment variable {name} is not set; \
         set it to the folder of the data, or say --set data.path=FOLDER",
        study.display()
    )]
    UnsetVariable {
        /// The file.
        study: PathBuf,
        /// The path that names the variable.
        path: String,
        /// The name of the variable.
        name: String,
    },
}

impl StudyError {
    /// Where in the file it stands, if it does: file, line, column, and the line itself with carets below what is meant.
    pub fn place(&self) -> Option<&Place> {
        match self {
            Self::Written { place, .. } => Some(place),
            Self::Drawn { source, .. } => source.place(),
            _ => None,
        }
    }
}

/// What is wrong, before it is known where that stands. It is no [`std::error::Error`], so that each of these can become one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Problem {
    /// The key that it is about, where it is known; else the message tells it.
    key: Option<String>,
    /// Sections that the message is about, from the outside.
    sections: Vec<String>,
    message: String,
}

impl Problem {
    /// Something is wrong. Where no key is given by [`Problem::of_key`], the first word of the message may be one.
    pub(crate) fn new(message: impl Into<String>) -> Self {
        Self { key: None, sections: Vec::new(), message: message.into() }
    }

    /// With `key`, from the section that it is [`within`](Self::within).
    pub(crate) fn of_key(key: impl Into<String>, message: impl Into<String>) -> Self {
        Self { key: Some(key.into()), ..Self::new(message) }
    }

    /// In a section, such as `profiles.tiny`.
    pub(crate) fn within(mut self, section: &str) -> Self {
        let key = self.key.take().or_else(|| self.told_key());
        // Some messages name their key with the section that it is in.
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

    /// After some words.
    pub(crate) fn after(mut self, words: &str) -> Self {
        self.message = format!("{words}: {}", self.message);
        self
    }

    /// The keys that it may be about, the most precise one first.
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

    /// The key that the message names: what stands in the first backticks, or else at its beginning.
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

/// A key without the number of an entry of a list: `reward.power` of `reward[0].power`.
fn without_entry(word: &str) -> String {
    let parts = word.split_once('[').and_then(|(list, rest)| Some((list, rest.split_once(']')?)));
    match parts {
        Some((list, (number, below))) if number.parse::<usize>().is_ok() => {
            format!("{list}{below}")
        }
        _ => word.to_owned(),
    }
}

/// Whether a word can be a key, with or without the sections that it is in.
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

/// An error of another package with all its causes, each told once.
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

/// Return with a [`Problem`] whose message is formatted.
macro_rules! refuse {
    ($($format:tt)*) => { return Err($crate::error::Problem::new(format!($($format)*))) };
}

/// Return with a [`Problem`] unless a condition holds.
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
