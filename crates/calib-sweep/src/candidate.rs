use calib_agent::{AgentConfig, SimplePredictor};
use calib_core::Seed;
use itertools::Itertools as _;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::{SweepConfig, SweepError, sampling::combinations, written};

/// One setting of a sweep, as an agent.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Candidate {
    /// Position in the sweep. Grid order breaks remaining ties.
    pub index: usize,
    /// Whether its swept fields equal those of the `[agent]` section. One setting is always the default.
    pub is_default: bool,
    /// The swept fields, with the values of this setting.
    pub values: Vec<(String, Value)>,
    /// All hyperparameters of the agent.
    pub agent: AgentConfig,
}

impl Candidate {
    /// Returns the swept values as text, such as `learning_rate = 1e-4`.
    pub fn label(&self) -> String {
        label(&self.values)
    }

    /// Returns the simple predictor that the agent starts from, if it starts from one. `best` is the one that
    /// `agent.baseline = "best"` stands for, where it is known.
    pub fn start(&self, best: Option<SimplePredictor>) -> Option<SimplePredictor> {
        self.agent.baseline.map(|baseline| match baseline {
            SimplePredictor::Best => best.unwrap_or(baseline),
            named => named,
        })
    }

    /// Returns the same setting with the discount factor of `sensor`.
    #[must_use]
    pub fn for_sensor(&self, sensor: &str) -> Self {
        Self { agent: self.agent.for_sensor(sensor), ..self.clone() }
    }
}

fn label(values: &[(String, Value)]) -> String {
    values.iter().map(|(field, value)| format!("{field} = {}", written(value))).join(", ")
}

/// Returns the settings of a sweep: combinations of the swept values over the `[agent]` section, in grid order. The
/// section's own values are added if no combination has them. In a sweep of a single numeric field they take their
/// place among the numbers, otherwise they come last.
///
/// Random and Sobol samples depend on `seed`.
///
/// # Errors
/// Returns an error for:
/// - an empty grid or an empty field;
/// - gamma, because each of its values asks another question;
/// - a field that an agent lacks, or that no agent of the sweep uses;
/// - a range without numbers, or a repeated value;
/// - more samples than there are combinations;
/// - a combination that is not a valid agent.
pub fn candidates(
    sweep: &SweepConfig,
    agent: &AgentConfig,
    seed: Seed,
) -> Result<Vec<Candidate>, SweepError> {
    if sweep.grid.is_empty() {
        return Err(SweepError::EmptyGrid);
    }
    if sweep.grid.contains_key("gamma") {
        return Err(SweepError::GammaInGrid);
    }
    let axes = sweep
        .grid
        .iter()
        .map(|(field, axis)| Ok((field.clone(), axis.points(field, agent)?)))
        .collect::<Result<Vec<_>, SweepError>>()?;
    let points = combinations(&axes, sweep.sampling, sweep.samples, seed)?;
    let mut all = Vec::with_capacity(points.len() + 1);
    for (index, values) in points.into_iter().enumerate() {
        let values: Vec<(String, Value)> = sweep.grid.keys().cloned().zip(values).collect();
        let with = with_values(agent, &values)?;
        let is_default = with == *agent;
        all.push(Candidate { index, is_default, values, agent: with });
    }
    for field in sweep.grid.keys() {
        let lacking = all.iter().map(|candidate| candidate.agent.lacks(field));
        if let Some(Some(needed)) = lacking.reduce(Option::and) {
            return Err(SweepError::UnusedField { field: field.clone(), needed });
        }
    }
    if !all.iter().any(|candidate| candidate.is_default) {
        let own = agent.fields();
        let values = sweep.grid.keys().map(|field| (field.clone(), own[field].clone()));
        let values: Vec<(String, Value)> = values.collect();
        let place = place_of(&values, &all);
        let agent = agent.clone();
        all.insert(place, Candidate { index: place, is_default: true, values, agent });
        for (index, candidate) in all.iter_mut().enumerate() {
            candidate.index = index;
        }
    }
    Ok(all)
}

