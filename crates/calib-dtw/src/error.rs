//! Errors of a pair of series, and why a pair may have no path.

use std::fmt;

use crate::{Normalisation, Role, StepPattern, Window};

/// The reason why a distance cannot be computed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum DtwError {
    /// A series has no samples.
    #[error("the {role} is empty: expected at least one sample")]
    Empty {
        /// The series without samples.
        role: Role,
    },
    /// A value is NaN or infinite.
    #[error(
        "sample {index}, channel {channel} of the {role} is {got}: expected finite values; \
         fill or drop missing samples first"
    )]
    NotFinite {
        /// The series that contains the value.
        role: Role,
        /// Number of the sample, from 0.
        index: usize,
        /// Number of the channel, from 0.
        channel: usize,
        /// The value.
        got: f64,
    },
    /// The number of values is not a multiple of the channels.
    #[error("{got} values are no whole number of samples of {channels} channels")]
    Shape {
        /// Number of values.
        got: usize,
        /// Number of channels that was given.
        channels: usize,
    },
    /// The two series have different numbers of channels.
    #[error("the query has {query} channels, the reference {reference}: expected the same number")]
    Channels {
        /// Channels of the query.
        query: usize,
        /// Channels of the reference.
        reference: usize,
    },
    /// The values are so large that a cumulated distance could overflow.
    #[error(
        "values up to {largest:e} overflow when local distances are cumulated: scale the series down"
    )]
    TooLarge {
        /// Largest magnitude in either series.
        largest: f64,
    },
    /// An open begin was requested with a pattern whose normalisation depends on the begin.
    #[error(
        "step pattern `{pattern}` cannot have an open begin: that needs a pattern normalised by \
         the query's length, such as asymmetric or rabinerJuang:6c"
    )]
    OpenBegin {
        /// The pattern's name.
        pattern: String,
        /// The pattern's normalisation.
        normalisation: Normalisation,
    },
    /// A price of the time warp edit distance is negative, infinite or NaN.
    #[error(
        "the {name} of the time warp edit distance is {got}: expected a finite number, 0 or more"
    )]
    Price {
        /// Name of the price.
        name: &'static str,
        /// The price that was given.
        got: f64,
    },
    /// No path is admissible.
    #[error(transparent)]
    NoPath(#[from] NoPath),
    /// The caller stopped the computation.
    #[error("stopped")]
    Stopped,
    /// There is not enough memory for the path.
    #[error(
        "cannot allocate memory for a path of up to {cells} samples; shorten the series, or ask for the distance alone"
    )]
    Memory {
        /// Maximum length of the path, in samples.
        cells: usize,
    },
    /// The processor lacks the instruction set that was requested.
    #[error("this processor does not have the {instruction_set} instructions")]
    Unsupported {
        /// Name of the instruction set.
        instruction_set: &'static str,
    },
}

/// No warping path is admissible for this pair of lengths: the slope limits or the window exclude
/// all paths.
#[derive(Clone, Debug, PartialEq)]
pub struct NoPath {
    /// The pattern's name.
    pub pattern: String,
    /// Smallest and largest slope of the pattern, reference samples per query sample.
    pub slopes: (f64, f64),
    /// The window.
    pub window: Window,
    /// Samples of the query.
    pub query: usize,
    /// Samples of the reference.
    pub reference: usize,
}

impl NoPath {
    pub(crate) fn new(
        pattern: &StepPattern,
        window: Window,
        query: usize,
        reference: usize,
    ) -> Self {
        Self {
            pattern: pattern.name().to_owned(),
            slopes: pattern.slopes(),
            window,
            query,
            reference,
        }
    }

    /// Returns the minimum and maximum number of reference samples that the slope limits allow for
    /// closed ends. The maximum is `None` where nothing limits it.
    pub fn reference_limits(&self) -> (usize, Option<usize>) {
        let steps = (self.query - 1) as f64;
        // A small tolerance, because slopes such as 1/3 are rounded.
        let fewest = (steps * self.slopes.0 - 1e-9).ceil().max(0.0) as usize + 1;
        let most = match self.slopes.1 {
            slope if slope.is_infinite() => None,
            slope => Some((steps * slope + 1e-9).floor() as usize + 1),
        };
        (fewest, most)
    }
}

impl std::error::Error for NoPath {}

impl fmt::Display for NoPath {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (low, high) = self.slopes;
        let (fewest, most) = self.reference_limits();
        write!(
            f,
            "no admissible path for a query of {} and a reference of {} samples: step pattern \
             `{}` advances {low:.3} to {high:.3} reference samples a query sample, which for this \
             query allows ",
            self.query, self.reference, self.pattern
        )?;
        match most {
            Some(most) => write!(f, "references of {fewest} to {most} samples")?,
            None => write!(f, "references of {fewest} samples or more")?,
        }
        let within = self.reference >= fewest && most.is_none_or(|most| self.reference <= most);
        match self.window {
            Window::None if within => f.write_str(", but no combination of its steps fits these"),
            Window::None => {
                f.write_str("; use another step pattern or make the lengths more alike")
            }
            window => write!(f, "; the window {window} may forbid more: widen it"),
        }
    }
}
