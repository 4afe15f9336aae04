//! What to deploy if a study has several deployments: a choice for each, and one for all.

mod evidence;

use calib_agent::SimplePredictor;
use calib_base::{
    StepError,
    output::{Printer, percent, table},
};
use calib_report::{Cell, Table};
use calib_sweep::{Candidate, Grade, SensorVerdict};
use schemars::JsonSchema;
use serde::Serialize;
use serde_json::{Map, Value};

use crate::verdict::{
    compare::{JudgedModel, by_deployment},
    verdict_rows,
};

/// Choices by one model for one sensor in all deployments; in `summary.json`.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub(crate) struct Deployed {
    pub(crate) sensor: String,
    /// The model that chose, or "log replay" if there is no model.
    pub(crate) model: String,
    /// Whether a model chose.
    #[serde(skip)]
    #[schemars(skip)]
    pub(crate) is_by_model: bool,
    /// The choice for each deployment, in the order of time.
    pub(crate) choices: Vec<Choice>,
    /// The setting that the study's rule chooses from the evidence of all deployments together.
    pub(crate) for_all: String,
    /// The swept keys of this setting, with their values.
    pub(crate) for_all_values: Map<String, Value>,
    /// Regret of this setting in each deployment.
    pub(crate) regrets: Vec<Option<f64>>,
}

/// The choice for one deployment.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub(crate) struct Choice {
    pub(crate) deployment: String,
    /// The chosen setting, as the report names it.
    pub(crate) chosen: String,
    /// The swept keys of the agent, with their values.
    pub(crate) values: Map<String, Value>,
    /// Regret of the choice on the held-out period.
    pub(crate) regret: Option<f64>,
    /// How well held-out data supports the choice.
    pub(crate) grade: Grade,
    /// The simple predictor to use instead, if the agent is not known to be as good.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) simple_predictor: Option<SimplePredictor>,
}

impl Deployed {
    /// Whether the choices of the deployments differ.
    fn disagrees(&self) -> bool {
        self.choices.iter().any(|choice| choice.chosen != self.choices[0].chosen)
    }

    /// Whether no setting learns the sensor in any deployment.
    fn is_not_learnt(&self) -> bool {
        self.choices.iter().all(Choice::is_not_learnt)
    }
}

impl Choice {
    fn is_not_learnt(&self) -> bool {
        self.grade == Grade::NotLearnt
    }

    /// Whether the regret is meaningless: nothing was learned, or the sensor is constant, with regret 0.
    fn says_nothing(&self) -> bool {
        let stands_still = self.grade == Grade::Unchecked && self.regret.is_some();
        self.is_not_learnt() || stands_still
    }

    /// Returns the choice with its regret and grade, such as "1e-4 (2.3 %, good)".
    fn text(&self) -> String {
        let word = self.grade.word();
        match (self.grade, self.regret) {
            (Grade::NotLearnt, _) => word.to_owned(),
            (Grade::Simpler, _) => match self.simple_predictor {
                Some(predictor) => format!("no agent: {}", predictor.label()),
                None => word.to_owned(),
            },
            (_, None) => self.chosen.clone(),
            (Grade::Unchecked, Some(_)) => format!("{} ({word})", self.chosen),
            (_, Some(regret)) => format!("{} ({}, {word})", self.chosen, percent(regret)),
        }
    }
}

/// Returns one row per sensor and model. Empty unless there are several deployments.
pub(crate) fn all(parts: &[JudgedModel]) -> Result<Vec<Deployed>, StepError> {
    let deployments = by_deployment(parts);
    if deployments.len() < 2 {
        return Ok(Vec::new());
    }
    let mut rows = Vec::new();
    for sensor in &parts[0].judged.study().sweep.sensors {
        for model in &deployments[0] {
            let own = deployments.iter().flatten().copied();
            let own: Vec<&JudgedModel> =
                own.filter(|part| part.model_name() == model.model_name()).collect();
            rows.extend(of_sensor(sensor, &own)?);
        }
    }
    Ok(rows)
}