/// Returns the position of the default among `others`: in numeric order if a single field has increasing numbers,
/// otherwise last.
fn place_of(values: &[(String, Value)], others: &[Candidate]) -> usize {
    let of_others: Option<Vec<f64>> =
        others.iter().map(|other| only_number(&other.values)).collect();
    match (only_number(values), of_others) {
        (Some(own), Some(numbers)) if numbers.is_sorted() => {
            numbers.partition_point(|&other| other < own)
        }
        _ => others.len(),
    }
}

/// Returns the value of the only swept field, if there is one field and its value is a number.
fn only_number(values: &[(String, Value)]) -> Option<f64> {
    match values {
        [(_, value)] => value.as_f64(),
        _ => None,
    }
}

fn with_values(agent: &AgentConfig, values: &[(String, Value)]) -> Result<AgentConfig, SweepError> {
    let with = if agent.is_external() {
        of_program(agent, values)
    } else {
        let mut fields = agent.fields();
        fields.extend(values.iter().cloned());
        let with: AgentConfig = serde_json::from_value(Value::Object(fields))
            .map_err(|error| invalid(values, error.to_string()))?;
        AgentConfig { gammas: agent.gammas.clone(), ..with }
    };
    with.check().map_err(|error| invalid(values, error.to_string()))?;
    Ok(with)
}

fn invalid(values: &[(String, Value)], reason: String) -> SweepError {
    SweepError::Candidate { candidate: label(values), reason }
}

