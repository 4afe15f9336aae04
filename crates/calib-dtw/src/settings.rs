//! The settings of a distance besides the step pattern: local distance, window, ends.

use std::{fmt, str::FromStr};

use crate::Window;

/// The distance between one sample of the query and one of the reference.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum LocalDistance {
    /// |x − y|, summed over the channels.
    #[default]
    Absolute,
    /// (x − y)², summed over the channels.
    Squared,
    /// √Σ(x − y)², the sum over the channels; |x − y| for one channel.
    Euclidean,
}

impl LocalDistance {
    /// Returns the local distance of two samples with the same number of channels.
    pub fn between(self, x: &[f64], y: &[f64]) -> f64 {
        let differences = x.iter().zip(y).map(|(x, y)| x - y);
        match self {
            Self::Absolute => differences.map(f64::abs).fold(0.0, |sum, d| sum + d),
            Self::Squared => differences.map(|d| d * d).fold(0.0, |sum, d| sum + d),
            Self::Euclidean if x.len() == 1 => (x[0] - y[0]).abs(),
            Self::Euclidean => differences.map(|d| d * d).fold(0.0, |sum, d| sum + d).sqrt(),
        }
    }

    /// Returns an upper bound over all pairs of samples whose values differ by at most `spread`.
    pub(crate) fn at_most(self, spread: f64, channels: usize) -> f64 {
        match self {
            Self::Absolute => spread * channels as f64,
            // The Euclidean distance computes squares first, so this sum must be finite too.
            Self::Squared | Self::Euclidean => spread * spread * channels as f64,
        }
    }
}

/// The ends of the reference that may be left unmatched. The whole query is always matched.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Ends {
    /// The first samples match each other, and so do the last.
    #[default]
    Closed,
    /// The path may end at any reference sample. The end with the smallest normalised distance is
    /// chosen: the raw distance if the pattern has no normalisation, and the earliest of equals.
    OpenEnd,
    /// The path may begin at any reference sample.
    /// Needs a pattern normalised by the query's length.
    OpenBegin,
    /// The path may begin and end at any reference sample: the query is searched anywhere in the
    /// reference.
    OpenBoth,
}

impl Ends {
    /// Whether the path may begin at any reference sample.
    pub fn open_begin(self) -> bool {
        matches!(self, Self::OpenBegin | Self::OpenBoth)
    }

    /// Whether the path may end at any reference sample.
    pub fn open_end(self) -> bool {
        matches!(self, Self::OpenEnd | Self::OpenBoth)
    }
}

/// Local distance, window and ends. The default is |x − y|, no window, closed ends.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Settings {
    /// Distance between two samples.
    pub local_distance: LocalDistance,
    /// Cells a path may visit.
    pub window: Window,
    /// Ends of the reference that may be left unmatched.
    pub ends: Ends,
}

/// A text that is not the name of a local distance or of ends.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("unknown {what} `{text}`: expected {expected}")]
pub struct ParseSettingError {
    /// The kind of setting.
    pub what: &'static str,
    /// The text that was given.
    pub text: String,
    /// The valid names.
    pub expected: &'static str,
}

/// Implements conversion between the variants of a setting and their names, ignoring case.
macro_rules! names {
    ($type:ident, $what:literal, $expected:literal: $($name:literal => $variant:ident),+) => {
        impl fmt::Display for $type {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.pad(match self {
                    $(Self::$variant => $name),+
                })
            }
        }

        impl FromStr for $type {
            type Err = ParseSettingError;

            fn from_str(text: &str) -> Result<Self, Self::Err> {
                match text.trim() {
                    $(name if name.eq_ignore_ascii_case($name) => Ok(Self::$variant),)+
                    _ => Err(ParseSettingError {
                        what: $what,
                        text: text.to_owned(),
                        expected: $expected,
                    }),
                }
            }
        }
    };
}

names! {
    LocalDistance, "local distance", "absolute, squared or euclidean":
    "absolute" => Absolute, "squared" => Squared, "euclidean" => Euclidean
}

names! {
    Ends, "ends", "closed, openEnd, openBegin or openBoth":
    "closed" => Closed, "openEnd" => OpenEnd, "openBegin" => OpenBegin, "openBoth" => OpenBoth
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_read_back() {
        for ends in [Ends::Closed, Ends::OpenEnd, Ends::OpenBegin, Ends::OpenBoth] {
            assert_eq!(ends.to_string().parse::<Ends>().unwrap(), ends);
        }
        for local in [LocalDistance::Absolute, LocalDistance::Squared, LocalDistance::Euclidean] {
            assert_eq!(local.to_string().parse::<LocalDistance>().unwrap(), local);
        }
        assert_eq!(
            "open".parse::<Ends>().unwrap_err().to_string(),
            "unknown ends `open`: expected closed, openEnd, openBegin or openBoth"
        );
    }

    /// Returns the distance between two samples of two channels, 3 and 4 apart.
    fn distance_by(local: LocalDistance) -> f64 {
        local.between(&[0.0, 1.0], &[3.0, 5.0])
    }

    #[test]
    fn local_distances_of_two_channels() {
        assert_eq!(distance_by(LocalDistance::Absolute), 7.0);
        assert_eq!(distance_by(LocalDistance::Squared), 25.0);
        assert_eq!(distance_by(LocalDistance::Euclidean), 5.0);
    }
}