fn of_sensor(sensor: &str, parts: &[&JudgedModel]) -> Result<Option<Deployed>, StepError> {
    let verdicts: Option<Vec<SensorVerdict>> = parts
        .iter()
        .map(|part| {
            let mut verdicts = part.judged.summary.verdicts.iter();
            verdicts.find(|verdict| verdict.sensor == sensor).cloned()
        })
        .collect();
    let Some(verdicts) = verdicts else { return Ok(None) };
    let candidates = &parts[0].judged.manifest.candidates;
    let label = |index: usize| verdict_rows::setting(&candidates[index]).to_string();
    let choices = parts.iter().zip(&verdicts).map(|(part, verdict)| Choice {
        deployment: part.deployment_name().to_owned(),
        chosen: label(verdict.chosen),
        values: values(&candidates[verdict.chosen]),
        regret: verdict.truth.as_ref().and_then(|truth| Some(truth.choice.regret?.value)),
        grade: verdict.grade,
        simple_predictor: verdict.simpler().map(|simpler| simpler.predictor),
    });
    let for_all = evidence::choice(sensor, parts, &verdicts)?;
    let regrets = verdicts.iter().map(|verdict| {
        verdict.truth.as_ref().and_then(|truth| Some(truth.regrets.as_ref()?[for_all]))
    });
    Ok(Some(Deployed {
        sensor: sensor.to_owned(),
        model: parts[0].model_name().to_owned(),
        is_by_model: parts[0].judged.study().has_model(),
        choices: choices.collect(),
        for_all: label(for_all),
        for_all_values: values(&candidates[for_all]),
        regrets: regrets.collect(),
    }))
}

/// Returns the swept values of a setting.
fn values(candidate: &Candidate) -> Map<String, Value> {
    candidate.values.iter().cloned().collect()
}

/// Returns the largest regret, if all are known.
fn largest(regrets: &[Option<f64>]) -> Option<f64> {
    let all: Option<Vec<f64>> = regrets.iter().copied().collect();
    all?.into_iter().reduce(f64::max)
}

fn header(rows: &[Deployed]) -> Vec<String> {
    let deployments = rows[0].choices.iter().map(|choice| choice.deployment.clone());
    let model = rows[0].is_by_model.then(|| "model".to_owned());
    let leading = ["sensor".to_owned()].into_iter().chain(model);
    leading.chain(deployments).chain(["for all".to_owned()]).collect()
}

fn row(deployed: &Deployed) -> Vec<String> {
    let choices = deployed.choices.iter().map(Choice::text);
    [deployed.sensor.clone()]
        .into_iter()
        .chain(deployed.is_by_model.then(|| deployed.model.clone()))
        .chain(choices)
        .chain([for_all_text(deployed)])
        .collect()
}

/// Returns the choice for all deployments, such as "1e-4 (at most 25 %; not learned in july)".
fn for_all_text(deployed: &Deployed) -> String {
    if deployed.is_not_learnt() {
        return Grade::NotLearnt.word().to_owned();
    }
    let learnt = deployed.choices.iter().zip(&deployed.regrets);
    let learnt = learnt.filter(|(choice, _)| !choice.says_nothing());
    let regrets: Vec<Option<f64>> = learnt.map(|(_, regret)| *regret).collect();
    let cost = largest(&regrets).map(|regret| format!("at most {}", percent(regret)));
    let without: Vec<&str> = deployed
        .choices
        .iter()
        .filter(|choice| choice.is_not_learnt())
        .map(|choice| choice.deployment.as_str())
        .collect();
    let without = (!without.is_empty()).then(|| format!("not learned in {}", without.join(", ")));
    let told: Vec<String> = cost.into_iter().chain(without).collect();
    if told.is_empty() {
        deployed.for_all.clone()
    } else {
        format!("{} ({})", deployed.for_all, told.join("; "))
    }
}

