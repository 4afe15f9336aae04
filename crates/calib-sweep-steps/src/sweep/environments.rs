//! The environments of a sweep: ensemble members if there is a model, Online and log replay. Their inputs are described
//! first, so that other processes can open them.

use calib_base::{Context as _, StepError, output::Printer};
use calib_core::{Frames, Seed};
use calib_data::Dataset;
use calib_files::Fingerprint;
use calib_model::{CalibrationModel, ModelStart, RequestedStart, Search, Weights};
use calib_model_steps::model::{
    kinds::search_place,
    model_files::{self, OpenModel},
    starts::{StartSummary, Starts, summaries},
};
use calib_study::{Job, Study};
use calib_sweep::{
    Environment, EnvironmentId, MemberEnvironment, ReplayEnvironment, RolloutOptions, Span, Windows,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::sweep::streams::Streams;

/// Specification of an environment, without its states and tables.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum EnvironmentSpec {
    /// A member of a calibration model's ensemble.
    Member {
        /// Index of the ensemble member, from 0.
        number: usize,
        /// Start state of each run.
        starts: Vec<ModelStart>,
        /// Fingerprint of everything that streams depend on, except their start states.
        inputs: Fingerprint,
    },
    /// The held-out period.
    Online {
        /// Windows in which streams start.
        windows: Windows,
        /// Number of runs.
        runs: usize,
        /// Fingerprint of the held-out states.
        inputs: Fingerprint,
    },
    /// Log replay: the training range.
    LogReplay {
        /// Windows in which streams start, one for each run.
        windows: Windows,
        /// Fingerprint of the training states.
        inputs: Fingerprint,
    },
}

/// The data that environments read, as far as it is available.
#[derive(Clone, Copy)]
pub struct Sources<'a> {
    /// States of the model.
    pub states: Option<&'a Frames>,
    /// The opened model.
    pub model: Option<&'a dyn CalibrationModel>,
    /// The log for log replay.
    pub train: Option<&'a Frames>,
    /// The held-out log.
    pub held_out: Option<&'a Frames>,
}

impl<'a> Sources<'a> {
    /// Returns the data of a model, if there is one, and of the log.
    pub(crate) fn of(model: Option<&'a OpenModel>, dataset: &'a Dataset) -> Self {
        Self {
            states: model.map(|model| &model.frames),
            model: model.map(|model| &*model.model),
            train: Some(&dataset.train),
            held_out: dataset.held_out.as_ref(),
        }
    }
}

/// The options of rollouts.
#[derive(Clone, Copy, Debug)]
pub struct StreamParameters {
    pub(crate) span: Span,
    pub(crate) weights: Weights,
    pub(crate) seed: Seed,
}

impl StreamParameters {
    /// Reads the options from the study.
    ///
    /// # Errors
    /// Returns an error if the weights of neighbours are not valid.
    pub fn of(study: &Study, span: Span) -> Result<Self, StepError> {
        Ok(Self { span, weights: study.model.weights()?, seed: study.seed_of_rollouts() })
    }
}

impl EnvironmentSpec {
    /// Returns the identity of the environment.
    pub fn id(&self) -> EnvironmentId {
        match self {
            Self::Member { number, .. } => EnvironmentId::Member(*number),
            Self::Online { .. } => EnvironmentId::Online,
            Self::LogReplay { .. } => EnvironmentId::LogReplay,
        }
    }

    /// Returns the fingerprint of the inputs of each run's stream, as the opened environment does.
    pub fn inputs(&self) -> Vec<Fingerprint> {
        match self {
            Self::Member { starts, inputs, .. } => vec![inputs.clone(); starts.len()],
            Self::Online { windows, runs, inputs } if !windows.starts.is_empty() => {
                (0..*runs).map(|run| windows.inputs(inputs, run)).collect()
            }
            Self::Online { .. } => Vec::new(),
            Self::LogReplay { windows, inputs } => {
                (0..windows.starts.len()).map(|run| windows.inputs(inputs, run)).collect()
            }
        }
    }

    /// Says that what it is made of is missing.
    fn lacks(&self) -> String {
        format!("what {} is made of is not there", self.id())
    }

    /// Opens the environment.
    ///
    /// # Errors
    /// Returns an error if its data is missing from the `sources`.
    pub fn open<'a>(
        &self,
        sources: Sources<'a>,
        StreamParameters { span, weights, seed }: StreamParameters,
    ) -> Result<Box<dyn Environment + 'a>, StepError> {
        Ok(match self {
            Self::Member { number, starts, inputs } => {
                let (frames, model) =
                    sources.states.zip(sources.model).with_context(|| self.lacks())?;
                let states = frames.states();
                let starts = starts.clone();
                let options = RolloutOptions { span, weights, seed, inputs: inputs.clone() };
                Box::new(MemberEnvironment::new(model, *number, states, starts, options))
            }
            Self::Online { windows, runs, inputs } => {
                let held_out = sources.held_out.with_context(|| self.lacks())?;
                let windows = windows.clone();
                let inputs = inputs.clone();
                Box::new(ReplayEnvironment::online(held_out, windows, *runs, inputs))
            }
            Self::LogReplay { windows, inputs } => {
                let train = sources.train.with_context(|| self.lacks())?;
                Box::new(ReplayEnvironment::log_replay(train, windows.clone(), inputs.clone()))
            }
        })
    }
}

