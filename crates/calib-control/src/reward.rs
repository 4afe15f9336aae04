use std::{borrow::Cow, fmt, ops::Range};

use calib_core::Segments;
use schemars::JsonSchema;
use serde::{
    Deserialize, Deserializer, Serialize,
    de::{Error, SeqAccess, Visitor, value::SeqAccessDeserializer},
};

use crate::{ControlError, log::episodes};

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

/// A term of a reward: `weight` times the column, or how far the column is from its set-point or outside its limits, or how much it
/// changed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Term {
    /// The column, in its own units.
    pub column: String,
    /// Reward a unit; negative for what costs (default 1).
    #[serde(default = "one")]
    pub weight: f64,
    /// Then the distance |x − `set_point`| counts, not x: a number, or the column that holds the set-point of each row. Of
    /// an action it is the one by which the step was made, in the row before.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub set_point: Option<SetPoint>,
    /// Then only what is below counts: `low` − x.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub low: Option<f64>,
    /// Then only what is above counts: x − `high`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub high: Option<f64>,
    /// Then the change |x − x of the row before| counts, not x. Of an action it is the change against the step before, and the first step of
    /// an episode has none (default false).
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub change: bool,
    /// Power of what counts: 1, or 2 for its square (default 1).
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

/// Where a column should be.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
#[serde(untagged)]
pub enum SetPoint {
    /// At this value, in the unit of the term's column.
    Number(f64),
    /// At what this column holds in the same row; of an action, in the row before.
    Column(String),
}

/// Written by hand because serde's untagged enumerations do not say what is wrong with a value.
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

/// What a log recorded in the columns that a reward is made of.
#[derive(Clone, Copy, Debug)]
pub struct RewardColumns<'a> {
    /// Names of columns.
    pub names: &'a [String],
    /// `[names][rows]`, in the unit of each column; NaN where a value is missing.
    pub values: &'a [Vec<f64>],
    /// The first so many are columns of actions.
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

    /// What the reward of `row` sees of a column: its value there. What a step cost is what was done in it, so of an action it is the
    /// action of the row before, from which the step led to `row`; the first row has none.
    fn seen(&self, place: usize, row: usize) -> f64 {
        self.seen_row(place, row).map_or(f64::NAN, |seen| self.values[place][seen])
    }

    /// The row of the value that the reward of `row` sees of a column.
    fn seen_row(&self, place: usize, row: usize) -> Option<usize> {
        if self.is_action(place) { row.checked_sub(1) } else { Some(row) }
    }
}

impl Term {
    /// The value of a column, as it stands.
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

    /// The columns that it is made of.
    fn columns(&self) -> impl Iterator<Item = &String> {
        std::iter::once(&self.column).chain(self.set_point_column())
    }

    fn set_point_column(&self) -> Option<&String> {
        match &self.set_point {
            Some(SetPoint::Column(column)) => Some(column),
            Some(SetPoint::Number(_)) | None => None,
        }
    }

    /// Whether it counts changes of an action.
    fn is_change_of_action(&self, columns: &RewardColumns<'_>) -> bool {
        self.change && columns.is_action(columns.place(&self.column))
    }

