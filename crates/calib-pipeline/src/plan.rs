//! What of a study is up to date, and what a run is going to do.

use std::collections::BTreeSet;

use calib_study::{Each, Job, Made, Study};
use schemars::JsonSchema;
use serde::Serialize;

use crate::{
    StepError,
    agents::pretrain_files::PretrainManifest,
    base::artefact,
    log::{plant_of_study, prepared},
    model::model_files::ModelManifest,
    represent::RepresentationManifest,
    rollouts::rollout::RolloutManifest,
    sweep::{SweepManifest, expected::Expected, plan::OfPart},
};

/// The steps of a study in order, for `--json`.
#[derive(Debug, Default, Serialize, JsonSchema)]
pub(crate) struct Plan {
    steps: Vec<Planned>,
}

/// A step of one model and deployment.
#[derive(Debug, Serialize, JsonSchema)]
struct Planned {
    step: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    model: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    deployment: Option<String>,
    state: State,
    /// What it will take, where that is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    expected: Option<Expected>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
enum State {
    UpToDate,
    ToDo,
}

impl State {
    fn of(is_up_to_date: bool) -> Self {
        if is_up_to_date { Self::UpToDate } else { Self::ToDo }
    }
}

impl Plan {
    /// What a run of these `models` of the study would do, whose agents are trained by an `arithmetic` that is not calib's own, if one is named. Nothing
    /// is read but manifests, and the log if it was prepared.
    pub(crate) fn of(
        job: &Job,
        models: &[&Job],
        arithmetic: Option<&str>,
    ) -> Result<Self, StepError> {
        let mut plan = Self::default();
        let read = plan.log(&job.before_deployment()?);
        let study = job.study();
        if study.pretrain.epochs > 0 && study.pretrain.checkpoint.is_none() {
            let job = job.before_deployment()?;
            let found = artefact::read::<PretrainManifest>(&job.layout().pretrain());
            let state = read && is_same(&job, Made::Pretrained, found.map(|found| found.study));
            plan.add("pretrain", &job, state);
        }
        for model in models {
            plan.model(model, read, arithmetic)?;
        }
        plan.add("evaluate", job, false);
        Ok(plan)
    }

    fn log(&mut self, job: &Job) -> bool {
        let there = plant_of_study::data(job).is_ok_and(|data| prepared::is_there(job, &data));
        let read = there && !job.policy().redoes();
        self.add("reading the log", job, read);
        read
    }

    /// The steps of one model; what follows from what is to be done is to be done as well.
    fn model(&mut self, job: &Job, read: bool, arithmetic: Option<&str>) -> Result<(), StepError> {
        let first = job.before_deployment()?;
        let (study, paths) = (first.study(), first.layout());
        let mut current = read;
        if study.has_representation() {
            let found = artefact::read::<RepresentationManifest>(&paths.representation());
            current &= is_same(&first, Made::Representation, found.map(|found| found.study));
            self.add("represent", &first, current);
        }
        let model = artefact::read::<ModelManifest>(&paths.model());
        let content = model.as_ref().and_then(|model| model.content().ok());
        current &= is_same(&first, Made::Model, model.map(|model| model.study));
        self.add("build-model", &first, current);
        for part in job.parts(Each::Rollouts)? {
            let found = artefact::read::<RolloutManifest>(&part.layout().rollout())
                .filter(|found| Some(&found.model) == content.as_ref());
            let same = is_same(&part, Made::Rollouts, found.map(|found| found.study));
            self.add("rollout", &part, current && same);
        }
        for part in job.parts(Each::Deployment)? {
            let found = artefact::read::<SweepManifest>(&part.layout().sweep())
                .filter(|found| Some(&found.model) == content.as_ref())
                .filter(|found| found.arithmetic.as_deref() == arithmetic);
            let same = is_same(&part, Made::Sweep, found.map(|found| found.study));
            self.add("sweep", &part, current && same);
        }
        Ok(())
    }

    fn add(&mut self, step: &'static str, job: &Job, is_up_to_date: bool) {
        let owned = |name: Option<&str>| name.map(str::to_owned);
        let (model, deployment) = (owned(job.model()), owned(job.deployment()));
        self.steps.push(Planned {
            step,
            model,
            deployment,
            state: State::of(is_up_to_date),
            expected: None,
        });
    }

    /// Whether a step of this part is to be done.
    pub(crate) fn is_to_do(&self, step: &str, part: &Job) -> bool {
        let is_meant = |planned: &&Planned| {
            planned.step == step
                && planned.model.as_deref() == part.model()
                && planned.deployment.as_deref() == part.deployment()
        };
        self.steps.iter().find(is_meant).is_some_and(|planned| planned.state == State::ToDo)
    }

    /// Say what sweeps will take.
    pub(crate) fn expect(&mut self, all: &[OfPart]) {
        for OfPart { model, deployment, expected } in all {
            let is_meant = |planned: &&mut Planned| {
                planned.step == "sweep"
                    && planned.model == *model
                    && planned.deployment == *deployment
            };
            if let Some(planned) = self.steps.iter_mut().find(is_meant) {
                planned.expected = Some(expected.clone());
            }
        }
    }

    /// What is up to date, and what is to do, a line each.
    pub(crate) fn lines(&self) -> Vec<String> {
        let told = |state: State, name: &str| {
            let own = self.steps.iter().filter(|planned| planned.state == state);
            let mut seen = BTreeSet::new();
            let steps = own.clone().map(|planned| planned.step).filter(|step| seen.insert(*step));
            let steps: Vec<String> = steps.map(|step| self.named(step, state)).collect();
            (!steps.is_empty()).then(|| format!("{name}: {}", steps.join(", ")))
        };
        [told(State::UpToDate, "up to date"), told(State::ToDo, "to do")]
            .into_iter()
            .flatten()
            .collect()
    }

    /// "sweep", or "sweep (laplacian, week april)" where it is so of some of the models and deployments only.
    fn named(&self, step: &'static str, state: State) -> String {
        let all = self.steps.iter().filter(|planned| planned.step == step);
        if all.clone().all(|planned| planned.state == state) {
            return step.to_owned();
        }
        let own = all.filter(|planned| planned.state == state);
        let names: Vec<String> = own.map(Planned::whose).collect();
        format!("{step} ({})", names.join(", "))
    }
}

impl Planned {
    fn whose(&self) -> String {
        let names = [self.model.as_deref(), self.deployment.as_deref()];
        names.into_iter().flatten().collect::<Vec<_>>().join(" ")
    }
}

/// Whether what was made from `study` is what would be made now.
fn is_same(job: &Job, made: Made, study: Option<Study>) -> bool {
    !job.policy().redoes()
        && study.is_some_and(|study| job.study().differences(made, &study).is_empty())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_named_once_and_told_apart_where_they_differ() {
        let planned = |step, model: &str, state| Planned {
            step,
            model: Some(model.to_owned()),
            deployment: None,
            state,
            expected: None,
        };
        let steps = vec![
            planned("build-model", "a", State::UpToDate),
            planned("build-model", "b", State::UpToDate),
            planned("sweep", "a", State::UpToDate),
            planned("sweep", "b", State::ToDo),
            planned("evaluate", "", State::ToDo),
        ];
        let plan = Plan { steps };
        assert_eq!(
            plan.lines(),
            ["up to date: build-model, sweep (a)", "to do: sweep (b), evaluate"]
        );
    }
}
