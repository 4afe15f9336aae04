//! What a sweep trains agents on, for agents of other kinds.

use std::{fmt, path::Path};

use calib_agent::{AgentConfig, CurveRule, Part, RunOutcome, score_predictions};
use calib_base::{
    StepError, artefact, ensure,
    log::{context::RunContext, partition},
    output::Printer,
};
use calib_core::{Seed, Silent, Stream};
use calib_data::Dataset;
use calib_files::{Fingerprint, FolderRecord, fingerprint_file};
use calib_model_steps::model::model_files;
use calib_study::{Job, Study};
use calib_sweep::{
    Baselines, Candidate, Environment, EnvironmentId, ErrorScale, RecordedWindow, RunRow,
    ScoringDemand, Unit, UnitResult, recorded_windows,
};
use serde_json::Value;

use crate::sweep::{
    SweepFacts,
    environments::{Environments, Sources, StreamParameters, open_all},
    groups::StudyGroup,
    setting::agent_seed,
    simple::{self, SimpleErrors},
    streams::error_scales,
    tables::{FILES, curves_table, external_runs},
};

/// The streams of a study's sweep: rollouts of every member of its model, if it has one, windows of the held-out range, windows of the log. They are those
/// that calib's own agents learn from, so that any agents can be compared over them.
pub struct SweepStreams {
    runs: Vec<StreamRun>,
    sensors: Vec<(String, usize)>,
    scales: Vec<ErrorScale>,
    dataset: Dataset,
    /// The sensors of each discount factor.
    groups: Vec<StudyGroup>,
    /// The recorded windows of each group.
    windows: Vec<Vec<RecordedWindow>>,
    manifest: SweepFacts,
    part: Part,
    curve: CurveRule,
}

/// A stream, and which run it is of.
pub struct StreamRun {
    /// Where it comes from.
    pub environment: EnvironmentId,
    /// Number of the run there.
    pub run: usize,
    /// The discount factor of the returns that are predicted on it.
    pub gamma: f64,
    /// The sensors with this discount factor, each with its column of the states.
    pub sensors: Vec<(String, usize)>,
    /// Row of the training data, or of the held-out data, that it starts from.
    pub start_row: u32,
    /// For the agents of the run, whatever their values: common random numbers.
    pub seed: Seed,
    /// Fingerprint of what it is made from.
    pub inputs: Fingerprint,
    /// The states: those of the steps, and what follows so that the last returns are complete.
    pub stream: Box<dyn Stream>,
}

/// Values of an agent's hyperparameters.
#[derive(Clone, Debug, PartialEq)]
pub struct ExternalCandidate {
    /// Fields and values.
    pub values: Vec<(String, Value)>,
    /// Whether it is what nobody has to decide.
    pub is_default: bool,
}

/// What an agent came to.
#[derive(Clone, Debug)]
pub struct ExternalResult {
    /// Position of its stream.
    pub stream: usize,
    /// The sensor that it predicted.
    pub sensor: String,
    /// Position of its candidate.
    pub candidate: usize,
    /// Errors, and the learning curve.
    pub outcome: RunOutcome,
}

impl fmt::Debug for SweepStreams {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("SweepStreams").field("runs", &self.runs.len()).finish_non_exhaustive()
    }
}

impl SweepStreams {
    /// The streams of a study whose model was built, if it has one.
    ///
    /// # Errors
    /// If the model was not built, or the log cannot be read.
    pub fn of_job(job: &Job, printer: &Printer) -> Result<Self, StepError> {
        Self::new(job, &RunContext::new(printer))
    }

    fn new(job: &Job, context: &RunContext) -> Result<Self, StepError> {
        let study = job.study();
        let model = model_files::open_if_any(job)?;
        let dataset: Dataset = partition::load(job, context)?.dataset;
        if let Some(model) = &model {
            model_files::check_data(job, &model.manifest, &dataset)?;
        }
        let only = [Candidate {
            index: 0,
            is_default: true,
            values: Vec::new(),
            agent: study.agent.clone(),
        }];
        let groups = StudyGroup::all(study, &dataset, &only, context)?;
        let sensors = model_files::sensor_columns(study, &dataset.normaliser, &dataset.profile)?;
        let scales = error_scales(&dataset, &sensors, &only);
        let streams = groups.iter().map(|group| &group.streams);
        let made = Environments::describe(job, model.as_ref(), &dataset, streams, context)?;
        let sources = Sources {
            states: model.as_ref().map(|model| &model.frames),
            model: model.as_ref().map(|model| &*model.model),
            train: Some(&dataset.train),
            held_out: dataset.held_out.as_ref(),
        };
        let mut runs = Vec::new();
        let mut windows = Vec::new();
        for (group, described) in groups.iter().zip(&made.described) {
            let parameters = StreamParameters::of(study, group.streams.demand.span)?;
            let environments = open_all(described, sources, parameters)?;
            runs.extend(runs_of(study, group, &sensors, &environments)?);
            let opened: Vec<&dyn Environment> =
                environments.iter().map(|environment| &**environment).collect();
            windows.push(recorded_windows(&opened)?);
        }
        let span = StudyGroup::longest(&groups);
        let content =
            model.as_ref().map(|model| model_files::content(&model.manifest)).transpose()?;
        let mut manifest = SweepFacts::of_nothing(study, &dataset, content, span, Vec::new());
        manifest.scales.clone_from(&scales);
        let curve = CurveRule { windows: study.sweep.curve_points };
        let part = study.part();
        Ok(Self { runs, sensors, scales, dataset, groups, windows, manifest, part, curve })
    }

