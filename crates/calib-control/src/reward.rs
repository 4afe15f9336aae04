use std::fmt;

use schemars::JsonSchema;
use serde::{
    Deserialize, Deserializer, Serialize,
    de::{Error, SeqAccess, Visitor, value::SeqAccessDeserializer},
};

use crate::ControlError;

/// The reward of a step, from what was recorded in the row that it led to.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
#[serde(untagged)]
pub enum Reward {
    /// A column that holds it.
    Column(String),
    /// The sum of terms.
    Terms(Vec<Term>),
}

/// Written by hand because serde's untagged enumerations do not say what is wrong with a value.
impl<'de> Deserialize<'de> for Reward {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct ColumnOrTerms;
        impl<'de> Visitor<'de> for ColumnOrTerms {
            type Value = Reward;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str(
                    "the name of a column, or a list of terms such as [{ column = \"flow\", weight = 1 }]",
                )
            }

            fn visit_str<E: Error>(self, column: &str) -> Result<Reward, E> {
                Ok(Reward::Column(column.to_owned()))
            }

            fn visit_seq<A: SeqAccess<'de>>(self, terms: A) -> Result<Reward, A::Error> {
                Vec::deserialize(SeqAccessDeserializer::new(terms)).map(Reward::Terms)
            }
        }
        deserializer.deserialize_any(ColumnOrTerms)
    }
}

impl Default for Reward {
    fn default() -> Self {
        Self::Column("reward".to_owned())
    }
}

/// A term of a reward: `weight` times the column, or how far the column is from its set-point, or outside its limits.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Term {
    /// The column, in its own units.
    pub column: String,
    /// Reward a unit; negative for what costs (default 1).
    #[serde(default = "one")]
    pub weight: f64,
    /// Then the distance |x − `set_point`| counts, not x.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub set_point: Option<f64>,
    /// Then only what is below counts: `low` − x.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub low: Option<f64>,
    /// Then only what is above counts: x − `high`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub high: Option<f64>,
}

fn one() -> f64 {
    1.0
}

impl Term {
    /// What the term adds for the value `x` of its column.
    pub fn of(&self, x: f64) -> f64 {
        let counted = match (self.set_point, self.low, self.high) {
            (Some(set_point), ..) => (x - set_point).abs(),
            (None, None, None) => x,
            (None, low, high) => {
                let below = low.map_or(0.0, |low| (low - x).max(0.0));
                below + high.map_or(0.0, |high| (x - high).max(0.0))
            }
        };
        // A missing value is no reward of nought.
        if x.is_nan() { f64::NAN } else { self.weight * counted }
    }
}

impl Reward {
    /// The columns that it is made of.
    pub fn columns(&self) -> impl Iterator<Item = &String> {
        let (column, terms) = match self {
            Self::Column(column) => (Some(column), &[][..]),
            Self::Terms(terms) => (None, &terms[..]),
        };
        column.into_iter().chain(terms.iter().map(|term| &term.column))
    }

    /// The reward of every row from the values of columns by name; NaN where a value is missing.
    pub fn of(&self, rows: usize, column: impl Fn(&str) -> Vec<f64>) -> Vec<f32> {
        let mut sums = vec![0.0; rows];
        let mut add = |term: &Term| {
            for (sum, value) in sums.iter_mut().zip(column(&term.column)) {
                *sum += term.of(value);
            }
        };
        match self {
            Self::Column(name) => {
                let column = name.clone();
                add(&Term { column, weight: 1.0, set_point: None, low: None, high: None });
            }
            Self::Terms(terms) => terms.iter().for_each(add),
        }
        sums.into_iter().map(|sum| sum as f32).collect()
    }

    /// Check that there is a term, that numbers are finite, and that no term has a set-point and limits.
    pub(crate) fn check(&self) -> Result<(), ControlError> {
        let Self::Terms(terms) = self else { return Ok(()) };
        if terms.is_empty() {
            return Err(ControlError::EmptyReward);
        }
        for term in terms {
            let numbers = [Some(term.weight), term.set_point, term.low, term.high];
            if let Some(got) = numbers.into_iter().flatten().find(|number| !number.is_finite()) {
                let expected = "finite numbers";
                return Err(ControlError::Field { field: "reward", got, expected });
            }
            if let (Some(got), Some(_)) = (term.set_point, term.low.or(term.high)) {
                let expected = "either a set-point or limits in one term; write two terms";
                return Err(ControlError::Field { field: "reward.set_point", got, expected });
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn term(set_point: Option<f64>, low: Option<f64>, high: Option<f64>) -> Term {
        Term { column: "x".to_owned(), weight: -2.0, set_point, low, high }
    }

    #[test]
    fn terms_are_their_formulas() {
        assert_eq!(term(None, None, None).of(3.0), -6.0);
        assert_eq!(term(Some(5.0), None, None).of(3.0), -4.0);
        let limits = term(None, Some(1.0), Some(2.0));
        assert_eq!([0.5, 1.5, 4.0].map(|x| limits.of(x)), [-1.0, 0.0, -4.0]);
        assert!(limits.of(f64::NAN).is_nan());
    }

    #[test]
    fn terms_add_up_row_by_row() {
        let reward = Reward::Terms(vec![term(None, None, None), term(None, None, Some(2.0))]);
        let rewards = reward.of(3, |_| vec![1.0, 4.0, f64::NAN]);
        assert_eq!(rewards[..2], [-2.0, -12.0]);
        assert!(rewards[2].is_nan());
        assert_eq!(Reward::Column("x".to_owned()).of(2, |_| vec![7.0, 8.0]), [7.0, 8.0]);
    }

    #[test]
    fn what_means_two_things_is_refused() {
        let both = Reward::Terms(vec![term(Some(1.0), None, Some(2.0))]);
        assert!(both.check().expect_err("both").to_string().contains("two terms"));
        assert!(Reward::Terms(vec![]).check().is_err());
        assert!(Reward::Terms(vec![term(None, Some(f64::NAN), None)]).check().is_err());
    }
}
