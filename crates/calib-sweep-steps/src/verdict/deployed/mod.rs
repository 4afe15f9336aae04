//! What to deploy if a study has several deployments: a choice for each, and one for all.

mod evidence;

use calib_agent::SimplePredictor;
use calib_base::{
    StepError,
    output::{Printer, percent, table},
};
use calib_report::{Cell, Table};
use calib_sweep::{Candidate, Grade, Recommendation, SensorVerdict};
use schemars::JsonSchema;
use serde::Serialize;
use serde_json::{Map, Value};

use crate::verdict::{
    judged::SensorChoice,
    judged_model::{JudgedModel, by_deployment},
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
    /// What to do if all deployments get the same. It is an agent only if one of them is to get an agent.
    pub(crate) for_all_recommendation: Recommendation,
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
    /// The recommendation for this deployment, as in its own report.
    pub(crate) recommendation: Recommendation,
    /// The simple predictor to use instead of the agent, as in the deployment's own summary.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) simple_predictor: Option<SimplePredictor>,
}

impl Deployed {
    /// Whether the advice differs between deployments.
    fn disagrees(&self) -> bool {
        self.choices.iter().any(|choice| choice.advice() != self.choices[0].advice())
    }

    /// Whether an agent is to be deployed anywhere.
    fn has_agent(&self) -> bool {
        self.choices.iter().any(Choice::has_agent)
    }
}

/// Returns [`Deployed::for_all_recommendation`].
fn for_all_recommendation(choices: &[Choice]) -> Recommendation {
    let agents = [Recommendation::Deploy, Recommendation::NotChecked, Recommendation::KeepDefault];
    let use_simple = Recommendation::UseSimplePredictor;
    let mut agents = agents.into_iter();
    match agents.find(|&agent| choices.iter().any(|own| own.recommendation == agent)) {
        Some(agent) => agent,
        None if choices.iter().all(|own| own.recommendation == use_simple) => use_simple,
        None => Recommendation::DoNotDeploy,
    }
}

impl Choice {
    fn is_not_learnt(&self) -> bool {
        self.grade == Grade::NotLearnt
    }

    /// Whether the advice is an agent, with the chosen values or the default ones.
    fn has_agent(&self) -> bool {
        match self.recommendation {
            Recommendation::Deploy | Recommendation::KeepDefault | Recommendation::NotChecked => {
                true
            }
            Recommendation::UseSimplePredictor | Recommendation::DoNotDeploy => false,
        }
    }

    /// Whether the sensor is constant, so that a regret of 0 is meaningless.
    fn stands_still(&self) -> bool {
        self.grade == Grade::Unchecked && self.regret.is_some()
    }

    /// Returns the advice without its regret and grade, such as "1e-4" or "no agent: persistence".
    fn advice(&self) -> String {
        let word = self.grade.word();
        match self.recommendation {
            Recommendation::Deploy | Recommendation::NotChecked => self.chosen.clone(),
            Recommendation::KeepDefault => "the default".to_owned(),
            Recommendation::UseSimplePredictor => match self.simple_predictor {
                Some(predictor) => format!("no agent: {}", predictor.label()),
                None => "no agent".to_owned(),
            },
            Recommendation::DoNotDeploy if self.is_not_learnt() => word.to_owned(),
            Recommendation::DoNotDeploy => format!("no agent: {word}"),
        }
    }

