//! Conversion between patterns and their names.

use std::{fmt, str::FromStr};

use super::{RabinerJuangType, SlopeWeighting, Smoothing, StepPattern};

/// An unknown step pattern name.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "unknown step pattern `{name}`: expected symmetric1, symmetric2, asymmetric, \
     symmetricP0|P05|P1|P2, asymmetricP0|P05|P1|P2, or rabinerJuang:TYPE with a type 1 to 7, \
     a slope weighting a to d and optionally `:smoothed`, such as rabinerJuang:6c"
)]
pub struct ParsePatternError {
    /// The name that was given.
    pub name: String,
}

const NAMED: [fn() -> StepPattern; 11] = [
    StepPattern::symmetric1,
    StepPattern::symmetric2,
    StepPattern::asymmetric,
    StepPattern::symmetric_p0,
    StepPattern::symmetric_p05,
    StepPattern::symmetric_p1,
    StepPattern::symmetric_p2,
    StepPattern::asymmetric_p0,
    StepPattern::asymmetric_p05,
    StepPattern::asymmetric_p1,
    StepPattern::asymmetric_p2,
];

impl StepPattern {
    /// Returns every named pattern: 11 common ones, then 56 of Rabiner and Juang.
    pub fn all() -> impl Iterator<Item = Self> {
        let rabiner_juang = RabinerJuangType::ALL.into_iter().flat_map(|kind| {
            SlopeWeighting::ALL.into_iter().flat_map(move |weighting| {
                [Smoothing::Plain, Smoothing::Smoothed]
                    .map(|smoothing| Self::rabiner_juang(kind, weighting, smoothing))
            })
        });
        NAMED.into_iter().map(|make| make()).chain(rabiner_juang)
    }
}

impl fmt::Display for StepPattern {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

impl FromStr for StepPattern {
    type Err = ParsePatternError;

    /// Returns the pattern with this name, ignoring case.
    fn from_str(name: &str) -> Result<Self, Self::Err> {
        Self::all()
            .find(|pattern| pattern.name().eq_ignore_ascii_case(name.trim()))
            .ok_or_else(|| ParsePatternError { name: name.to_owned() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_name_reads_back_as_its_pattern() {
        let all: Vec<_> = StepPattern::all().collect();
        assert_eq!(all.len(), 67);
        for pattern in all {
            assert_eq!(pattern.to_string().parse::<StepPattern>().unwrap(), pattern);
        }
        assert_eq!("rabinerjuang:6C".parse::<StepPattern>().unwrap().name(), "rabinerJuang:6c");
    }

    #[test]
    fn an_unknown_name_lists_the_known_ones() {
        for name in ["symmetric3", "rabinerJuang:8c", "rabinerJuang:6e", ""] {
            let message = name.parse::<StepPattern>().unwrap_err().to_string();
            assert!(message.starts_with(&format!("unknown step pattern `{name}`")));
            assert!(message.contains("symmetric2"));
        }
    }
}
