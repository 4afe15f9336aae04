//! Where agents learned.

use std::fmt;

/// An environment of a sweep.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum LearningEnvironment {
    /// Held-out data, replayed.
    Online,
    /// Training data, replayed.
    LogReplay,
    /// A member of a calibration model.
    Member {
        /// Its place in the ensemble.
        number: usize,
        /// What the model is called, where there are several.
        model: Option<String>,
    },
}

impl LearningEnvironment {
    /// Whether it is the same for all models of a study.
    pub const fn is_shared(&self) -> bool {
        !matches!(self, Self::Member { .. })
    }

    /// Its part of the names of files.
    pub fn file_name(&self) -> String {
        let name = match self {
            Self::Online => "online".to_owned(),
            Self::LogReplay => "log-replay".to_owned(),
            Self::Member { number, model: None } => format!("member-{number}"),
            Self::Member { number, model: Some(model) } => format!("member-{number}-of-{model}"),
        };
        name.to_lowercase().replace(' ', "-")
    }
}

impl fmt::Display for LearningEnvironment {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Online => f.write_str("the held-out period"),
            Self::LogReplay => f.write_str("log replay"),
            Self::Member { number, model: None } => write!(f, "ensemble member {number}"),
            Self::Member { number, model: Some(model) } => {
                write!(f, "ensemble member {number} of {model}")
            }
        }
    }
}