    /// Returns the advice, with the regret and grade of a choice to deploy: "1e-4 (2.3 %, good)".
    fn text(&self) -> String {
        let advice = self.advice();
        let word = self.grade.word();
        match (self.recommendation, self.regret) {
            (Recommendation::NotChecked, Some(_)) => format!("{advice} ({word})"),
            (Recommendation::Deploy, Some(regret)) => {
                format!("{advice} ({}, {word})", percent(regret))
            }
            (Recommendation::KeepDefault, _) if self.grade == Grade::Poor => {
                format!("{advice} ({} is worse)", self.chosen)
            }
            _ => advice,
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
    let judged: Option<Vec<(&SensorVerdict, &SensorChoice)>> = parts
        .iter()
        .map(|part| {
            let summary = &part.judged.summary;
            let mut judged = summary.verdicts.iter().zip(&summary.choices);
            judged.find(|(verdict, _)| verdict.sensor == sensor)
        })
        .collect();
    let Some(judged) = judged else { return Ok(None) };
    let candidates = &parts[0].judged.manifest.candidates;
    let choices: Vec<Choice> = parts
        .iter()
        .zip(&judged)
        .map(|(part, (verdict, advised))| Choice {
            deployment: part.deployment_name().to_owned(),
            chosen: verdict_rows::setting(&candidates[verdict.chosen]).to_string(),
            values: values(&candidates[verdict.chosen]),
            regret: verdict.truth.as_ref().and_then(|truth| Some(truth.choice.regret?.value)),
            grade: verdict.grade,
            recommendation: advised.recommendation,
            simple_predictor: advised.simple_predictor.as_ref().map(|simple| simple.predictor),
        })
        .collect();
    let verdicts: Vec<&SensorVerdict> = judged.iter().map(|(verdict, _)| *verdict).collect();
    let for_all = evidence::choice(sensor, parts, &verdicts)?;
    let regrets = verdicts.iter().map(|verdict| {
        verdict.truth.as_ref().and_then(|truth| Some(truth.regrets.as_ref()?[for_all]))
    });
    Ok(Some(Deployed {
        sensor: sensor.to_owned(),
        model: parts[0].model_name().to_owned(),
        is_by_model: parts[0].judged.study().has_model(),
        for_all_recommendation: for_all_recommendation(&choices),
        choices,
        for_all: verdict_rows::setting(&candidates[for_all]).to_string(),
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

/// Returns the advice for all deployments, such as "1e-4 (at most 25 %; not learned in july)". It is no agent if none of
/// them is to get one.
fn for_all_text(deployed: &Deployed) -> String {
    let keeps_default = deployed.for_all_recommendation == Recommendation::KeepDefault;
    let for_all = match deployed.for_all_recommendation {
        Recommendation::Deploy | Recommendation::NotChecked => deployed.for_all.clone(),
        Recommendation::KeepDefault => "the default".to_owned(),
        Recommendation::UseSimplePredictor | Recommendation::DoNotDeploy => {
            let common = (!deployed.disagrees()).then(|| deployed.choices[0].advice());
            return common.unwrap_or_else(|| "no agent".to_owned());
        }
    };
    let regrets: Vec<Option<f64>> = deployed
        .choices
        .iter()
        .zip(&deployed.regrets)
        .filter(|(choice, _)| choice.has_agent() && !choice.stands_still())
        .map(|(_, regret)| *regret)
        .collect();
    let cost = largest(&regrets)
        .filter(|_| !keeps_default)
        .map(|regret| format!("at most {}", percent(regret)));
    let (not_learnt, without): (Vec<&Choice>, Vec<&Choice>) = deployed
        .choices
        .iter()
        .filter(|choice| !choice.has_agent())
        .partition(|choice| choice.is_not_learnt());
    let excepted = [("not learned", not_learnt), ("no agent", without)]
        .into_iter()
        .filter(|(_, choices)| !choices.is_empty())
        .map(|(word, choices)| {
            let names: Vec<&str> = choices.iter().map(|own| own.deployment.as_str()).collect();
            format!("{word} in {}", names.join(", "))
        });
    let told: Vec<String> = cost.into_iter().chain(excepted).collect();
    if told.is_empty() { for_all } else { format!("{for_all} ({})", told.join("; ")) }
}

/// Prints the choices side by side. Prints nothing unless there are several deployments.
pub(crate) fn show(rows: &[Deployed], printer: &Printer) -> Result<(), StepError> {
    if rows.is_empty() {
        return Ok(());
    }
    printer.result("")?;
    printer.result(match rows.iter().any(Deployed::disagrees) {
        _ if rows.iter().flat_map(|row| &row.choices).all(Choice::is_not_learnt) => {
            "what to deploy: nothing, as no setting learns any sensor in any deployment"
        }
        _ if !rows.iter().any(Deployed::has_agent) => {
            "what to deploy: no agent for any sensor in any deployment"
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
            "The choice for each deployment, in brackets its regret on held-out data and its grade. The setting for all is what the study's rule chooses {evidence}, with the largest of its regrets. It is left out where no deployment is to get an agent."
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
            recommendation: match grade {
                Grade::Good | Grade::Fair => Recommendation::Deploy,
                Grade::Simpler => Recommendation::UseSimplePredictor,
                Grade::Poor | Grade::NotLearnt => Recommendation::DoNotDeploy,
                Grade::Unchecked => Recommendation::NotChecked,
            },
            simple_predictor: None,
        }
    }

    fn deployed(choices: Vec<Choice>, regrets: Vec<Option<f64>>) -> Deployed {
        Deployed {
            sensor: "PIT300".to_owned(),
            model: "year".to_owned(),
            is_by_model: true,
            for_all_recommendation: for_all_recommendation(&choices),
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

    /// Returns a choice whose advice is persistence: because it is better, or because the agent is good but need not
    /// learn.
    fn simple(deployment: &str, grade: Grade) -> Choice {
        Choice {
            recommendation: Recommendation::UseSimplePredictor,
            simple_predictor: Some(SimplePredictor::Persistence),
            ..choice(deployment, "0.01", Some(0.0), grade)
        }
    }

    #[test]
    fn no_agent_is_named_for_all_where_no_deployment_gets_one() {
        let both = vec![simple("april", Grade::Simpler), simple("july", Grade::Good)];
        let told = deployed(both, vec![Some(0.0); 2]);
        assert_eq!(row(&told)[2..], ["no agent: persistence"; 3]);
        assert_eq!(told.for_all_recommendation, Recommendation::UseSimplePredictor);
        assert!(!told.disagrees());
        let poor = choice("july", "0.01", Some(0.3), Grade::Poor);
        let told = deployed(vec![simple("april", Grade::Simpler), poor], vec![Some(0.0); 2]);
        assert_eq!(row(&told)[2..], ["no agent: persistence", "no agent: poor", "no agent"]);
        assert_eq!(told.for_all_recommendation, Recommendation::DoNotDeploy);
        let fair = choice("july", "1e-4", Some(0.1), Grade::Fair);
        let told =
            deployed(vec![simple("april", Grade::Simpler), fair], vec![Some(0.9), Some(0.1)]);
        assert_eq!(row(&told)[4], "1e-4 (at most 10 %; no agent in april)");
        assert_eq!(told.for_all_recommendation, Recommendation::Deploy);
    }

    #[test]
    fn a_default_that_is_better_is_kept_for_all() {
        let kept = ["april", "july"].map(|deployment| Choice {
            recommendation: Recommendation::KeepDefault,
            ..choice(deployment, "0.01", Some(0.3), Grade::Poor)
        });
        let told = deployed(kept.into(), vec![Some(0.3); 2]);
        let default = "the default (0.01 is worse)";
        assert_eq!(row(&told)[2..], [default, default, "the default"]);
    }

    #[test]
    fn an_agent_for_all_needs_a_deployment_that_gets_one() {
        let recommendations = [
            Recommendation::Deploy,
            Recommendation::KeepDefault,
            Recommendation::UseSimplePredictor,
            Recommendation::DoNotDeploy,
            Recommendation::NotChecked,
        ];
        let grades = [
            Grade::Good,
            Grade::Fair,
            Grade::Simpler,
            Grade::Poor,
            Grade::NotLearnt,
            Grade::Unchecked,
        ];
        for [one, other] in
            recommendations.iter().flat_map(|&one| recommendations.map(|other| [one, other]))
        {
            for [april, july] in grades.iter().flat_map(|&one| grades.map(|other| [one, other])) {
                let advised = [("april", one, april), ("july", other, july)];
                let choices = advised.map(|(deployment, recommendation, grade)| Choice {
                    recommendation,
                    ..choice(deployment, "0.01", Some(0.2), grade)
                });
                let gets_one = choices.iter().any(Choice::has_agent);
                let told = deployed(choices.into(), vec![Some(0.2); 2]);
                let text = for_all_text(&told);
                let names_agent = text.starts_with("1e-4") || text.starts_with("the default");
                assert_eq!(names_agent, gets_one, "{told:?}: {text}");
                let no_agent = [Recommendation::UseSimplePredictor, Recommendation::DoNotDeploy];
                assert_eq!(!no_agent.contains(&told.for_all_recommendation), gets_one);
            }
        }
    }
}
