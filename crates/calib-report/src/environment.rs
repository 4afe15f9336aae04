//! Environments in which agents learned.

use std::fmt;

/// An environment of a sweep.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum LearningEnvironment {
    /// Replay of the held-out period.
    Online,
    /// Replay of the training range.
    LogReplay,
    /// A member of a calibration model.
    Member {
        /// Number of the ensemble member.
        number: usize,
        /// Name of the model, if there are several.
        model: Option<String>,
    },
}

impl LearningEnvironment {
    /// Whether all models of a study share the environment.
    pub const fn is_shared(&self) -> bool {
        !matches!(self, Self::Member { .. })
    }

    /// Returns the part of a file name for this environment.
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
