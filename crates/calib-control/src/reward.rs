use std::{borrow::Cow, fmt, ops::Range};

use calib_core::Segments;
use schemars::JsonSchema;
use serde::{
    Deserialize, Deserializer, Serialize,
    de::{Error, SeqAccess, Visitor, value::SeqAccessDeserializer},
};

use crate::{ControlError, log::episodes};

/// The reward of a step, computed from the row that it led to.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
#[serde(untagged)]
pub enum Reward {
    /// A column that holds the reward.
    Column(String),
    /// The sum of terms.
    Terms(Vec<Term>),
}

/// Written by hand because serde's untagged enumerations do not report what is wrong with a value.
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

/// A term of a reward: `weight` times one of these: the column, its distance from the set-point, its distance outside the limits, or its
/// change.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Term {
    /// Name of the column, in its own units.
    pub column: String,
    /// Reward per unit; negative for costs (default 1).
    #[serde(default = "one")]
    pub weight: f64,
    /// If given, the distance |x − `set_point`| counts instead of x. It is a number, or the column that holds the set-point of each row.
    /// For an action column, it is the set-point of the row before, by which the step was made.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub set_point: Option<SetPoint>,
    /// If given, only values below it count: `low` − x.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub low: Option<f64>,
    /// If given, only values above it count: x − `high`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub high: Option<f64>,
    /// If true, the change |x − x of the row before| counts instead of x. For an action column it is the change from the step before, and
    /// the first step of an episode has none (default false).
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub change: bool,
    /// Power of the counted amount: 1, or 2 for its square (default 1).
    #[serde(default = "linear", skip_serializing_if = "is_linear")]
    pub power: u8,
}

fn one() -> f64 {
    1.0
}

fn linear() -> u8 {
    1
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde wants a reference")]
fn is_linear(power: &u8) -> bool {
    *power == linear()
}

/// The set-point of a column.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
#[serde(untagged)]
pub enum SetPoint {
    /// A constant, in the unit of the term's column.
    Number(f64),
    /// A column that holds the set-point in the same row; for an action column, in the row before.
    Column(String),
}

/// Written by hand because serde's untagged enumerations do not report what is wrong with a value.
impl<'de> Deserialize<'de> for SetPoint {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct NumberOrColumn;
        impl Visitor<'_> for NumberOrColumn {
            type Value = SetPoint;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a number or the name of a column")
            }

            fn visit_f64<E: Error>(self, number: f64) -> Result<SetPoint, E> {
                Ok(SetPoint::Number(number))
            }

            fn visit_i64<E: Error>(self, number: i64) -> Result<SetPoint, E> {
                Ok(SetPoint::Number(number as f64))
            }

            fn visit_u64<E: Error>(self, number: u64) -> Result<SetPoint, E> {
                Ok(SetPoint::Number(number as f64))
            }

            fn visit_str<E: Error>(self, column: &str) -> Result<SetPoint, E> {
                Ok(SetPoint::Column(column.to_owned()))
            }
        }
        deserializer.deserialize_any(NumberOrColumn)
    }
}

/// The recorded columns from which a reward is computed.
#[derive(Clone, Copy, Debug)]
pub struct RewardColumns<'a> {
    /// Names of the columns.
    pub names: &'a [String],
    /// `[names][rows]`, in the unit of each column; NaN where a value is missing.
    pub values: &'a [Vec<f64>],
    /// Number of columns of actions, which come first.
    pub actions: usize,
}

impl RewardColumns<'_> {
    fn place(&self, name: &str) -> usize {
        let place = self.names.iter().position(|other| other == name);
        place.unwrap_or_else(|| unreachable!("every column of a reward is read: {name}"))
    }

    fn rows(&self) -> usize {
        self.values.first().map_or(0, Vec::len)
    }

    fn is_action(&self, place: usize) -> bool {
        place < self.actions
    }

    /// Returns the value of a column that the reward of `row` uses. For most columns it is the value in `row`. For an action it is
    /// the value in the row before, because that action made the step to `row`; the first row has none.
    fn seen(&self, place: usize, row: usize) -> f64 {
        self.seen_row(place, row).map_or(f64::NAN, |seen| self.values[place][seen])
    }

    /// Returns the row whose value of a column the reward of `row` uses.
    fn seen_row(&self, place: usize, row: usize) -> Option<usize> {
        if self.is_action(place) { row.checked_sub(1) } else { Some(row) }
    }
}

