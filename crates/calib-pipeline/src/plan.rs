//! The plan of a run: the steps of a study that are up to date, and those to do.

use std::{collections::BTreeSet, path::Path};

use calib_base::{
    StepError,
    artefact::{self, Artefact, Facts},
    cost::{ExpectedStep, StepCost},
    log::{context::RunContext, plant_of_study, prepared},
    output::{bytes, duration_of_secs},
};
use calib_model_steps::{
    model::model_files::{self, ModelManifest},
    represent::RepresentationManifest,
    rollouts::rollout::RolloutManifest,
};
use calib_study::{Job, Scope, StepKind};
use calib_sweep_steps::{
    agents::pretrain_files::PretrainManifest,
    sweep::{SweepManifest, expected::Expected, plan::PartPlan},
};
use schemars::JsonSchema;
use serde::Serialize;

/// The steps of a study in order, for `--json`.
#[derive(Debug, Default, Serialize, JsonSchema)]
pub(crate) struct Plan {
    steps: Vec<PlannedStep>,
}

/// A step for one model and deployment.
#[derive(Debug, Serialize, JsonSchema)]
pub(crate) struct PlannedStep {
    #[schemars(with = "String")]
    pub(crate) step: StepKind,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) model: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) deployment: Option<String>,
    pub(crate) state: State,
    /// Passes and time of a sweep, if known.
    #[serde(skip_serializing_if = "Option::is_none")]
    expected: Option<Expected>,
    /// Expected cost of the step, if known.
    #[serde(skip_serializing_if = "Option::is_none")]
    cost: Option<StepCost>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum State {
    UpToDate,
    ToDo,
}

impl Plan {
    /// Plans a run of these `models` of the study. `arithmetic` names the arithmetic that trains agents, if it is not
    /// calib's own. Only manifests are read, and the log if it was prepared.
    pub(crate) fn of(
        job: &Job,
        models: &[&Job],
        arithmetic: Option<&str>,
        context: &RunContext,
    ) -> Result<Self, StepError> {
        let mut plan = Self::default();
        for step in [StepKind::Prepare, StepKind::Pretrain] {
            plan.add(step, job, arithmetic, context)?;
        }
        for model in models {
            for step in StepKind::OF_MODELS {
                plan.add(step, model, arithmetic, context)?;
            }
        }
        plan.steps.push(PlannedStep::new(StepKind::Evaluate, job, State::ToDo));
        Ok(plan)
    }

    /// Adds a step for each part of a job, if its study needs it. A step is to do if one of its prerequisites is.
    fn add(
        &mut self,
        step: StepKind,
        job: &Job,
        arithmetic: Option<&str>,
        context: &RunContext,
    ) -> Result<(), StepError> {
        if !job.study().needs(step) {
            return Ok(());
        }
        let parts = match step.scope() {
            // Results before rollouts are the same for all deployments.
            scope @ (Scope::Study | Scope::Model) => job.before_deployment()?.parts(scope)?,
            scope => job.parts(scope)?,
        };
        for part in parts {
            let waits = step.prerequisites().iter().any(|before| self.is_to_do(*before, &part));
            let is_kept =
                !waits && !part.policy().redoes() && is_kept(step, &part, arithmetic, context);
            let state = if is_kept { State::UpToDate } else { State::ToDo };
            self.steps.push(PlannedStep::new(step, &part, state));
        }
        Ok(())
    }

    /// Adds the simulation of the log, which comes before all other steps.
    pub(crate) fn simulate_first(&mut self, job: &Job) {
        self.steps.insert(0, PlannedStep::new(StepKind::Simulate, job, State::ToDo));
    }

    pub(crate) fn steps(&self) -> &[PlannedStep] {
        &self.steps
    }

    /// Whether a step is to do that this part of the study has, or shares with others.
    pub(crate) fn is_to_do(&self, step: StepKind, part: &Job) -> bool {
        self.steps
            .iter()
            .find(|planned| planned.step == step && planned.is_of(part))
            .is_some_and(|planned| planned.state == State::ToDo)
    }

