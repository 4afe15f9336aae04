//! Refusals of options that are outside their ranges.

use std::ops::RangeInclusive;

/// An option outside its range.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum OptionsError {
    /// A number outside the range of its field.
    #[error("`{field}` is {}, expected a number {expected}", in_short(*.got))]
    OutOfRange {
        /// Name of the field.
        field: &'static str,
        /// The value.
        got: f64,
        /// The range, in words.
        expected: String,
    },
    /// The plant would run past the year 2200 or begin before 1900.
    #[error(
        "`start` is {start_micros} microseconds after 1970, expected the plant to run between 1900 and 2200"
    )]
    Calendar {
        /// The start, in microseconds since the epoch.
        start_micros: i64,
    },
}

pub(crate) fn within(
    field: &'static str,
    got: f64,
    range: RangeInclusive<f64>,
) -> Result<(), OptionsError> {
    if range.contains(&got) {
        return Ok(());
    }
    let low = range.start();
    let high = range.end();
    let expected = if *low == f64::MIN_POSITIVE {
        format!("above 0 and up to {high}")
    } else {
        format!("from {low} to {high}")
    };
    Err(OptionsError::OutOfRange { field, got, expected })
}

/// Formats with an exponent where plain digits would be hundreds of characters.
fn in_short(number: f64) -> String {
    let digits = number.to_string();
    if digits.len() > 20 { format!("{number:e}") } else { digits }
}