impl Term {
    /// Returns a term that is the value of a column.
    fn plain(column: &str) -> Self {
        Self {
            column: column.to_owned(),
            weight: one(),
            set_point: None,
            low: None,
            high: None,
            change: false,
            power: linear(),
        }
    }

    /// Returns the columns that the term uses.
    fn columns(&self) -> impl Iterator<Item = &String> {
        std::iter::once(&self.column).chain(self.set_point_column())
    }

    /// Returns the column that holds the set-point, if there is one.
    pub fn set_point_column(&self) -> Option<&String> {
        match &self.set_point {
            Some(SetPoint::Column(column)) => Some(column),
            Some(SetPoint::Number(_)) | None => None,
        }
    }

    /// Returns whether the term is the change of an action.
    fn is_change_of_action(&self, columns: &RewardColumns<'_>) -> bool {
        self.change && columns.is_action(columns.place(&self.column))
    }

    /// Adds the term to the rewards of `rows`. It uses no value before these rows.
    fn add(&self, columns: &RewardColumns<'_>, rows: Range<usize>, rewards: &mut [f64]) {
        let place = columns.place(&self.column);
        let set_point_place = self.set_point_column().map(|column| columns.place(column));
        let first = rows.start;
        // A change has no value in the first row, which has no row before it.
        for row in rows.skip(usize::from(self.change)) {
            let target = match (&self.set_point, set_point_place) {
                _ if self.change => {
                    // The first step of an episode has no step before it, so its action counts as unchanged.
                    let before = columns.seen_row(place, row).map(|seen| seen.max(first + 1) - 1);
                    before.map(|before| columns.values[place][before])
                }
                (Some(SetPoint::Number(number)), _) => Some(*number),
                (_, Some(place)) => Some(columns.seen(place, row)),
                (_, None) => None,
            };
            rewards[row] += self.weight * self.counted(columns.seen(place, row), target);
        }
    }

    /// Returns the counted part of the value `x` of the column: for instance its distance from `target`, if there is one. A missing value
    /// gives NaN, because 0 would be a reward.
    fn counted(&self, x: f64, target: Option<f64>) -> f64 {
        let distance = match (target, self.low, self.high) {
            _ if x.is_nan() => f64::NAN,
            (Some(target), ..) => (x - target).abs(),
            (None, None, None) => x,
            (None, low, high) => {
                let below = low.map_or(0.0, |low| (low - x).max(0.0));
                below + high.map_or(0.0, |high| (x - high).max(0.0))
            }
        };
        distance.powi(self.power.into())
    }

    /// Checks the term, which has position `place` in its reward.
    fn check(&self, place: usize) -> Result<(), ControlError> {
        let set_point = match self.set_point {
            Some(SetPoint::Number(number)) => Some(number),
            Some(SetPoint::Column(_)) | None => None,
        };
        let numbers = [
            ("weight", Some(self.weight)),
            ("set_point", set_point),
            ("low", self.low),
            ("high", self.high),
        ];
        for (key, number) in numbers {
            if let Some(got) = number.filter(|number| !number.is_finite()) {
                let expected = "a finite number";
                return Err(ControlError::Term { term: place, key, got, expected });
            }
        }
        if !(1..=2).contains(&self.power) {
            let expected = "1, or 2 for the square";
            let got = self.power.into();
            return Err(ControlError::Term { term: place, key: "power", got, expected });
        }
        if let (Some(low), Some(high)) = (self.low, self.high)
            && low > high
        {
            let expected = "at most what `high` is: between them nothing counts";
            return Err(ControlError::Term { term: place, key: "low", got: low, expected });
        }
        if self.set_point_column() == Some(&self.column) {
            let column = self.column.clone();
            return Err(ControlError::OwnSetPoint { term: place, column });
        }
        let keys = [
            ("change", self.change),
            ("set_point", self.set_point.is_some()),
            ("low", self.low.is_some()),
            ("high", self.high.is_some()),
        ];
        let mut given = keys.iter().filter(|(_, is_given)| *is_given).map(|(key, _)| *key);
        match (given.next(), given.next()) {
            (Some(first @ ("change" | "set_point")), Some(second)) => {
                Err(ControlError::TwoMeanings { term: place, first, second })
            }
            _ => Ok(()),
        }
    }
}

