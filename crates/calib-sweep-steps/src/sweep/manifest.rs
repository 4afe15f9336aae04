use std::path::{Path, PathBuf};

use calib_base::artefact::{Artefact, Facts};
use calib_core::{Period, Timestamp};
use calib_data::Dataset;
use calib_files::Fingerprint;
use calib_model_steps::model::model_files;
use calib_study::{StepKind, Study};
use calib_sweep::{Candidate, ErrorScale, PlannedUnit, Span};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{simple::SimpleErrors, streams::OnlineWindow, unit_store::unit_store};

/// `manifest.json` of a sweep directory.
pub type SweepManifest = Artefact<SweepFacts>;

/// A sweep, in its manifest.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct SweepFacts {
    /// Fingerprint of all units.
    pub(crate) key: String,
    #[schemars(with = "calib_base::resolved::ResolvedStudy")]
    pub study: Study,
    pub(crate) data: Fingerprint,
    /// Fingerprint of the model; none without a model.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub model: Option<String>,
    /// The training states that log replay uses. Only for a study without a model: otherwise the manifest of the model
    /// has them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) learned: Option<LearnedStates>,
    pub(crate) period: Period,
    /// The held-out states that are replayed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) held_out: Option<HeldOut>,
    /// Length of the streams; for sensors with several discount factors, of the first sensor.
    pub span: Span,
    /// The library that trained the agents, if it was not calib's own arithmetic.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub arithmetic: Option<String>,
    /// The windows of the held-out period that are replayed, in order of time.
    #[serde(default)]
    pub windows: Vec<OnlineWindow>,
    /// Streams of sensors whose discount factor differs from that of the first sensor.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) other_streams: Vec<OtherStreams>,
    /// Scales that errors are divided by.
    pub scales: Vec<ErrorScale>,
    /// Sensors that are constant in all of these windows.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) standing_still: Vec<String>,
    /// Why no agent was trained, if none was: the deployment cannot be scored.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) left_out: Option<String>,
    pub candidates: Vec<Candidate>,
    /// The fingerprint of each candidate's setting, by which its runs are found in every unit.
    pub(crate) settings: Vec<String>,
    pub(crate) units: Vec<PlannedUnit>,
    /// Notes for readers of the results.
    pub(crate) notes: Vec<String>,
    /// Errors of the simple predictors, from a file beside the manifest.
    #[serde(skip)]
    pub(crate) simple: SimpleErrors,
}

/// Streams of sensors whose discount factor differs from that of the first sensor.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub(crate) struct OtherStreams {
    pub(crate) sensors: Vec<String>,
    pub(crate) span: Span,
    /// The windows of the held-out period that are replayed.
    pub(crate) windows: Vec<OnlineWindow>,
}

/// The training states of a sweep.
#[derive(Clone, Copy, Debug, Serialize, Deserialize, JsonSchema)]
pub(crate) struct LearnedStates {
    pub(crate) rows: usize,
    pub(crate) segments: usize,
    /// Times of the first and the last state.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) times: Option<[Timestamp; 2]>,
}

impl LearnedStates {
    fn of(dataset: &Dataset) -> Self {
        let frames = &dataset.train;
        let rows = frames.rows();
        let segments = frames.segments().len();
        Self { rows, segments, times: model_files::first_and_last(frames) }
    }
}

/// The states of a deployment.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub(crate) struct HeldOut {
    pub(crate) rows: u64,
    /// Times of the first and the last state.
    pub(crate) times: [Timestamp; 2],
    /// Fingerprint of the states.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) data: Option<Fingerprint>,
}

impl HeldOut {
    fn of(dataset: &Dataset) -> Option<Self> {
        let frames = dataset.held_out.as_ref()?;
        let times = model_files::first_and_last(frames)?;
        let data = dataset.held_out_fingerprint.clone();
        Some(Self { rows: frames.rows() as u64, times, data })
    }
}

impl SweepFacts {
    /// Returns the facts of a sweep that has trained nothing yet.
    pub(crate) fn of_nothing(
        study: &Study,
        dataset: &Dataset,
        model: Option<String>,
        span: Span,
        candidates: Vec<Candidate>,
    ) -> Self {
        Self {
            data: dataset.fingerprint.clone(),
            learned: (!study.has_model()).then(|| LearnedStates::of(dataset)),
            model,
            held_out: HeldOut::of(dataset),
            ..Self::of_no_data(study, dataset.period, span, candidates)
        }
    }

    /// Returns the files of its runs that are missing from its directory.
    pub fn missing_runs(&self, directory: &Path) -> Vec<PathBuf> {
        unit_store(directory, self.arithmetic.as_deref()).missing(&self.units)
    }

    /// Returns the span of a sensor's streams.
    pub(crate) fn span_of(&self, sensor: &str) -> Span {
        self.streams_of(sensor).map_or(self.span, |other| other.span)
    }

    /// Returns the windows that Online replays for a sensor.
    pub(crate) fn windows_of(&self, sensor: &str) -> &[OnlineWindow] {
        self.streams_of(sensor).map_or(&self.windows[..], |other| &other.windows[..])
    }

    /// Returns the streams of a sensor, if they differ from those of the first sensor.
    fn streams_of(&self, sensor: &str) -> Option<&OtherStreams> {
        self.other_streams.iter().find(|other| other.sensors.iter().any(|own| own == sensor))
    }

    /// Returns this `command`, with the device that the sweep was made on, if it was one.
    pub(crate) fn again(&self, command: &str) -> String {
        let device = self.arithmetic.as_deref().and_then(|class| class.strip_prefix("libtorch-"));
        device.map_or_else(|| command.to_owned(), |device| format!("{command} --device {device}"))
    }

    /// Returns the facts of runs of another program, whose data is not known.
    pub(crate) fn of_no_data(
        study: &Study,
        period: Period,
        span: Span,
        candidates: Vec<Candidate>,
    ) -> Self {
        Self {
            key: String::new(),
            study: study.clone(),
            data: Fingerprint::of(b""),
            model: None,
            learned: None,
            period,
            held_out: None,
            span,
            arithmetic: None,
            windows: Vec::new(),
            other_streams: Vec::new(),
            scales: Vec::new(),
            standing_still: Vec::new(),
            left_out: None,
            candidates,
            settings: Vec::new(),
            units: Vec::new(),
            notes: Vec::new(),
            simple: SimpleErrors::default(),
        }
    }
}

impl Facts for SweepFacts {
    const FORMAT: u32 = 5;
    const STEP: StepKind = StepKind::Sweep;

    fn key(&self) -> &str {
        &self.key
    }
}
