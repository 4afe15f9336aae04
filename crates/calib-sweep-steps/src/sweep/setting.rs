//! The inputs of a sweep, before anything is trained.

use std::collections::BTreeMap;

use calib_agent::Accelerator;
use calib_base::{
    StepError,
    log::{
        context::RunContext,
        partition::{self, Parts, PretrainPart},
    },
};
use calib_core::Monitor;
use calib_data::Dataset;
use calib_model_steps::model::model_files::{self, OpenModel};
use calib_study::{Job, Study};
use calib_sweep::{
    Baselines, Candidate, Environment, Plan, PlanOptions, Program, RaceKind, SensorGroup, Span,
    Start, recorded_windows,
};

use crate::{
    agents::pretrain_files,
    program::ExternalAgents,
    sweep::{
        agent_seed::agent_seed,
        candidates::candidates_of,
        constant_sensors::ConstantSensor,
        cost::{Cost, MEASURED_STEPS, MeasuredPasses, TrainedInPass},
        environments::{Environments, Sources, StreamParameters, open_all},
        groups::{StudyGroup, planned_sensors},
        notes::standing_still,
        simple::SimpleErrors,
    },
};

/// The environments of one group of sensors.
pub type OpenedEnvironments<'a> = Vec<Box<dyn Environment + 'a>>;

/// The inputs of a sweep that can be planned.
pub struct SweepContext {
    /// The model. `None` for a study without one.
    pub model: Option<OpenModel>,
    /// The log.
    pub dataset: Dataset,
    pub(crate) pretrain: Option<PretrainPart>,
    /// The settings, in the order of the results, with the discount factors of all sensors.
    pub candidates: Vec<Candidate>,
    /// The sensors of each discount factor, with their streams.
    pub groups: Vec<StudyGroup>,
    /// The environments.
    pub environments: Environments,
    /// Name and column of each sensor.
    pub sensors: Vec<(String, usize)>,
    pub(crate) constant_sensors: Vec<ConstantSensor>,
    /// The checkpoints of pre-trained agents, by sensor.
    pub starts: BTreeMap<String, Start>,
    /// The external program that trains agents, if any.
    pub(crate) program: Option<ExternalAgents>,
    /// Notes on the agents.
    pub(crate) notes: Vec<String>,
}

/// A deployment in which nothing can be trained, with the reason.
pub struct SkippedDeployment {
    pub(crate) dataset: Dataset,
    pub(crate) model: Option<String>,
    pub(crate) candidates: Vec<Candidate>,
    /// The reason.
    pub reason: String,
}

impl SweepContext {
    /// Reads and checks all inputs of a job's sweep.
    ///
    /// # Errors
    /// Returns an error if the study is wrong, the model is missing or made from other data, the log cannot be read, or
    /// the observer asks to stop.
    pub fn of(
        job: &Job,
        context: &RunContext,
    ) -> Result<Result<Self, SkippedDeployment>, StepError> {
        let study = job.study();
        let candidates = candidates_of(study)?;
        let model = model_files::open_if_any(job)?;
        let (Parts { dataset, pretrain, .. }, groups) = scorable(job, &candidates, context)?;
        if let Some(model) = &model {
            model_files::check_data(job, &model.manifest, &dataset)?;
        }
        let groups = match groups {
            Ok(groups) => groups,
            Err(reason) => {
                let model = model.map(|model| model_files::content(&model.manifest)).transpose()?;
                return Ok(Err(SkippedDeployment { dataset, model, candidates, reason }));
            }
        };
        let streams = groups.iter().map(|group| &group.streams);
        let environments = Environments::describe(job, model.as_ref(), &dataset, streams, context)?;
        let sensors = model_files::sensor_columns(study, &dataset.normaliser, &dataset.profile)?;
        let constant_sensors = standing_still(&dataset, &groups, &sensors, context);
        let (starts, notes) =
            pretrain_files::starts(job, &dataset, pretrain.as_ref(), &sensors, &candidates)?;
        context.say_all(&notes);
        Ok(Ok(Self {
            model,
            dataset,
            pretrain,
            candidates,
            groups,
            environments,
            sensors,
            constant_sensors,
            starts,
            program: ExternalAgents::of(job)?,
            notes,
        }))
    }

    /// Returns the span of the longest streams.
    pub fn span(&self) -> Span {
        StudyGroup::longest(&self.groups)
    }