    /// What the term adds to the rewards of `rows`, outside which it sees nothing before.
    fn add(&self, columns: &RewardColumns<'_>, rows: Range<usize>, rewards: &mut [f64]) {
        let place = columns.place(&self.column);
        let set_point_place = self.set_point_column().map(|column| columns.place(column));
        let first = rows.start;
        // The first row has no row before it.
        for row in rows.skip(usize::from(self.change)) {
            let target = match (&self.set_point, set_point_place) {
                _ if self.change => {
                    // The first step of an episode has no step before it: its action has changed from itself.
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

    /// What counts of the value `x` of its column: its distance from `target`, where there is one. NaN where a value is missing, which is no
    /// reward of nought.
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

    /// Check the term, which is number `place` of its reward.
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
    fn terms(&self) -> Cow<'_, [Term]> {
        match self {
            Self::Column(column) => Cow::Owned(vec![Term::plain(column)]),
            Self::Terms(terms) => Cow::Borrowed(terms),
        }
    }

    /// The columns that it is made of, one of several terms more than once.
    pub fn columns(&self) -> impl Iterator<Item = &String> {
        let (column, terms) = match self {
            Self::Column(column) => (Some(column), &[][..]),
            Self::Terms(terms) => (None, &terms[..]),
        };
        column.into_iter().chain(terms.iter().flat_map(Term::columns))
    }

    /// The key below `[control]` that names this column first, such as `reward[2].set_point`: terms are numbered from 0.
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

    /// The reward of every row, of the step that led there; NaN where a value is missing. `leads_on` says whether an action is taken in a row
    /// that does not end its episode: with rewards that are missing, this decides where episodes begin, which changes of actions do not
    /// cross.
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
        // Changes of actions are never missing inside an episode, so the others decide which rewards are.
        let episodes = episodes(segments, leads_on, |row| (rewards[row] as f32).is_finite());
        for term in changes {
            for rows in &episodes {
                term.add(columns, rows.clone(), &mut rewards);
            }
        }
        rewards.into_iter().map(|reward| reward as f32).collect()
    }

    /// Check that there is a term with a weight, that numbers are finite, and that every term means one thing.
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
mod tests {
    use super::*;

    fn read(text: &str) -> Reward {
        #[derive(Deserialize)]
        struct Section {
            reward: Reward,
        }
        let section: Section = toml::from_str(&format!("reward = {text}")).expect("valid");
        section.reward
    }

    /// The rewards of rows in which `x` has these values, `sp` is its set-point, and `valve` is an action.
    fn rewards(text: &str, x: &[f64], set_points: &[f64], valve: &[f64]) -> Vec<f32> {
        let names = ["valve", "x", "sp"].map(str::to_owned);
        let values = [valve, x, set_points].map(<[f64]>::to_vec);
        let columns = RewardColumns { names: &names, values: &values, actions: 1 };
        let segments = Segments::from_lengths([x.len()]).expect("rows");
        read(text).of_rows(&columns, &segments, |row| !valve[row].is_nan())
    }

    const MISSING: f64 = f64::NAN;

    #[test]
    fn terms_are_their_formulas() {
        let of_x =
            |text: &str, x: &[f64]| rewards(text, x, &vec![0.0; x.len()], &vec![0.0; x.len()]);
        assert_eq!(of_x("[{ column = 'x', weight = -2 }]", &[3.0]), [-6.0]);
        assert_eq!(
            of_x("[{ column = 'x', weight = -2, set_point = 5 }]", &[3.0, 7.5]),
            [-4.0, -5.0]
        );
        let limits = "[{ column = 'x', weight = -2, low = 1.0, high = 2.0 }]";
        assert_eq!(of_x(limits, &[0.5, 1.5, 4.0]), [-1.0, 0.0, -4.0]);
        assert!(of_x(limits, &[MISSING])[0].is_nan());
        assert_eq!(of_x("'x'", &[7.0, 8.0]), [7.0, 8.0]);
    }

    #[test]
    fn terms_add_up_row_by_row() {
        let text = "[{ column = 'x', weight = -2 }, { column = 'x', weight = -2, high = 2 }]";
        let got = rewards(text, &[1.0, 4.0, MISSING], &[0.0; 3], &[0.0; 3]);
        assert_eq!(got[..2], [-2.0, -12.0]);
        assert!(got[2].is_nan());
    }

    #[test]
    fn a_set_point_may_be_a_column() {
        let text = "[{ column = 'x', weight = -1, set_point = 'sp' }]";
        let got = rewards(text, &[1.0, 4.0, 5.0], &[2.0, 2.0, MISSING], &[0.0; 3]);
        assert_eq!(got[..2], [-1.0, -2.0]);
        assert!(got[2].is_nan(), "a set-point that is missing is no reward of nought");
        assert_eq!(read(text).columns().collect::<Vec<_>>(), ["x", "sp"]);
    }

    #[test]
    fn what_counts_may_be_squared() {
        let of_x = |keys: &str, x: &[f64]| {
            let text = format!("[{{ column = 'x', weight = -2, power = 2{keys} }}]");
            rewards(&text, x, &vec![5.0; x.len()], &vec![0.0; x.len()])
        };
        assert_eq!(of_x("", &[3.0, -1.0]), [-18.0, -2.0], "of x itself");
        assert_eq!(of_x(", set_point = 'sp'", &[3.0, 6.0]), [-8.0, -2.0], "of the distance");
        assert_eq!(of_x(", low = 1, high = 2", &[-2.0, 1.5, 4.0]), [-18.0, 0.0, -8.0]);
        assert!(of_x("", &[MISSING])[0].is_nan());
        let cube = read("[{ column = 'x' }, { column = 'x', power = 3 }]");
        let told = cube.check().expect_err("a cube").to_string();
        assert!(told.contains("`reward[1].power` is 3, expected 1, or 2"), "{told}");
        let written = |text: &str| serde_json::to_string(&read(text)).expect("JSON");
        assert!(!written("[{ column = 'x', power = 1 }]").contains("power"), "as without the key");
    }

    #[test]
    fn an_action_counts_in_the_step_that_it_was_taken_in() {
        let valve = [1.0, 2.0, 4.0];
        let got = rewards("[{ column = 'valve', weight = -1 }]", &[0.0; 3], &[0.0; 3], &valve);
        assert!(got[0].is_nan(), "no step led there");
        assert_eq!(got[1..], [-1.0, -2.0]);
        let text = "[{ column = 'x', weight = -1, set_point = 'valve' }]";
        let got = rewards(text, &[0.0, 5.0, 5.0], &[0.0; 3], &valve);
        assert_eq!(got[1..], [-4.0, -3.0], "a set-point that an agent sets");
    }

    #[test]
    fn a_change_of_an_action_counts_in_the_step_that_it_made() {
        let valve = [1.0, 3.0, 3.0, 2.0, 5.0];
        let of_valve = |text: &str, valve: &[f64]| rewards(text, &[7.0; 5], &[0.0; 5], valve);
        let text = "[{ column = 'valve', change = true, weight = -2 }]";
        // The step to row 1 begins the episode. That to row 2 was made by 3 after 1, to row 3 by 3 after 3, to row 4 by 2 after 3. No step
        // is made by the last action.
        assert_eq!(of_valve(text, &valve)[1..], [0.0, -4.0, 0.0, -2.0]);
        let square = "[{ column = 'valve', change = true, power = 2, weight = -2 }]";
        assert_eq!(of_valve(square, &valve)[1..], [0.0, -8.0, 0.0, -2.0]);
        // Without an action in row 1, an episode begins in row 2.
        let got = of_valve(text, &[1.0, MISSING, 3.0, 2.0, 5.0]);
        assert_eq!([got[1], got[3], got[4]], [0.0, 0.0, -2.0]);
        // Without a reward in row 2, one begins there as well.
        let text = "[{ column = 'valve', change = true, weight = -2 }, { column = 'x' }]";
        let got = rewards(text, &[7.0, 7.0, MISSING, 7.0, 7.0], &[0.0; 5], &valve);
        assert!(got[2].is_nan());
        assert_eq!([got[1], got[3], got[4]], [7.0, 7.0, 5.0]);
    }

    #[test]
    fn a_change_of_a_sensor_counts_in_the_row_that_has_it() {
        let text = "[{ column = 'x', change = true, weight = -1 }]";
        let got = rewards(text, &[1.0, 4.0, 4.0, MISSING, 2.0], &[0.0; 5], &[0.0; 5]);
        assert_eq!(got[..3], [0.0, -3.0, 0.0]);
        assert!(got[3].is_nan() && got[4].is_nan(), "what is missing may have changed");
        let columns = ["valve", "x"].map(str::to_owned);
        let values = [vec![0.0; 4], vec![1.0, 2.0, 9.0, 7.0]];
        let columns = RewardColumns { names: &columns, values: &values, actions: 1 };
        let segments = Segments::from_lengths([2, 2]).expect("rows");
        let got = read(text).of_rows(&columns, &segments, |_| true);
        assert_eq!(got, [0.0, -1.0, 0.0, -2.0], "nothing changes across a gap");
    }

    #[test]
    fn the_key_of_a_column_names_its_term() {
        let reward = read("[{ column = 'x' }, { column = 'y', set_point = 'sp' }]");
        assert_eq!(reward.key_of("x").as_deref(), Some("reward[0].column"));
        assert_eq!(reward.key_of("sp").as_deref(), Some("reward[1].set_point"));
        assert_eq!(reward.key_of("z"), None);
        assert_eq!(read("'x'").key_of("x").as_deref(), Some("reward"));
    }

    #[test]
    fn terms_that_make_no_sense_are_refused() {
        let refused = |text: &str| read(text).check().expect_err(text).to_string();
        let told = refused("[{ column = 'x' }, { column = 'x', low = 3, high = 2 }]");
        assert!(
            told.starts_with("`reward[1].low` is 3, expected at most what `high` is"),
            "{told}"
        );
        assert!(read("[{ column = 'x', low = 2, high = 2 }]").check().is_ok());
        let told = refused("[{ column = 'y' }, { column = 'x', set_point = 'x' }]");
        assert!(told.starts_with("the set-point of reward[1] is its own column, x"), "{told}");
        let told = refused("[{ column = 'x', weight = 0 }]");
        assert!(told.starts_with("`reward[0].weight` is 0, expected another number"), "{told}");
        assert!(read("[{ column = 'x', weight = 0 }, { column = 'y' }]").check().is_ok());
    }

    #[test]
    fn what_means_two_things_is_refused() {
        let refused = |text: &str| read(text).check().expect_err(text).to_string();
        let told = refused("[{ column = 'x' }, { column = 'x', set_point = 'sp', high = 2 }]");
        assert!(told.starts_with("reward[1] has both set_point and high"), "{told}");
        assert!(told.contains("two terms"), "{told}");
        let told = refused("[{ column = 'x', change = true, set_point = 1 }]");
        assert!(told.starts_with("reward[0] has both change and set_point"), "{told}");
        refused("[{ column = 'x', change = true, low = 1 }]");
        assert!(read("[{ column = 'x', low = 1, high = 2 }]").check().is_ok());
        assert!(Reward::Terms(vec![]).check().is_err());
        let told = refused("[{ column = 'x' }, { column = 'x', low = nan }]");
        assert!(told.starts_with("`reward[1].low` is NaN, expected a finite number"), "{told}");
        let told = refused("[{ column = 'x', set_point = inf }]");
        assert!(told.starts_with("`reward[0].set_point` is inf"), "{told}");
        let told = toml::from_str::<Term>("column = 'x'\nset_point = true").expect_err("neither");
        assert!(told.to_string().contains("a number or the name of a column"), "{told}");
    }
}
