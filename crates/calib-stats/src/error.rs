//! What can be wrong with the numbers.

/// Input that no statistic can be computed from.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum StatsError {
    /// There are no numbers.
    #[error("{what} is empty; expected at least one number")]
    Empty {
        /// Which input.
        what: &'static str,
    },
    /// One row of a table has another length than the first.
    #[error("row {row} of {what} has {got} numbers; expected {expected}, as in row 0")]
    Ragged {
        /// Which input.
        what: &'static str,
        /// Index of the offending row.
        row: usize,
        /// Length of row 0.
        expected: usize,
        /// Length found.
        got: usize,
    },
    /// Two inputs that belong together have different lengths.
    #[error("{what} has {got} numbers; expected {expected}, one for each of the other input")]
    LengthMismatch {
        /// Which input.
        what: &'static str,
        /// Length of the other input.
        expected: usize,
        /// Length found.
        got: usize,
    },
    /// A number is NaN.
    #[error("{what}[{index}] is NaN; expected a number, or an infinity for a diverged run")]
    NotANumber {
        /// Which input.
        what: &'static str,
        /// Index of the first NaN.
        index: usize,
    },
    /// +∞ and −∞ in one sample have no mean.
    #[error("{what} holds both infinities; expected infinities of one sign only")]
    OpposedInfinities {
        /// Which input.
        what: &'static str,
    },
    /// A value is infinite where only numbers make sense.
    #[error("{what}[{index}] is infinite; expected a finite number")]
    Infinite {
        /// Which input.
        what: &'static str,
        /// Index of the first infinity.
        index: usize,
    },
    /// A value is negative where none can be.
    #[error("{what}[{index}] is negative; expected 0 or more")]
    Negative {
        /// Which input.
        what: &'static str,
        /// Index of the first negative number.
        index: usize,
    },
    /// There are too few numbers.
    #[error("{what} has {got} numbers; expected at least {expected}")]
    TooShort {
        /// Which input.
        what: &'static str,
        /// Fewest numbers allowed.
        expected: usize,
        /// Numbers found.
        got: usize,
    },
    /// A length of segments that spectra cannot be taken of.
    #[error("segments of {got} samples have no spectrum here; expected a power of two from 4")]
    Segment {
        /// The length.
        got: usize,
    },
    /// An index points past the end.
    #[error("index {index} of {what} is out of range; expected less than {len}")]
    OutOfRange {
        /// Which input.
        what: &'static str,
        /// The index.
        index: usize,
        /// Length of the input.
        len: usize,
    },
    /// A number of streams that are worth an independent one, below one.
    #[error("{got} streams for an independent one make no sense; expected a number from 1")]
    EffectiveNumber {
        /// The number.
        got: f64,
    },
    /// Parts that weigh nothing together.
    #[error("the parts of a mean weigh {got} together; expected more than 0")]
    NoWeight {
        /// Their weight.
        got: f64,
    },
    /// A probability outside [0, 1].
    #[error("probability {got} is out of range; expected 0 to 1")]
    Probability {
        /// The probability.
        got: f64,
    },
}

/// Checks that `values` is not empty and holds no NaN.
pub(crate) fn check(what: &'static str, values: &[f64]) -> Result<(), StatsError> {
    if values.is_empty() {
        return Err(StatsError::Empty { what });
    }
    match values.iter().position(|value| value.is_nan()) {
        Some(index) => Err(StatsError::NotANumber { what, index }),
        None => Ok(()),
    }
}

/// Checks both of a pair of inputs, and that they are equally long.
pub(crate) fn check_pair(
    (what_x, x): (&'static str, &[f64]),
    (what_y, y): (&'static str, &[f64]),
) -> Result<(), StatsError> {
    check(what_x, x)?;
    check_length(what_y, y.len(), x.len())?;
    check(what_y, y)
}

/// Checks that there are as many of `what` as of what it belongs to.
pub(crate) fn check_length(
    what: &'static str,
    got: usize,
    expected: usize,
) -> Result<(), StatsError> {
    if got == expected { Ok(()) } else { Err(StatsError::LengthMismatch { what, expected, got }) }
}