    /// Opens the environments of each group of sensors.
    ///
    /// # Errors
    /// Fails as [`EnvironmentSpec::open`](super::environments::EnvironmentSpec::open) does.
    pub fn open(&self, study: &Study) -> Result<Vec<OpenedEnvironments<'_>>, StepError> {
        let groups = self.groups.iter().enumerate();
        groups
            .map(|(number, group)| self.open_of(study, number, group.streams.demand.span))
            .collect()
    }

    /// Measures the cost of passes, by timing some steps of one.
    ///
    /// # Errors
    /// Returns an error if the sweep has no environments, agents cannot be trained, or the `monitor` asks to stop.
    pub fn cost(
        &self,
        study: &Study,
        measured: &MeasuredPasses,
        monitor: &dyn Monitor,
    ) -> Result<Cost, StepError> {
        let span = self.groups[0].streams.demand.span;
        let short = Span { steps: span.steps.min(MEASURED_STEPS), ..span };
        let environments = self.open_of(study, 0, short)?;
        Cost::measure(TrainedInPass::of(study, self), &environments, measured, monitor)
    }

    /// Opens the environments of a group, with streams of this length.
    fn open_of(
        &self,
        study: &Study,
        group: usize,
        span: Span,
    ) -> Result<OpenedEnvironments<'_>, StepError> {
        let sources = Sources::of(self.model.as_ref(), &self.dataset);
        let parameters = StreamParameters::of(study, span)?;
        open_all(&self.environments.described[group], sources, parameters)
    }

    /// Returns the errors of simple predictors on the recorded windows of the environments.
    pub(crate) fn simple_errors(
        &self,
        environments: &[OpenedEnvironments<'_>],
        baselines: &Baselines<'_>,
        monitor: &dyn Monitor,
    ) -> Result<SimpleErrors, StepError> {
        let mut all = SimpleErrors::default();
        for (group, environments) in self.groups.iter().zip(environments) {
            let windows = recorded_windows(environments)?;
            let sensors = group.own(&self.sensors);
            let predicted = (&sensors[..], &self.dataset.normaliser);
            let agent = &group.candidates[0].agent;
            let span = group.streams.demand.span;
            all.add(SimpleErrors::measure(baselines, &windows, predicted, agent, span, monitor)?);
        }
        Ok(all)
    }

    /// Returns the number of all runs: one per setting, sensor, environment and run number.
    pub(crate) fn runs(&self) -> usize {
        let groups = self.groups.iter().zip(&self.environments.described);
        let units = groups.map(|(group, described)| {
            let runs: usize = described.iter().map(|environment| environment.inputs().len()).sum();
            runs * group.own(&self.sensors).len()
        });
        units.sum::<usize>() * self.candidates.len()
    }

    /// Returns the plan of a sweep in these environments.
    pub fn plan<'a>(
        &'a self,
        study: &Study,
        environments: &'a [OpenedEnvironments<'a>],
        baselines: &'a Baselines<'a>,
        accelerator: Option<&'a dyn Accelerator>,
    ) -> Plan<'a> {
        let options = PlanOptions {
            part: study.part(),
            span: self.span(),
            curve_points: study.sweep.curve_points,
            seed: agent_seed(study),
        };
        let groups =
            self.groups.iter().zip(environments).map(|(group, environments)| SensorGroup {
                candidates: &group.candidates,
                environments: environments.iter().map(|environment| &**environment).collect(),
                span: group.streams.demand.span,
            });
        let names: Vec<&[String]> = self.groups.iter().map(|group| &group.sensors[..]).collect();
        let sensors = planned_sensors(&self.sensors, &names);
        let plan = Plan::of_groups(&self.candidates, groups.collect(), sensors, options);
        let program = self.program.as_ref().map(|program| program as &dyn Program);
        let plan = plan.starting_from(self.starts.clone()).with_baselines(Some(baselines));
        raced(plan.with_program(program).with_accelerator(accelerator), study)
    }
}

impl<'a> TrainedInPass<'a> {
    /// Returns the agents of a sweep's passes.
    pub(crate) fn of(study: &'a Study, setting: &'a SweepContext) -> Self {
        let SweepContext { groups, sensors, starts, .. } = setting;
        // The time of a pass does not depend on the discount factor.
        let group = &groups[0];
        let steps = group.streams.demand.span.steps;
        Self { study, candidates: &group.candidates, sensors, starts, steps }
    }
}

/// Turns the plan into a race, if the study has one.
pub fn raced<'a>(plan: Plan<'a>, study: &Study) -> Plan<'a> {
    match study.sweep.race {
        RaceKind::None => plan,
        RaceKind::Halving => plan.race(),
    }
}

/// Reads the log, and returns the groups of sensors with their streams. Instead of the groups it returns the reason for
/// leaving a deployment out: the log lacks its period, or no step of it can be scored.
pub(crate) fn scorable(
    job: &Job,
    candidates: &[Candidate],
    context: &RunContext,
) -> Result<(Parts, Result<Vec<StudyGroup>, String>), StepError> {
    let is_one_of_several = job.deployment().is_some();
    let parts = match partition::load(job, context) {
        Err(reason) if is_one_of_several && partition::is_outside(&reason) => {
            let rest = partition::load_training(job, context)?;
            return Ok((rest, Err(format!("{reason}"))));
        }
        parts => parts?,
    };
    let groups = match StudyGroup::all(job.study(), &parts.dataset, candidates, context) {
        Err(reason) if is_one_of_several && matches!(reason.root(), StepError::Unscorable(_)) => {
            Err(reason.to_string())
        }
        groups => Ok(groups?),
    };
    Ok((parts, groups))
}
