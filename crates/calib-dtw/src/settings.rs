//! What, apart from the step pattern, defines a distance: local distance, window, ends.

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
    /// The local distance of two samples with the same number of channels.
    pub fn between(self, x: &[f64], y: &[f64]) -> f64 {
        let differences = x.iter().zip(y).map(|(x, y)| x - y);
        match self {
            Self::Absolute => differences.map(f64::abs).fold(0.0, |sum, d| sum + d),
            Self::Squared => differences.map(|d| d * d).fold(0.0, |sum, d| sum + d),
            Self::Euclidean if x.len() == 1 => (x[0] - y[0]).abs(),
            Self::Euclidean => differences.map(|d| d * d).fold(0.0, |sum, d| sum + d).sqrt(),
        }
    }

    /// An upper bound over all pairs of samples whose values differ by `spread` at most.
    pub(crate) fn at_most(self, spread: f64, channels: usize) -> f64 {
        match self {
            Self::Absolute => spread * channels as f64,
            // Euclidean squares on the way: the intermediate sum must be finite too.
            Self::Squared | Self::Euclidean => spread * spread * channels as f64,
        }
    }
}

/// Which ends of the reference may be left unmatched. The whole query is always matched.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Ends {
    /// First matches first, last matches last.
    #[default]
    Closed,
    /// The path may end at any reference sample: the one with the least normalised distance
    /// (raw where the pattern has no normalisation; the earliest of equals).
    OpenEnd,
    /// The path may begin at any reference sample.
    /// Needs a pattern normalised by the query's length.
    OpenBegin,
    /// Both: the query is looked for anywhere in the reference.
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
    /// Distance of one sample to one other.
    pub local_distance: LocalDistance,
    /// Cells a path may visit.
    pub window: Window,
    /// Ends of the reference that may be left unmatched.
    pub ends: Ends,
}
