//! The streams of a sweep, for agents of other kinds.

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
    agent_seed::agent_seed,
    environments::{Environments, Sources, StreamParameters, open_all},
    groups::StudyGroup,
    simple::{self, SimpleErrors},
    streams::error_scales,
    tables::{FILES, curves_table, external_runs},
};

/// The streams of a study's sweep: rollouts of every ensemble member, if there is a model, windows of the held-out
/// range, and windows of the log. calib's own agents learn from the same streams, so any agents can be compared on
/// them.
pub struct SweepStreams {
    runs: Vec<StreamRun>,
    sensors: Vec<(String, usize)>,
    dataset: Dataset,
    /// The sensors of each discount factor.
    groups: Vec<StudyGroup>,
    /// The recorded windows of each group.
    windows: Vec<Vec<RecordedWindow>>,
    manifest: SweepFacts,
    part: Part,
    curve: CurveRule,
}

/// A stream and its run.
pub struct StreamRun {
    /// The environment.
    pub environment: EnvironmentId,
    /// Number of the run in the environment.
    pub run: usize,
    /// The discount factor of the predicted returns.
    pub gamma: f64,
    /// The sensors with this discount factor, each with its state column.
    pub sensors: Vec<(String, usize)>,
    /// Row of the training data, or of the held-out data, that the stream starts from.
    pub start_row: u32,
    /// Seed for all agents of the run, whatever their setting: common random numbers.
    pub seed: Seed,
    /// Fingerprint of the stream's inputs.
    pub inputs: Fingerprint,
    /// The states of the steps, and those that complete the last returns.
    pub stream: Box<dyn Stream>,
}

/// The hyperparameters of an agent.
#[derive(Clone, Debug, PartialEq)]
pub struct ExternalCandidate {
    /// Fields and values.
    pub values: Vec<(String, Value)>,
    /// Whether this is the default.
    pub is_default: bool,
}

/// The result of one training run.
#[derive(Clone, Debug)]
pub struct ExternalResult {
    /// Position of its stream.
    pub stream: usize,
    /// The predicted sensor.
    pub sensor: String,
    /// Position of its setting.
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
    /// Returns the streams of a study. Its model must have been built, if it has one.
    ///
    /// # Errors
    /// Returns an error if the model was not built, or the log cannot be read.
    pub fn of_job(job: &Job, printer: &Printer) -> Result<Self, StepError> {
        let context = &RunContext::new(printer);
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
        let streams = groups.iter().map(|group| &group.streams);
        let made = Environments::describe(job, model.as_ref(), &dataset, streams, context)?;
        let sources = Sources::of(model.as_ref(), &dataset);
        let mut runs = Vec::new();
        let mut windows = Vec::new();
        for (group, described) in groups.iter().zip(&made.described) {
            let parameters = StreamParameters::of(study, group.streams.demand.span)?;
            let environments = open_all(described, sources, parameters)?;
            runs.extend(runs_of(study, group, &sensors, &environments)?);
            windows.push(recorded_windows(&environments)?);
        }
        let span = StudyGroup::longest(&groups);
        let content =
            model.as_ref().map(|model| model_files::content(&model.manifest)).transpose()?;
        let mut manifest = SweepFacts::of_nothing(study, &dataset, content, span, Vec::new());
        manifest.scales = error_scales(&dataset, &sensors, &only);
        let curve = CurveRule { windows: study.sweep.curve_points };
        let part = study.part();
        Ok(Self { runs, sensors, dataset, groups, windows, manifest, part, curve })
    }

    /// Returns all streams, by discount factor and then by environment.
    pub fn runs(&self) -> &[StreamRun] {
        &self.runs
    }

    /// Returns the sensors to predict, each with its state column.
    pub fn sensors(&self) -> &[(String, usize)] {
        &self.sensors
    }

    /// Returns the steps of every run. A stream has more states.
    pub fn steps(&self) -> usize {
        self.manifest.span.steps
    }

    /// Returns `agent.gamma` of the study: the discount factor of sensors without an entry in `agent.gammas`.
    pub fn gamma(&self) -> f64 {
        self.manifest.study.agent.gamma
    }

    /// Returns the divisor of a sensor's errors, in normalised units.
    pub fn scale(&self, sensor: &str) -> f64 {
        let mut scales = self.manifest.scales.iter();
        scales.find(|scale| scale.sensor == sensor).map_or(1.0, ErrorScale::unit)
    }

    /// Returns the part of a run whose error counts.
    pub fn part(&self) -> Part {
        self.part
    }

    /// Scores predictions of the returns of a state column on a stream, with the stream's discount factor. There must
    /// be one prediction per step of the run.
    ///
    /// # Errors
    /// Fails as [`score_predictions`] does, and if there is not one prediction per step.
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

    /// Returns the steps of the run over a stream.
    pub fn steps_of(&self, stream: usize) -> usize {
        self.manifest.span.steps_in(self.runs[stream].stream.len())
    }

    /// Writes results of agents as a table that `calib_pipeline::evaluate_runs` reads. Beside it, writes their learning
    /// curves, `curves.parquet`, and the errors of simple predictors on the same windows, `simple.json`.
    ///
    /// # Errors
    /// Returns an error if a field has the name of another column, if one of the files exists and calib did not write
    /// it, or if it cannot be written.
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
        let sweep = SweepFacts { candidates: candidates.collect(), ..self.manifest.clone() };
        let units: Vec<UnitResult> = results.iter().map(|result| self.unit(result)).collect();
        let table = external_runs(&sweep, self.part, &units)?;
        let curves = curves_table(&sweep.candidates, &units);
        // The folder belongs to the user.
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

    /// Returns the errors of simple predictors on the windows that agents are judged on.
    fn simple(&self) -> Result<SimpleErrors, StepError> {
        let baselines = Baselines::new(&self.dataset.train);
        let mut all = SimpleErrors::default();
        for (group, windows) in self.groups.iter().zip(&self.windows) {
            let sensors = group.own(&self.sensors);
            let predicted = (&sensors[..], &self.dataset.normaliser);
            let ScoringDemand { span, gamma, .. } = group.streams.demand;
            // The baseline of the other program's agents is not known.
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

/// Returns the streams for agents of a group's sensors, by environment.
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
