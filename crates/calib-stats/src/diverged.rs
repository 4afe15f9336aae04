//! Serialisation of infinite scores. JSON has no infinities: +∞, the error of a diverged run, is written as
//! `null`, and −∞, the return of a diverged run, as `"-inf"`. Reading restores the infinities.

use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// A score as stored in a file: a number, null for +∞, or "-inf".
#[derive(Serialize, Deserialize, JsonSchema)]
#[schemars(rename = "Score")]
#[serde(untagged)]
pub enum Stored {
    /// A finite score.
    Finite(f64),
    /// The worst possible score: +∞ for an error, −∞ for a return.
    Worst(Option<Infinity>),
}

/// The return of a run that diverged.
#[derive(Serialize, Deserialize, JsonSchema)]
pub enum Infinity {
    /// −∞.
    #[serde(rename = "-inf")]
    Negative,
}

impl From<f64> for Stored {
    fn from(score: f64) -> Self {
        match score {
            f64::INFINITY => Self::Worst(None),
            f64::NEG_INFINITY => Self::Worst(Some(Infinity::Negative)),
            finite => Self::Finite(finite),
        }
    }
}

impl From<Stored> for f64 {
    fn from(stored: Stored) -> Self {
        match stored {
            Stored::Finite(score) => score,
            Stored::Worst(None) => f64::INFINITY,
            Stored::Worst(Some(Infinity::Negative)) => f64::NEG_INFINITY,
        }
    }
}

/// Writes a score.
///
/// # Errors
/// As the serialiser.
pub fn serialize<S: Serializer>(score: &f64, serializer: S) -> Result<S::Ok, S::Error> {
    Stored::from(*score).serialize(serializer)
}

/// Reads a score.
///
/// # Errors
/// If it is neither a number nor an infinity.
pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Ok(Stored::deserialize(deserializer)?.into())
}

/// Serialisation of an optional list of scores, one for each value of a grid.
pub mod each_if_known {
    use serde::{Deserialize as _, Deserializer, Serialize as _, Serializer};

    use super::Stored;

    /// Writes the scores.
    ///
    /// # Errors
    /// As the serialiser.
    pub fn serialize<S: Serializer>(
        scores: &Option<Vec<f64>>,
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        scores
            .as_ref()
            .map(|scores| -> Vec<Stored> {
                scores.iter().map(|&score| Stored::from(score)).collect()
            })
            .serialize(serializer)
    }

    /// Reads the scores.
    ///
    /// # Errors
    /// If one is neither a number nor an infinity.
    pub fn deserialize<'de, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<Option<Vec<f64>>, D::Error> {
        let stored = Option::<Vec<Stored>>::deserialize(deserializer)?;
        Ok(stored.map(|scores| scores.into_iter().map(f64::from).collect()))
    }
}

/// Serialisation of a list of scores, one for each value of a grid.
pub mod each {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    use super::Stored;

    /// Writes the scores.
    ///
    /// # Errors
    /// As the serialiser.
    pub fn serialize<S: Serializer>(scores: &[f64], serializer: S) -> Result<S::Ok, S::Error> {
        scores.iter().map(|&score| Stored::from(score)).collect::<Vec<_>>().serialize(serializer)
    }

    /// Reads the scores.
    ///
    /// # Errors
    /// If one is neither a number nor an infinity.
    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<f64>, D::Error> {
        Ok(Vec::<Stored>::deserialize(deserializer)?.into_iter().map(f64::from).collect())
    }
}

/// Serialisation of a table of scores, one row for each ensemble member.
pub mod rows {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    use super::Stored;

    /// Writes the scores.
    ///
    /// # Errors
    /// As the serialiser.
    pub fn serialize<S: Serializer>(rows: &[Vec<f64>], serializer: S) -> Result<S::Ok, S::Error> {
        rows.iter()
            .map(|row| row.iter().map(|&score| Stored::from(score)).collect())
            .collect::<Vec<Vec<Stored>>>()
            .serialize(serializer)
    }

    /// Reads the scores.
    ///
    /// # Errors
    /// If one is neither a number nor an infinity.
    pub fn deserialize<'de, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<Vec<Vec<f64>>, D::Error> {
        let rows = Vec::<Vec<Stored>>::deserialize(deserializer)?.into_iter();
        Ok(rows.map(|row| row.into_iter().map(f64::from).collect()).collect())
    }
}

#[cfg(test)]
mod tests {
    use crate::{Direction, Summary, select, summarise};

    #[test]
    fn diverged_summaries_survive_a_file() {
        for runs in [[0.25, 0.5], [0.25, f64::INFINITY], [f64::NEG_INFINITY, 3.0]] {
            let summary = summarise(&runs).unwrap();
            let text = serde_json::to_string(&summary).unwrap();
            let read: Summary = serde_json::from_str(&text).unwrap();
            assert_eq!((read.mean, read.diverged), (summary.mean, summary.diverged), "{text}");
        }
    }

    #[test]
    fn scores_that_may_be_unknown_survive_a_file() {
        #[derive(serde::Serialize, serde::Deserialize, PartialEq, Debug)]
        struct Of {
            #[serde(default, with = "super::each_if_known")]
            scores: Option<Vec<f64>>,
        }
        for scores in [None, Some(vec![0.5, f64::INFINITY])] {
            let text = serde_json::to_string(&Of { scores: scores.clone() }).unwrap();
            assert_eq!(serde_json::from_str::<Of>(&text).unwrap(), Of { scores }, "{text}");
        }
        assert_eq!(serde_json::from_str::<Of>("{}").unwrap().scores, None);
    }

    #[test]
    fn selections_with_diverged_values_survive_a_file() {
        let selection = select(&[[0.1, f64::INFINITY]], Direction::LowerIsBetter).unwrap();
        let text = serde_json::to_string(&selection).unwrap();
        assert!(text.contains("\"mean_errors\":[0.1,null]"), "{text}");
        assert_eq!(serde_json::from_str::<crate::Selection>(&text).unwrap(), selection);
    }
}