/// Returns the agent of an external program, with these values as its parameters. A whole number becomes a fraction
/// where the default is a fraction.
fn of_program(agent: &AgentConfig, values: &[(String, Value)]) -> AgentConfig {
    let mut with = agent.clone();
    for (field, value) in values {
        let own = agent.parameters.get(field);
        let fraction = value.as_f64().filter(|_| own.is_some_and(Value::is_f64));
        let value = fraction.map_or_else(|| value.clone(), Value::from);
        with.parameters.insert(field.clone(), value);
    }
    with
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use calib_agent::{OptimiserKind, ReplayKind};

    use super::*;

    fn candidates(sweep: &SweepConfig, agent: &AgentConfig) -> Result<Vec<Candidate>, SweepError> {
        super::candidates(sweep, agent, Seed::new(1))
    }

    fn sweep(grid: &[(&str, &[f64])]) -> SweepConfig {
        let grid = grid
            .iter()
            .map(|(field, values)| {
                let values: Vec<Value> = values.iter().map(|&value| value.into()).collect();
                ((*field).to_owned(), values.into())
            })
            .collect::<BTreeMap<_, _>>();
        SweepConfig { grid, ..SweepConfig::default() }
    }

    #[test]
    fn a_field_that_no_agent_uses_is_refused() {
        let linear = AgentConfig {
            value_function: calib_agent::ValueFunction::Linear,
            ..AgentConfig::default()
        };
        let sgd = AgentConfig { optimiser: OptimiserKind::Sgd, ..AgentConfig::default() };
        let online = AgentConfig { replay: ReplayKind::None, ..AgentConfig::default() };
        for (field, agent, needed) in [
            ("hidden_units", &linear, "value_function"),
            ("hidden_layers", &linear, "value_function"),
            ("beta1", &sgd, "optimiser"),
            ("epsilon", &sgd, "optimiser"),
            ("batch_size", &online, "replay"),
            ("replay_capacity", &online, "replay"),
        ] {
            let values: &[f64] = if field.starts_with("beta") || field == "epsilon" {
                &[0.1, 0.2]
            } else {
                &[3.0, 4.0]
            };
            let grid = values.iter().map(|&value| match value.fract() {
                0.0 => Value::from(value as u64),
                _ => Value::from(value),
            });
            let grid = BTreeMap::from([(field.to_owned(), grid.collect::<Vec<Value>>().into())]);
            let sweep = SweepConfig { grid, ..SweepConfig::default() };
            let refused = candidates(&sweep, agent).expect_err(field).to_string();
            assert!(refused.contains(&format!("sweep.grid.{field} decides nothing")), "{refused}");
            assert!(refused.contains(needed), "{refused}");
        }
        // A field counts as used if at least one of the swept optimisers uses it.
        let both = vec![Value::from("adam"), Value::from("sgd")];
        let numbers = vec![Value::from(0.1), Value::from(0.2)];
        let grid = BTreeMap::from([
            ("optimiser".to_owned(), both.into()),
            ("beta1".to_owned(), numbers.into()),
        ]);
        let sweep = SweepConfig { grid, ..SweepConfig::default() };
        assert!(candidates(&sweep, &sgd).is_ok());
    }

    #[test]
    fn values_are_written_as_by_hand_and_in_one_way() {
        let texts =
            [1e-4, 1e-3, 3e-3, 0.01, 0.05, 1000.0, 0.0, 2e6].map(|value| written(&value.into()));
        assert_eq!(texts, ["1e-4", "1e-3", "3e-3", "0.01", "0.05", "1000", "0", "2e6"]);
        assert_eq!(written(&64.into()), "64");
        assert_eq!(written(&"adam".into()), "adam");
    }

    #[test]
    fn a_grid_is_a_product_and_the_default_is_added_once() {
        let agent = AgentConfig::default();
        let all = candidates(
            &sweep(&[("beta1", &[0.8, 0.95]), ("learning_rate", &[1e-4, 1e-2])]),
            &agent,
        )
        .expect("valid");
        assert_eq!(all.len(), 5);
        assert_eq!(all[1].label(), "beta1 = 0.8, learning_rate = 0.01");
        assert!(all[4].is_default);
        let between = candidates(&sweep(&[("learning_rate", &[1e-4, 1e-2])]), &agent);
        let between = between.expect("valid");
        assert_eq!(
            between.iter().map(|candidate| candidate.is_default).collect::<Vec<_>>(),
            [false, true, false]
        );
        assert_eq!(between.iter().map(|candidate| candidate.index).collect::<Vec<_>>(), [0, 1, 2]);
        let mixed = candidates(&sweep(&[("learning_rate", &[1e-2, 1e-4])]), &agent);
        assert!(
            mixed.expect("valid")[2].is_default,
            "last where the others have an order of their own"
        );
        let within =
            candidates(&sweep(&[("learning_rate", &[1e-4, 1e-3])]), &agent).expect("valid");
        assert_eq!(within.len(), 2);
        assert!(within[1].is_default, "the default agent uses 1e-3");
        assert_eq!(within[0].label(), "learning_rate = 1e-4");
    }

    #[test]
    fn values_of_a_program_are_its_own() {
        let agent = AgentConfig {
            kind: calib_agent::AgentKind::External,
            command: vec!["agent".to_owned()],
            parameters: BTreeMap::from([
                ("rate".to_owned(), 1.0.into()),
                ("kind".to_owned(), "a".into()),
            ]),
            ..AgentConfig::default()
        };
        let mut grid = sweep(&[]);
        grid.grid.insert("rate".to_owned(), vec![1.into(), 2.into()].into());
        grid.grid.insert("kind".to_owned(), vec!["a".into(), "b".into()].into());
        let all = candidates(&grid, &agent).expect("valid");
        assert_eq!(all.len(), 4);
        let default = all.iter().find(|candidate| candidate.is_default).expect("among them");
        assert_eq!(default.agent, agent, "1 is 1.0");
        let unknown =
            candidates(&sweep(&[("learning_rate", &[0.5])]), &agent).expect_err("unknown");
        assert_eq!(
            unknown.to_string(),
            "sweep.grid.learning_rate is no key of [agent.parameters]; there are: kind, rate"
        );
    }

    #[test]
    fn mistakes_are_named() {
        let agent = AgentConfig::default();
        let refusal =
            |sweep: SweepConfig| candidates(&sweep, &agent).expect_err("invalid").to_string();
        assert!(refusal(sweep(&[])).contains("sweep.grid is empty"));
        assert!(
            refusal(sweep(&[("learning_rate", &[])]))
                .contains("sweep.grid.learning_rate has no values")
        );
        assert!(refusal(sweep(&[("learning_rate", &[0.5, 0.5])])).contains("twice"));
        let misspelt = refusal(sweep(&[("learning_rat", &[0.5])]));
        assert!(misspelt.contains("learning_rat is no key of [agent]"), "{misspelt}");
        assert!(misspelt.contains("learning_rate"), "{misspelt}");
        let gamma = refusal(sweep(&[("gamma", &[0.5, 0.9])]));
        assert!(gamma.contains("do not compare") && gamma.contains("make two studies"), "{gamma}");
    }
}
