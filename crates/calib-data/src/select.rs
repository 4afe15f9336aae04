//! Decides which channels become sensors of the states, and why the others do not.

use std::fmt;

use calib_core::{Bounds, exact};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{
    Normalisation, PreprocessConfig,
    channel::{Moments, is_same, quantile},
    text::Switch,
};

/// Why a channel is not a sensor of the states.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum DropReason {
    /// It is not in `data.include`.
    NotIncluded,
    /// It matches `data.exclude`.
    Excluded {
        /// The name or pattern.
        pattern: String,
    },
    /// Its type cannot hold numbers.
    WrongType {
        /// The type.
        type_name: String,
    },
    /// It holds text that is never a number.
    Text,
    /// It has no value in the training range.
    AllMissing,
    /// Too many of its values are missing in the training range.
    Missing {
        /// Fraction of the training rows without a value.
        fraction: f64,
        /// `preprocess.max_missing`.
        limit: f64,
    },
    /// It never changes in the training range.
    Constant {
        /// Its value.
        value: f64,
        /// The word that is read as this value. Default: it is recorded as a number.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        word: Option<String>,
    },
    /// The values that normalisation maps to 0 and 1 are equal, or too far apart to represent.
    NoSpread {
        /// The value that would map to 0.
        low: f64,
        /// The value that would map to 1.
        high: f64,
    },
    /// It was replaced by one 0/1 column for each of its values.
    OneHot {
        /// Names of these columns. Default: not known.
        #[serde(default)]
        columns: Vec<String>,
    },
}

impl DropReason {
    /// Adds the word that `switch` reads as the value of a constant channel.
    pub(crate) fn with_word(self, switch: Option<&Switch>) -> Self {
        match self {
            Self::Constant { value, word: None } => {
                let word = switch.and_then(|switch| switch.word(value)).map(str::to_owned);
                Self::Constant { value, word }
            }
            other => other,
        }
    }
}

impl fmt::Display for DropReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotIncluded => f.write_str("not in data.include"),
            Self::Excluded { pattern } => write!(f, "excluded by {pattern:?}"),
            Self::WrongType { type_name } => write!(f, "of type {type_name}, not numbers"),
            Self::Text => f.write_str("text, not numbers"),
            Self::AllMissing => f.write_str("no value in the training range"),
            Self::Missing { fraction, limit } => write!(
                f,
                "{:.1} % missing in the training range, more than preprocess.max_missing = {limit}",
                fraction * 100.0
            ),
            Self::Constant { value, word: None } => {
                write!(f, "constant at {} in the training range", exact(*value))
            }
            Self::Constant { value, word: Some(word) } => {
                write!(f, "constant at {word} (read as {}) in the training range", exact(*value))
            }
            Self::NoSpread { low, high } => {
                write!(f, "its normalisation range is from {} to {}", exact(*low), exact(*high))
            }
            Self::OneHot { columns } => {
                write!(f, "read as a column of 0 and 1 for each value: {}", columns.join(", "))
            }
        }
    }
}

/// Returns the normalisation of a channel with these values, or the reason to drop it. It is fitted only on
/// the recorded values of the training rows: `values` and `moments` belong to them.
pub(crate) fn fit(
    values: &[f64],
    moments: Option<Moments>,
    has_words: bool,
    preprocess: &PreprocessConfig,
) -> Result<Bounds, DropReason> {
    let Some(moments) = moments else {
        return Err(if has_words { DropReason::Text } else { DropReason::AllMissing });
    };
    let fraction = 1.0 - moments.count as f64 / values.len() as f64;
    if fraction > preprocess.max_missing {
        let limit = preprocess.max_missing;
        return Err(DropReason::Missing { fraction, limit });
    }
    if is_same(moments.min, moments.max) {
        return Err(DropReason::Constant { value: moments.min, word: None });
    }
    let (offset, scale) = match preprocess.normalise {
        Normalisation::Standard => (moments.mean, moments.std()),
        Normalisation::MinMax => (moments.min, moments.max - moments.min),
        Normalisation::Quantile => {
            let mut values = values.to_vec();
            let [low, high] = preprocess.quantiles.map(|q| quantile(&mut values, q));
            (low, high - low)
        }
    };
    // The states are f32: a scale below their range would make all of them infinite.
    if scale > 0.0 && scale.is_finite() {
        Ok(Bounds { offset, scale })
    } else {
        Err(DropReason::NoSpread { low: offset, high: offset + scale })
    }
}

#[cfg(test)]
mod tests {
    use std::ops::Range;

    use super::*;

    const NAN: f64 = f64::NAN;

    fn fitted(
        values: &[f64],
        train: Range<usize>,
        preprocess: &PreprocessConfig,
    ) -> Result<Bounds, DropReason> {
        let values = &values[train];
        fit(values, Moments::of(values), false, preprocess)
    }

    fn constant(value: f64) -> DropReason {
        DropReason::Constant { value, word: None }
    }

    #[test]
    fn a_constant_switch_is_told_with_its_word() {
        let switch = Switch::of(["RUN"].into_iter());
        let reason = constant(1.0).with_word(switch.as_ref());
        assert_eq!(reason.to_string(), "constant at RUN (read as 1) in the training range");
        assert_eq!(constant(1.0).with_word(None), constant(1.0));
    }

    fn told(value: f64) -> String {
        constant(value).to_string()
    }

    #[test]
    fn values_of_single_precision_are_told_with_its_digits() {
        assert_eq!(told(f64::from(0.85_f32)), "constant at 0.85 in the training range");
        assert_eq!(told(0.85), "constant at 0.85 in the training range");
        assert_eq!(told(1.0 / 3.0), "constant at 0.3333333333333333 in the training range");
        let spread = DropReason::NoSpread { low: f64::from(0.1_f32), high: f64::from(0.1_f32) };
        assert_eq!(spread.to_string(), "its normalisation range is from 0.1 to 0.1");
    }

    #[test]
    fn channels_are_dropped_with_a_reason() {
        let preprocess = PreprocessConfig { max_missing: 0.25, ..PreprocessConfig::default() };
        let [one_value, nothing] = [[2.0, NAN, 2.0, 2.0, 5.0], [NAN, NAN, NAN, NAN, 5.0]]
            .map(|values| fitted(&values, 0..4, &preprocess).expect_err("dropped"));
        assert_eq!(one_value, constant(2.0));
        assert_eq!(nothing, DropReason::AllMissing);
        let noise = [0.05, 0.050_000_000_000_000_01, 0.05, 0.05];
        let noise = fitted(&noise, 0..4, &preprocess).expect_err("dropped");
        assert_eq!(noise, constant(0.05), "as a controller writes 0.05");
        let missing = fitted(&[1.0, NAN, NAN, 2.0], 0..4, &preprocess).expect_err("dropped");
        assert_eq!(
            missing.to_string(),
            "50.0 % missing in the training range, more than preprocess.max_missing = 0.25"
        );
        assert!(fitted(&[1.0, NAN, 3.0, 2.0], 0..4, &preprocess).is_ok());
        let text = fit(&[NAN; 4], None, true, &preprocess).expect_err("dropped");
        assert_eq!(text, DropReason::Text);
        let quantile = PreprocessConfig {
            normalise: Normalisation::Quantile,
            quantiles: [0.05, 0.5],
            ..preprocess
        };
        let mut spike = vec![0.0; 100];
        spike[99] = 1.0;
        let reason = fitted(&spike, 0..100, &quantile).expect_err("dropped");
        assert_eq!(reason, DropReason::NoSpread { low: 0.0, high: 0.0 });
    }
}