impl Reward {
    /// Returns the terms. A recorded reward is one term.
    pub fn terms(&self) -> Cow<'_, [Term]> {
        match self {
            Self::Column(column) => Cow::Owned(vec![Term::plain(column)]),
            Self::Terms(terms) => Cow::Borrowed(terms),
        }
    }

    /// Returns the column that holds the reward, if there is one.
    pub fn recorded_column(&self) -> Option<&String> {
        match self {
            Self::Column(column) => Some(column),
            Self::Terms(_) => None,
        }
    }

    /// Returns the columns that the reward uses. A column of several terms comes more than once.
    pub fn columns(&self) -> impl Iterator<Item = &String> {
        let (column, terms) = match self {
            Self::Column(column) => (Some(column), &[][..]),
            Self::Terms(terms) => (None, &terms[..]),
        };
        column.into_iter().chain(terms.iter().flat_map(Term::columns))
    }

    /// Returns the key below `[control]` that names this column first, such as `reward[2].set_point`. Terms are numbered from 0.
    pub fn key_of(&self, column: &str) -> Option<String> {
        let terms = match self {
            Self::Column(own) => return (own == column).then(|| "reward".to_owned()),
            Self::Terms(terms) => terms,
        };
        terms.iter().enumerate().find_map(|(place, term)| {
            let key = match term.set_point_column() {
                _ if term.column == column => "column",
                Some(set_point) if set_point == column => "set_point",
                _ => return None,
            };
            Some(format!("reward[{place}].{key}"))
        })
    }

    /// Returns for every row the reward of the step that led to it; NaN if a value is missing. `leads_on` returns whether a row has an
    /// action and does not end its episode. Together with missing rewards, it decides where episodes begin, and changes of actions do not
    /// cross these beginnings.
    pub fn of_rows(
        &self,
        columns: &RewardColumns<'_>,
        segments: &Segments,
        leads_on: impl Fn(usize) -> bool,
    ) -> Vec<f32> {
        let terms = self.terms();
        let (changes, others): (Vec<&Term>, Vec<&Term>) =
            terms.iter().partition(|term| term.is_change_of_action(columns));
        let mut rewards = vec![0.0_f64; columns.rows()];
        for term in others {
            segments.iter().for_each(|segment| term.add(columns, segment.rows(), &mut rewards));
        }
        // Changes of actions are never missing within an episode, so the other terms decide which rewards are missing.
        let episodes = episodes(segments, leads_on, |row| (rewards[row] as f32).is_finite());
        for term in changes {
            for rows in &episodes {
                term.add(columns, rows.clone(), &mut rewards);
            }
        }
        rewards.into_iter().map(|reward| reward as f32).collect()
    }

    /// Checks that there is a term with a weight, that numbers are finite, and that every term has one meaning.
    pub(crate) fn check(&self) -> Result<(), ControlError> {
        let Self::Terms(terms) = self else { return Ok(()) };
        if terms.is_empty() {
            return Err(ControlError::EmptyReward);
        }
        terms.iter().enumerate().try_for_each(|(place, term)| term.check(place))?;
        if terms.iter().all(|term| term.weight == 0.0) {
            let expected = "another number in at least one term, for every reward would be 0";
            return Err(ControlError::Term { term: 0, key: "weight", got: 0.0, expected });
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