/// Prints the choices side by side. Prints nothing unless there are several deployments.
pub(crate) fn show(rows: &[Deployed], printer: &Printer) -> Result<(), StepError> {
    if rows.is_empty() {
        return Ok(());
    }
    printer.result("")?;
    printer.result(match rows.iter().any(Deployed::disagrees) {
        _ if rows.iter().all(Deployed::is_not_learnt) => {
            "what to deploy: nothing, as no setting learns any sensor in any deployment"
        }
        false => {
            "what to deploy (regret on held-out data, grade): every choice is the same for all deployments"
        }
        true => "what to deploy (regret on held-out data, grade): choices differ between deployments",
    })?;
    let header = header(rows);
    let header: Vec<&str> = header.iter().map(String::as_str).collect();
    printer.lines(&table(&header, &rows.iter().map(row).collect::<Vec<_>>()))
}

/// Returns the same table for the report.
pub(crate) fn report_table(rows: &[Deployed]) -> Option<Table> {
    let evidence = if rows.first()?.is_by_model {
        "from the models of all deployments and the replayed log"
    } else {
        "from the replayed log"
    };
    Some(Table {
        title: "What to deploy".to_owned(),
        caption: format!(
            "The choice for each deployment, in brackets its regret on held-out data and its grade. The setting for all is what the study's rule chooses {evidence}, with the largest of its regrets."
        ),
        columns: header(rows),
        rows: rows
            .iter()
            .map(|deployed| row(deployed).into_iter().map(Cell::Text).collect())
            .collect(),
        best: None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn choice(deployment: &str, chosen: &str, regret: Option<f64>, grade: Grade) -> Choice {
        Choice {
            deployment: deployment.to_owned(),
            chosen: chosen.to_owned(),
            values: Map::new(),
            regret,
            grade,
            simple_predictor: None,
        }
    }

    fn deployed(choices: Vec<Choice>, regrets: Vec<Option<f64>>) -> Deployed {
        Deployed {
            sensor: "PIT300".to_owned(),
            model: "year".to_owned(),
            is_by_model: true,
            choices,
            for_all: "1e-4".to_owned(),
            for_all_values: Map::new(),
            regrets,
        }
    }

    #[test]
    fn costs_and_grades_stand_beside_values() {
        let choices = vec![
            choice("april", "1e-4", Some(0.0), Grade::Good),
            choice("july", "1e-3", None, Grade::Unchecked),
        ];
        let told = deployed(choices, vec![Some(0.0), Some(0.25)]);
        assert!(told.disagrees());
        let still =
            deployed(vec![choice("may", "0.1", Some(0.0), Grade::Unchecked)], vec![Some(0.0)]);
        assert_eq!(row(&still)[2..], ["0.1 (not checked)", "1e-4"]);
        assert_eq!(
            row(&told),
            ["PIT300", "year", "1e-4 (0 %, good)", "1e-3", "1e-4 (at most 25 %)"]
        );
        let alone = Deployed { is_by_model: false, ..told.clone() };
        assert_eq!(header(&[told]), ["sensor", "model", "april", "july", "for all"]);
        assert_eq!(row(&alone), ["PIT300", "1e-4 (0 %, good)", "1e-3", "1e-4 (at most 25 %)"]);
        let table = report_table(std::slice::from_ref(&alone)).expect("a row");
        assert_eq!(table.columns, ["sensor", "april", "july", "for all"]);
        assert!(!table.caption.contains("model"), "{}", table.caption);
    }

    fn not_learnt(deployment: &str) -> Choice {
        choice(deployment, "1e-4", Some(0.0), Grade::NotLearnt)
    }

    #[test]
    fn what_is_not_learnt_is_not_recommended() {
        let told = deployed(vec![not_learnt("april"), not_learnt("july")], vec![Some(0.0); 2]);
        assert_eq!(row(&told)[2..], ["not learned", "not learned", "not learned"]);
        let fair = choice("april", "1e-4", Some(0.1), Grade::Fair);
        let told = deployed(vec![fair, not_learnt("july")], vec![Some(0.1), Some(0.0)]);
        assert_eq!(
            row(&told)[2..],
            ["1e-4 (10 %, fair)", "not learned", "1e-4 (at most 10 %; not learned in july)"]
        );
    }
}
