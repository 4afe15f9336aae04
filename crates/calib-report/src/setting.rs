//! A value of a swept hyperparameter.

use std::fmt;

use calib_core::setting;

/// One value of the grid: a number (`1e-4`) or a name (`adam`).
#[derive(Debug, Clone, PartialEq)]
pub enum Setting {
    /// A number.
    Number(f64),
    /// A name.
    Name(String),
}

impl Setting {
    /// Returns the number, if it is one.
    pub const fn as_number(&self) -> Option<f64> {
        match self {
            Self::Number(value) => Some(*value),
            Self::Name(_) => None,
        }
    }
}

impl fmt::Display for Setting {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Number(value) => formatter.write_str(&setting(*value)),
            Self::Name(name) => formatter.write_str(name),
        }
    }
}

impl From<f64> for Setting {
    fn from(value: f64) -> Self {
        Self::Number(value)
    }
}

impl From<&str> for Setting {
    fn from(name: &str) -> Self {
        Self::Name(name.to_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_read_as_in_the_study_file() {
        assert_eq!(Setting::from(1e-4).to_string(), "1e-4");
        assert_eq!(Setting::from("adam").to_string(), "adam");
        assert_eq!(Setting::from("adam").as_number(), None);
    }
}