    /// Whether a step is to do for any deployment of a model, or for the study.
    pub(crate) fn has_to_do(&self, step: StepKind, model: &Job) -> bool {
        self.steps.iter().any(|planned| {
            planned.step == step
                && planned.state == State::ToDo
                && (planned.model.is_none() || planned.model.as_deref() == model.model())
        })
    }

    /// Adds the expected cost of sweeps.
    pub(crate) fn expect(&mut self, all: &[PartPlan]) {
        for PartPlan { model, deployment, expected } in all {
            if let Some(planned) =
                self.planned(StepKind::Sweep, model.as_deref(), deployment.as_deref())
            {
                planned.expected = Some(expected.clone());
            }
        }
    }

    /// Adds the expected costs of steps.
    pub(crate) fn add_costs(&mut self, all: &[ExpectedStep]) {
        for ExpectedStep { step, model, deployment, cost } in all {
            if let Some(planned) = self.planned(*step, model.as_deref(), deployment.as_deref()) {
                planned.cost = Some(*cost);
            }
        }
    }

    /// Returns the planned step of a model and a deployment.
    fn planned(
        &mut self,
        step: StepKind,
        model: Option<&str>,
        deployment: Option<&str>,
    ) -> Option<&mut PlannedStep> {
        self.steps.iter_mut().find(|planned| {
            planned.step == step
                && planned.model.as_deref() == model
                && planned.deployment.as_deref() == deployment
        })
    }

    /// Returns a line on the cost of all steps that are to do, if that of any is known. It names the other steps.
    pub(crate) fn in_all(&self) -> Option<String> {
        let to_do = self.steps.iter().filter(|planned| planned.state == State::ToDo);
        let cost = to_do.clone().filter_map(|planned| planned.cost).reduce(StepCost::then)?;
        let unknown = to_do.filter(|planned| planned.cost.is_none());
        let unknown: BTreeSet<StepKind> = unknown.map(|planned| planned.step).collect();
        let unknown: Vec<&str> = unknown.into_iter().map(StepKind::label).collect();
        let without = if unknown.is_empty() {
            String::new()
        } else {
            format!("; without the time of {}", unknown.join(", "))
        };
        Some(format!(
            "In all: about {} of a processor on this machine, up to {} of memory, up to {} on disk{without}",
            duration_of_secs(cost.processor_secs),
            bytes(cost.memory),
            bytes(cost.disk),
        ))
    }

    /// Returns one line on the steps that are up to date, and one on those to do.
    pub(crate) fn lines(&self) -> Vec<String> {
        [self.line(State::UpToDate, "up to date"), self.line(State::ToDo, "to do")]
            .into_iter()
            .flatten()
            .collect()
    }

    /// Returns a line on the steps in a state, after its name, if there are any.
    fn line(&self, state: State, name: &str) -> Option<String> {
        let own = self.steps.iter().filter(|planned| planned.state == state);
        // In the order of execution: each step runs for all models before the next one.
        let steps: BTreeSet<StepKind> = own.map(|planned| planned.step).collect();
        let steps: Vec<String> = steps.into_iter().map(|step| self.named(step, state)).collect();
        (!steps.is_empty()).then(|| format!("{name}: {}", steps.join(", ")))
    }

    /// Returns "sweep", or "sweep (laplacian, week april)" if this holds only for some of the models and deployments.
    fn named(&self, step: StepKind, state: State) -> String {
        let all = self.steps.iter().filter(|planned| planned.step == step);
        if all.clone().all(|planned| planned.state == state) {
            return step.label().to_owned();
        }
        let own = all.filter(|planned| planned.state == state);
        let names: Vec<String> = own.map(PlannedStep::whose).collect();
        format!("{} ({})", step.label(), names.join(", "))
    }
}

impl PlannedStep {
    fn new(step: StepKind, part: &Job, state: State) -> Self {
        let model = part.model().map(str::to_owned);
        let deployment = part.deployment().map(str::to_owned);
        Self { step, model, deployment, state, expected: None, cost: None }
    }

    /// Whether the step covers this part of the study, alone or with others.
    fn is_of(&self, part: &Job) -> bool {
        let model = self.model.as_deref();
        let deployment = self.deployment.as_deref();
        (model.is_none() || model == part.model())
            && (deployment.is_none() || deployment == part.deployment())
    }