/// All environments of a sweep.
pub struct Environments {
    /// The description of each environment, in the order of the sweep, for each group of sensors.
    pub described: Vec<Vec<EnvironmentSpec>>,
    /// Notes on start states.
    pub(crate) starts: Vec<String>,
}

impl Environments {
    /// Describes the members of a model, if there is one, and the windows of each of these `streams`.
    pub(crate) fn describe<'s>(
        job: &Job,
        model: Option<&OpenModel>,
        dataset: &Dataset,
        streams: impl IntoIterator<Item = &'s Streams>,
        printer: &Printer,
    ) -> Result<Self, StepError> {
        let members =
            model.map(|model| Members::describe(job, model, dataset, printer)).transpose()?;
        let Members { described, starts } = members.unwrap_or_default();
        let groups = streams.into_iter().map(|streams| {
            let all = described.iter().cloned().chain(replayed(job, dataset, streams));
            all.collect::<Vec<EnvironmentSpec>>()
        });
        Ok(Self { described: groups.collect(), starts })
    }
}

/// The members of a model.
#[derive(Default)]
struct Members {
    described: Vec<EnvironmentSpec>,
    /// Notes on start states.
    starts: Vec<String>,
}

impl Members {
    fn describe(
        job: &Job,
        model: &OpenModel,
        dataset: &Dataset,
        printer: &Printer,
    ) -> Result<Self, StepError> {
        let study = job.study();
        let paths = job.layout();
        let mut described = Vec::new();
        let configured = study.sweep_starts();
        let seed = study.seed_of_rollouts();
        let starts = Starts::new(&configured, &study.data, model, dataset.held_out.as_ref(), seed)?;
        let inputs = (
            model_files::content(&model.manifest)?,
            (study.model.weights, study.model.temperature),
            &configured,
            // Not the deployment itself: deployments with the same start states share streams.
            starts.origin(dataset.held_out_fingerprint.as_ref())?,
        );
        let inputs = match study.rollout_noise_inputs() {
            Some(noise) => serde_json::to_vec(&(inputs, noise))?,
            None => serde_json::to_vec(&inputs)?,
        };
        let inputs = Fingerprint::of(&inputs);
        // In the folder of the model, because the folder of the sweep may not exist yet.
        let place = search_place(&*model.model, &paths.model());
        let progress = printer.progress();
        let search = Search { place: &place, monitor: &progress };
        let all = starts.of_members(study.member_runs(), search)?;
        drop(progress);
        let given: Vec<Vec<(RequestedStart, Option<f32>)>> =
            all.iter().map(|starts| starts.iter().map(ModelStart::given).collect()).collect();
        for (number, starts) in all.into_iter().enumerate() {
            described.push(EnvironmentSpec::Member { number, starts, inputs: inputs.clone() });
        }
        Ok(Self { described, starts: notes(&summaries(&given)) })
    }
}

/// Describes the logs to replay.
fn replayed(job: &Job, dataset: &Dataset, streams: &Streams) -> Vec<EnvironmentSpec> {
    let mut described = Vec::new();
    if let (Some(inputs), Some(windows)) = (&dataset.held_out_fingerprint, &streams.online) {
        let windows = windows.clone();
        let inputs = inputs.clone();
        described.push(EnvironmentSpec::Online {
            windows,
            runs: job.study().sweep.online_runs,
            inputs,
        });
    }
    if !streams.log.starts.is_empty() {
        let windows = streams.log.clone();
        let inputs = dataset.fingerprint.clone();
        described.push(EnvironmentSpec::LogReplay { windows, inputs });
    }
    described
}

/// Opens all environments.
pub(crate) fn open_all<'a>(
    described: &[EnvironmentSpec],
    sources: Sources<'a>,
    parameters: StreamParameters,
) -> Result<Vec<Box<dyn Environment + 'a>>, StepError> {
    described.iter().map(|one| one.open(sources, parameters)).collect()
}

/// Returns one sentence per member with start states other than the requested ones.
fn notes(summaries: &[StartSummary]) -> Vec<String> {
    let lacking = summaries.iter().enumerate().filter(|(_, summary)| summary.replaced > 0);
    lacking
        .filter_map(|(member, summary)| {
            Some(format!("ensemble member {member}: {}", summary.text()?))
        })
        .collect()
}
