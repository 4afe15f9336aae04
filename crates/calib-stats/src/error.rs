//! Errors about input numbers.

/// Input that no statistic can be computed from.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum StatsError {
    /// The input is empty.
    #[error("{what} is empty; expected at least one number")]
    Empty {
        /// Name of the input.
        what: &'static str,
    },
    /// A row of a table has another length than the first.
    #[error("row {row} of {what} has {got} numbers; expected {expected}, as in row 0")]
    Ragged {
        /// Name of the input.
        what: &'static str,
        /// Index of the offending row.
        row: usize,
        /// Length of row 0.
        expected: usize,
        /// Actual length.
        got: usize,
    },
    /// Two inputs that belong together have different lengths.
    #[error("{what} has {got} numbers; expected {expected}, one for each of the other input")]
    LengthMismatch {
        /// Name of the input.
        what: &'static str,
        /// Length of the other input.
        expected: usize,
        /// Actual length.
        got: usize,
    },
    /// A number is NaN.
    #[error("{what}[{index}] is NaN; expected a number, or an infinity for a diverged run")]
    NotANumber {
        /// Name of the input.
        what: &'static str,
        /// Index of the first NaN.
        index: usize,
    },
    /// +∞ and −∞ in one sample have no mean.
    #[error("{what} holds both infinities; expected infinities of one sign only")]
    OpposedInfinities {
        /// Name of the input.
        what: &'static str,
    },
    /// A value is infinite where only finite numbers are permitted.
    #[error("{what}[{index}] is infinite; expected a finite number")]
    Infinite {
        /// Name of the input.
        what: &'static str,
        /// Index of the first infinity.
        index: usize,
    },
    /// A value is negative where only non-negative numbers are
    /// permitted.
    #[error("{what}[{index}] is negative; expected 0 or more")]
    Negative {
        /// Name of the input.
        what: &'static str,
        /// Index of the first negative number.
        index: usize,
    },
    /// There are too few numbers.
    #[error("{what} has {got} numbers; expected at least {expected}")]
    TooShort {
        /// Name of the input.
        what: &'static str,
        /// Minimum number of values.
        expected: usize,
        /// Actual number of values.
        got: usize,
    },
    /// The length of a segment is not valid for a spectrum.
    #[error("segments of {got} samples have no spectrum here; expected a power of two from 4")]
    Segment {
        /// The length.
        got: usize,
    },
    /// An index points past the end.
    #[error("index {index} of {what} is out of range; expected less than {len}")]
    OutOfRange {
        /// Name of the input.
        what: &'static str,
        /// The index.
        index: usize,
        /// Length of the input.
        len: usize,
    },
    /// The number of streams per independent stream is below one.
    #[error("{got} streams for an independent one make no sense; expected a number from 1")]
    EffectiveNumber {
        /// The number.
        got: f64,
    },
    /// The parts have no weight in total.
    #[error("the parts of a mean weigh {got} together; expected more than 0")]
    NoWeight {
        /// Their total weight.
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

/// Checks that an input has the expected length.
pub(crate) fn check_length(
    what: &'static str,
    got: usize,
    expected: usize,
) -> Result<(), StatsError> {
    if got == expected { Ok(()) } else { Err(StatsError::LengthMismatch { what, expected, got }) }
}
