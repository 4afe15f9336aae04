//! What can be wrong with a pair of series, and why a pair may have no path.

use std::fmt;

use crate::{Normalisation, Role, StepPattern, Window};

/// Why there is no distance.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum DtwError {
    /// A series has no samples.
    #[error("the {role} is empty: expected at least one sample")]
    Empty {
        /// Which series.
        role: Role,
    },
    /// A value is NaN or infinite.
    #[error(
        "sample {index}, channel {channel} of the {role} is {got}: expected finite values; \
         fill or drop missing samples first"
    )]
    NotFinite {
        /// Which series.
        role: Role,
        /// Number of the sample, from 0.
        index: usize,
        /// Number of the channel, from 0.
        channel: usize,
        /// The value.
        got: f64,
    },
    /// The values do not fill whole samples.
    #[error("{got} values are no whole number of samples of {channels} channels")]
    Shape {
        /// Number of values.
        got: usize,
        /// Channels asked for.
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
    /// An open begin was asked for with a pattern whose normalisation depends on the begin.
    #[error(
        "step pattern `{pattern}` cannot have an open begin: that needs a pattern normalised by \
         the query's length, such as asymmetric or rabinerJuang:6c"
    )]
    OpenBegin {
        /// The pattern's name.
        pattern: String,
        /// Its normalisation.
        normalisation: Normalisation,
    },
    /// A price of the time warp edit distance is negative, infinite or NaN.
    #[error(
        "the {name} of the time warp edit distance is {got}: expected a finite number, 0 or more"
    )]
    Price {
        /// Which price.
        name: &'static str,
        /// The number.
        got: f64,
    },
    /// No path is admissible.
    #[error(transparent)]
    NoPath(#[from] NoPath),
    /// Nobody waits for the result any more.
    #[error("stopped")]
    Stopped,
    /// There is no room for the path.
    #[error(
        "cannot allocate memory for a path of up to {cells} samples; shorten the series, or ask for the distance alone"
    )]
    Memory {
        /// Its longest length.
        cells: usize,
    },
    /// The processor lacks the instruction set asked for.
    #[error("this processor does not have the {instruction_set} instructions")]
    Unsupported {
        /// Name of the instruction set.
        instruction_set: &'static str,
    },
}

/// No warping path is admissible for a pair of lengths: slope limits or window forbid all.
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

    /// Fewest and most reference samples the slope limits allow for closed ends; the most is
    /// `None` where nothing limits it.
    pub fn reference_limits(&self) -> (usize, Option<usize>) {
        let steps = (self.query - 1) as f64;
        // A hair of tolerance, because slopes such as 1/3 are rounded.
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
