//! The choices of each selection method in every pair.

use calib_stats::{StatsError, mean};

use crate::{Method, ModelPair, Pair, defaults::best_default, pair::capped};

/// Pairs with the regrets of all values, and their models and rules.
pub(crate) struct JudgedPairs<'a> {
    pub(crate) pairs: &'a [Pair],
    /// Regrets `[pairs, values]`.
    pub(crate) regrets: &'a [Vec<f64>],
    pub(crate) models: &'a [String],
    pub(crate) rules: &'a [String],
}

/// The choices of a method, one for each pair, and their regrets; `None` where the method has no choice.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Choices {
    pub(crate) method: Method,
    /// The chosen value; `None` for a mean over values.
    pub(crate) values: Vec<Option<usize>>,
    pub(crate) regrets: Vec<Option<f64>>,
}

impl Choices {
    /// Returns the capped regret in a pair.
    pub(crate) fn counted(&self, pair: usize) -> Option<f64> {
        self.regrets[pair].map(capped)
    }
}

impl JudgedPairs<'_> {
    /// Returns all methods: models first, then choices without calib, then floors. A method without a choice in any
    /// pair is excluded.
    pub(crate) fn methods(&self) -> Result<Vec<Choices>, StatsError> {
        let models = self.models.iter().map(|name| {
            self.chosen(Method::Model(name.clone()), |pair| Some(pair.model(name)?.chosen))
        });
        let mut all: Vec<Choices> = models.collect();
        if self.models.len() > 1 {
            all.push(self.chosen(Method::MostAccurate, |pair| least(pair, |model| model.one_step)));
            all.push(self.chosen(Method::LeastWarped, |pair| least(pair, |model| model.dtw)));
        }
        all.push(self.chosen(Method::LogReplay, |pair| pair.log_replay));
        all.push(self.chosen(Method::LatestWindow, |pair| pair.latest_window));
        all.push(self.chosen(Method::Default, |pair| pair.default));
        all.extend(self.defaults());
        let random = self.regrets.iter().map(|regrets| {
            let counted: Vec<f64> = regrets.iter().copied().map(capped).collect();
            Ok(Some(mean(&counted)?))
        });
        all.push(self.without_values(Method::Random, random.collect::<Result<_, StatsError>>()?));
        all.extend(self.floors());
        all.retain(|chosen| chosen.regrets.iter().any(Option::is_some));
        Ok(all)
    }

    /// Returns the choices of one value for several pairs. The best values per optimiser are excluded if all agents
    /// have the same one.
    fn defaults(&self) -> Vec<Choices> {
        let best_where =
            |counts: &dyn Fn(&Pair) -> bool| best_default(self.pairs, self.regrets, counts);
        let mut all = vec![
            self.chosen(Method::BestDefault, |_| best_where(&|_| true)),
            self.chosen(Method::OtherPlants, |pair| {
                best_where(&|other| differ_in_plant(pair, other))
            }),
        ];
        if self.pairs.windows(2).any(|pair| !share_optimiser(&pair[0], &pair[1])) {
            let own = self.chosen(Method::BestDefaultOfOptimiser, |pair| {
                best_where(&|other| share_optimiser(pair, other))
            });
            all.insert(1, own);
            all.push(self.chosen(Method::OtherPlantsWithOptimiser, |pair| {
                best_where(&|other| differ_in_plant(pair, other) && share_optimiser(pair, other))
            }));
        }
        all
    }

    fn floors(&self) -> [Choices; 2] {
        let another = self.pairs.iter().map(|pair| pair.another_window);
        [
            self.without_values(
                Method::Hindsight,
                self.regrets
                    .iter()
                    .map(|regrets| regrets.iter().copied().reduce(f64::min))
                    .collect(),
            ),
            self.without_values(Method::AnotherWindow, another.collect()),
        ]
    }

    /// Returns the choices of each rule in `model`.
    pub(crate) fn rules_in(&self, model: &str) -> Vec<Choices> {
        self.rules
            .iter()
            .map(|rule| {
                self.chosen(Method::RuleOf(model.to_owned(), rule.clone()), |pair| {
                    pair.model(model)?.by(rule)
                })
            })
            .collect()
    }

    /// Returns the choices of each rule in every model: one entry per model and pair, model by model.
    pub(crate) fn rules_in_all_models(&self) -> Vec<Choices> {
        self.rules
            .iter()
            .map(|rule| {
                let each: Vec<Choices> = self
                    .models
                    .iter()
                    .map(|model| {
                        self.chosen(Method::Rule(rule.clone()), |pair| pair.model(model)?.by(rule))
                    })
                    .collect();
                Choices {
                    method: Method::Rule(rule.clone()),
                    values: each.iter().flat_map(|chosen| chosen.values.clone()).collect(),
                    regrets: each.iter().flat_map(|chosen| chosen.regrets.clone()).collect(),
                }
            })
            .collect()
    }

    fn chosen(&self, method: Method, choice: impl Fn(&Pair) -> Option<usize>) -> Choices {
        let values: Vec<Option<usize>> = self.pairs.iter().map(choice).collect();
        let regrets = values.iter().zip(self.regrets);
        let regrets = regrets.map(|(value, regrets)| value.map(|value| regrets[value])).collect();
        Choices { method, values, regrets }
    }

    fn without_values(&self, method: Method, regrets: Vec<Option<f64>>) -> Choices {
        Choices { method, values: vec![None; self.pairs.len()], regrets }
    }
}

fn differ_in_plant(pair: &Pair, other: &Pair) -> bool {
    other.plant != pair.plant
}

fn share_optimiser(pair: &Pair, other: &Pair) -> bool {
    other.optimiser == pair.optimiser
}

/// Returns the choice of the model with the smallest measure, if at least two models have it. Ties go to the first.
fn least(pair: &Pair, measure: impl Fn(&ModelPair) -> Option<f64>) -> Option<usize> {
    let known = pair.models.iter().filter_map(|model| Some((measure(model)?, model)));
    let known: Vec<(f64, &ModelPair)> = known.collect();
    let (_, model) = known.iter().min_by(|(a, _), (b, _)| a.total_cmp(b))?;
    (known.len() > 1).then_some(model.chosen)
}
