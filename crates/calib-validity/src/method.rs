//! Ways to choose a value.

use std::fmt;

use calib_stats::mean;
use serde::{Serialize, Serializer};

use crate::{ModelPair, Pair, Rule, ValidityError};

/// A way to choose a value.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Method {
    /// What calib chooses in a model.
    Model(String),
    /// What another rule chooses from the same ranks and errors.
    RuleOf(String, &'static str),
    /// On each sensor the choice of the model with the smallest one-step error there.
    MostAccurate,
    /// On each sensor the choice of the model whose rollouts warp least.
    LeastWarped,
    /// The one value with the smallest mean regret over all pairs: nobody knows it beforehand.
    BestDefault,
    /// The one value with the smallest mean regret over the pairs of all other plants: what experience would say.
    OtherPlants,
    /// The value that the study gives as its default.
    Default,
    /// The value that is best on the replayed log.
    LogReplay,
    /// Any value of the grid, evenly: the mean of their regrets.
    Random,
}

impl fmt::Display for Method {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Model(model) => write!(formatter, "{model}"),
            Self::RuleOf(model, rule) => write!(formatter, "{model}, {}", rule.replace('_', " ")),
            Self::MostAccurate => {
                write!(formatter, "model with the least one-step error, in hindsight")
            }
            Self::LeastWarped => write!(formatter, "model with the least DTW"),
            Self::BestDefault => write!(formatter, "best default in hindsight"),
            Self::OtherPlants => write!(formatter, "best default of the other plants"),
            Self::Default => write!(formatter, "the study's default"),
            Self::LogReplay => write!(formatter, "log replay"),
            Self::Random => write!(formatter, "random choice"),
        }
    }
}

impl Serialize for Method {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(&self.name())
    }
}

impl Method {
    /// The name in files: `model:NAME`, `model:NAME:RULE`, or a word.
    pub fn name(&self) -> String {
        match self {
            Self::Model(model) => format!("model:{model}"),
            Self::RuleOf(model, rule) => format!("model:{model}:{rule}"),
            Self::MostAccurate => "most_accurate_model".to_owned(),
            Self::LeastWarped => "least_warped_model".to_owned(),
            Self::BestDefault => "best_default".to_owned(),
            Self::OtherPlants => "best_default_of_other_plants".to_owned(),
            Self::Default => "default".to_owned(),
            Self::LogReplay => "log_replay".to_owned(),
            Self::Random => "random".to_owned(),
        }
    }
}

/// Pairs with the regrets of all values, and the models that they have.
pub(crate) struct Judged<'a> {
    pub(crate) pairs: &'a [Pair],
    /// `[pairs, values]`.
    pub(crate) regrets: &'a [Vec<f64>],
    pub(crate) models: &'a [String],
}

/// The choice of a method in every pair, and its regret; `None` where it has none.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Chosen {
    pub(crate) method: Method,
    /// The value; none for a mean over values.
    pub(crate) values: Vec<Option<usize>>,
    pub(crate) regrets: Vec<Option<f64>>,
}

impl Judged<'_> {
    /// All methods: models first, then what one would do without calib.
    pub(crate) fn methods(&self) -> Result<Vec<Chosen>, ValidityError> {
        let models = self.models.iter().map(|name| {
            let choice = |pair: &Pair| Some(pair.model(name)?.selection.chosen);
            self.chosen(Method::Model(name.clone()), choice)
        });
        let mut all: Vec<Chosen> = models.collect();
        if self.models.len() > 1 {
            all.push(self.chosen(Method::MostAccurate, |pair| least(pair, |of| of.one_step)));
            all.push(self.chosen(Method::LeastWarped, |pair| least(pair, |of| of.dtw)));
        }
        let best = self.best_default(|_| true)?;
        all.push(self.chosen(Method::BestDefault, |_| Some(best)));
        if self.plants().len() > 1 {
            let best = |pair: &Pair| self.best_default(|other| other.plant != pair.plant);
            let values = self
                .pairs
                .iter()
                .map(|pair| Ok(Some(best(pair)?)))
                .collect::<Result<_, ValidityError>>()?;
            all.push(self.of_values(Method::OtherPlants, values));
        }
        all.push(self.chosen(Method::Default, |pair| pair.default));
        all.push(self.chosen(Method::LogReplay, |pair| pair.log_replay));
        let random = self.regrets.iter().map(|of| Ok(Some(mean(of)?)));
        all.push(Chosen {
            method: Method::Random,
            values: vec![None; self.pairs.len()],
            regrets: random.collect::<Result<_, ValidityError>>()?,
        });
        // What no pair has is no method here.
        all.retain(|chosen| chosen.regrets.iter().any(Option::is_some));
        Ok(all)
    }

    /// What each other rule would choose in `model`.
    pub(crate) fn rules(&self, model: &str) -> Vec<Chosen> {
        let of_rule = |rule: Rule| {
            let choice = move |pair: &Pair| Some(rule.choose(&pair.model(model)?.selection));
            self.chosen(Method::RuleOf(model.to_owned(), rule.name()), choice)
        };
        Rule::ALL.map(of_rule).to_vec()
    }

    /// Names of the plants, in the order in which they come.
    pub(crate) fn plants(&self) -> Vec<&str> {
        let mut plants: Vec<&str> = Vec::new();
        for pair in self.pairs {
            if !plants.contains(&pair.plant.as_str()) {
                plants.push(&pair.plant);
            }
        }
        plants
    }

    /// The value with the smallest mean regret over the pairs that `counts` says count; the first of equals.
    pub(crate) fn best_default(
        &self,
        counts: impl Fn(&Pair) -> bool,
    ) -> Result<usize, ValidityError> {
        let rows: Vec<&Vec<f64>> = self
            .pairs
            .iter()
            .zip(self.regrets)
            .filter(|(pair, _)| counts(pair))
            .map(|(_, regrets)| regrets)
            .collect();
        let values = rows.first().map_or(0, |row| row.len());
        let mean_of = |value: usize| mean(&rows.iter().map(|row| row[value]).collect::<Vec<_>>());
        let means = (0..values).map(mean_of).collect::<Result<Vec<f64>, _>>()?;
        Ok((0..values).min_by(|&a, &b| means[a].total_cmp(&means[b])).unwrap_or(0))
    }

    fn chosen(&self, method: Method, choice: impl Fn(&Pair) -> Option<usize>) -> Chosen {
        self.of_values(method, self.pairs.iter().map(choice).collect())
    }

    fn of_values(&self, method: Method, values: Vec<Option<usize>>) -> Chosen {
        let regrets = values.iter().zip(self.regrets);
        let regrets = regrets.map(|(value, of)| value.map(|value| of[value])).collect();
        Chosen { method, values, regrets }
    }
}

/// The choice of the model with the least of something, if at least two models have it; the first of equals.
fn least(pair: &Pair, of: impl Fn(&ModelPair) -> Option<f64>) -> Option<usize> {
    let known = pair.models.iter().filter_map(|model| Some((of(model)?, model)));
    let known: Vec<(f64, &ModelPair)> = known.collect();
    let (_, model) = known.iter().min_by(|(a, _), (b, _)| a.total_cmp(b))?;
    (known.len() > 1).then_some(model.selection.chosen)
}