    /// Returns the model and the deployment of the step, if it does not cover all.
    fn whose(&self) -> String {
        let names = [self.model.as_deref(), self.deployment.as_deref()];
        names.into_iter().flatten().collect::<Vec<_>>().join(" ")
    }
}

/// Whether the stored results of a step for this part are what the step would make now.
fn is_kept(step: StepKind, part: &Job, arithmetic: Option<&str>, context: &RunContext) -> bool {
    let directory = &part.layout().directory(step);
    let study = match step {
        StepKind::Prepare => {
            return plant_of_study::data_of(part)
                .is_ok_and(|data| prepared::is_there(part, &data, context));
        }
        StepKind::Pretrain => whole(directory).map(|found: PretrainManifest| found.facts.study),
        StepKind::Represent => {
            whole(directory).map(|found: RepresentationManifest| found.facts.study)
        }
        StepKind::BuildModel => whole(directory).map(|found: ModelManifest| found.facts.study),
        StepKind::Rollout => whole(directory)
            .filter(|found: &RolloutManifest| Some(&found.model) == model_content(part).as_ref())
            .map(|found| found.facts.study),
        StepKind::Sweep => whole(directory)
            .filter(|found: &SweepManifest| found.missing_runs(directory).is_empty())
            .filter(|found| found.model == model_content(part))
            .filter(|found| found.arithmetic.as_deref() == arithmetic)
            .map(|found| found.facts.study),
        // These steps decide for themselves when they run.
        StepKind::Simulate | StepKind::Evaluate | StepKind::Control => None,
    };
    study.is_some_and(|study| part.study().differences(step, &study).is_empty())
}

/// Returns the manifest of a step's directory, if all its files exist.
fn whole<T: Facts>(directory: &Path) -> Option<Artefact<T>> {
    artefact::read::<Artefact<T>>(directory).filter(|found| found.has_files(directory))
}

/// Returns the content fingerprint of a part's model, if it has one.
fn model_content(part: &Job) -> Option<String> {
    model_files::content_of(part).ok().flatten()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn planned(step: StepKind, model: &str, state: State) -> PlannedStep {
        PlannedStep {
            step,
            model: Some(model.to_owned()),
            deployment: None,
            state,
            expected: None,
            cost: None,
        }
    }

    fn expected(step: StepKind, model: &str, processor_secs: f64) -> ExpectedStep {
        let cost = StepCost { processor_secs, memory: 1 << 20, disk: 512 };
        ExpectedStep { step, model: Some(model.to_owned()), deployment: None, cost }
    }

    #[test]
    fn costs_add_up_and_unknown_ones_are_named() {
        let steps = vec![
            planned(StepKind::BuildModel, "a", State::UpToDate),
            planned(StepKind::BuildModel, "b", State::ToDo),
            planned(StepKind::Sweep, "a", State::ToDo),
            planned(StepKind::Sweep, "b", State::ToDo),
            planned(StepKind::Evaluate, "", State::ToDo),
        ];
        let mut plan = Plan { steps };
        assert_eq!(plan.in_all(), None);
        plan.add_costs(&[
            expected(StepKind::BuildModel, "b", 1.5),
            expected(StepKind::Sweep, "a", 2.0),
            expected(StepKind::Sweep, "b", 3.0),
            expected(StepKind::Sweep, "c", 100.0),
        ]);
        let told = plan.in_all().expect("costs");
        assert_eq!(
            told,
            "In all: about 6.5 s of a processor on this machine, up to 1.0 MiB of memory, up to 1.5 KiB on disk; \
             without the time of evaluate"
        );
    }

    #[test]
    fn steps_are_named_once_and_told_apart_where_they_differ() {
        let steps = vec![
            planned(StepKind::BuildModel, "a", State::UpToDate),
            planned(StepKind::BuildModel, "b", State::UpToDate),
            planned(StepKind::Sweep, "a", State::UpToDate),
            planned(StepKind::Sweep, "b", State::ToDo),
            planned(StepKind::Evaluate, "", State::ToDo),
        ];
        let plan = Plan { steps };
        assert_eq!(
            plan.lines(),
            ["up to date: build-model, sweep (a)", "to do: sweep (b), evaluate"]
        );
    }
}