    /// All streams, environment by environment, for one discount factor after the other.
    pub fn runs(&self) -> &[StreamRun] {
        &self.runs
    }

    /// The sensors to predict, each with its column of the states.
    pub fn sensors(&self) -> &[(String, usize)] {
        &self.sensors
    }

    /// Steps of every run; a stream has more states.
    pub fn steps(&self) -> usize {
        self.manifest.span.steps
    }

    /// `agent.gamma` of the study: the discount factor of sensors that have none in `agent.gammas`.
    pub fn gamma(&self) -> f64 {
        self.manifest.study.agent.gamma
    }

    /// What errors of a sensor are divided by, in normalised units.
    pub fn scale(&self, sensor: &str) -> f64 {
        self.scales.iter().find(|scale| scale.sensor == sensor).map_or(1.0, ErrorScale::unit)
    }

    /// The part of a run whose error counts.
    pub fn part(&self) -> Part {
        self.part
    }

    /// What predictions of the returns of a state column on a stream came to, with its discount factor; one for each step of the run.
    ///
    /// # Errors
    /// As [`score_predictions`]; if there is not one for each step.
    pub fn score(
        &self,
        stream: usize,
        column: usize,
        predictions: &[f32],
        updates: u64,
    ) -> Result<RunOutcome, StepError> {
        let run = &self.runs[stream];
        let steps = self.steps_of(stream);
        ensure!(
            predictions.len() == steps,
            "{} predictions for the {steps} steps of {}, run {}",
            predictions.len(),
            run.environment,
            run.run
        );
        Ok(score_predictions(&*run.stream, column, run.gamma, predictions, updates, self.curve)?)
    }

    /// Steps of the run over a stream.
    pub fn steps_of(&self, stream: usize) -> usize {
        self.steps().min(self.runs[stream].stream.len().saturating_sub(1))
    }

    /// Write what agents came to as a table that `calib_pipeline::evaluate_runs` reads, and beside it their learning curves,
    /// `curves.parquet`, and what simple predictors come to on the same windows, `simple.json`.
    ///
    /// # Errors
    /// If a field has the name of another column, or one of the files is there and calib did not write it, or cannot be
    /// written.
    pub fn write(
        &self,
        path: &Path,
        candidates: &[ExternalCandidate],
        results: &[ExternalResult],
    ) -> Result<(), StepError> {
        let candidates = candidates.iter().enumerate().map(|(index, candidate)| Candidate {
            index,
            is_default: candidate.is_default,
            values: candidate.values.clone(),
            agent: self.manifest.study.agent.clone(),
        });
        let sweep = SweepFacts {
            candidates: candidates.collect(),
            scales: self.scales.clone(),
            ..self.manifest.clone()
        };
        let units: Vec<UnitResult> = results.iter().map(|result| self.unit(result)).collect();
        let table = external_runs(&sweep, self.part, &units)?;
        let curves = curves_table(&sweep.candidates, &units);
        // The folder is the user's.
        let names = [path.file_name().unwrap_or_default().to_string_lossy().into_owned()];
        let mut record = FolderRecord::open(path.parent().unwrap_or(Path::new("")))?;
        let beside = [FILES[1], simple::FILE].map(str::to_owned);
        record.note(names.into_iter().chain(beside))?;
        artefact::write_table(curves, &path.with_file_name(FILES[1]))?;
        artefact::write_table(table, path)?;
        let mut simple = self.simple()?;
        simple.runs = Some(fingerprint_file(path)?);
        simple.write(path.parent().unwrap_or(Path::new("")))
    }

    /// What simple predictors come to where agents are judged.
    fn simple(&self) -> Result<SimpleErrors, StepError> {
        let baselines = Baselines::new(&self.dataset.train);
        let mut all = SimpleErrors::default();
        for (group, windows) in self.groups.iter().zip(&self.windows) {
            let sensors = group.own(&self.sensors);
            let predicted = (&sensors[..], &self.dataset.normaliser);
            let ScoringDemand { span, gamma, .. } = group.streams.demand;
            // What the program starts from is not known.
            let agent = AgentConfig { gamma, ..AgentConfig::default() };
            all.add(SimpleErrors::measure(&baselines, windows, predicted, &agent, span, &Silent)?);
        }
        Ok(all)
    }

    fn unit(&self, result: &ExternalResult) -> UnitResult {
        let run = &self.runs[result.stream];
        let steps = self.steps_of(result.stream);
        UnitResult {
            key: String::new(),
            unit: Unit {
                sensor: result.sensor.clone(),
                environment: run.environment,
                run: run.run,
            },
            seed: run.seed.get(),
            start_row: run.start_row,
            not_finite: None,
            rows: vec![RunRow::new(result.candidate, steps, result.outcome.clone())],
        }
    }
}

/// The streams that agents of a group's sensors are trained on, environment by environment.
fn runs_of(
    study: &Study,
    group: &StudyGroup,
    sensors: &[(String, usize)],
    environments: &[Box<dyn Environment + '_>],
) -> Result<Vec<StreamRun>, StepError> {
    let seed = agent_seed(study);
    let mut runs = Vec::new();
    for environment in environments {
        for run in 0..environment.runs() {
            let streamed = environment.stream(run)?;
            let id = environment.id();
            runs.push(StreamRun {
                environment: id,
                run,
                gamma: group.streams.demand.gamma,
                sensors: group.own(sensors),
                start_row: streamed.start_row.0,
                seed: seed.child(&id.to_string()).number(run as u64),
                inputs: environment.inputs(run),
                stream: streamed.stream,
            });
        }
    }
    Ok(runs)
}
