//! A judged sweep, and its summary.

use calib_agent::SimplePredictor;
use calib_base::artefact::TOOL;
use calib_data::ShownClock;
use calib_report::{RecordedFigure, caveats};
use calib_study::{Job, Layout, Study};
use calib_sweep::{Candidate, Grade, Recommendation, SensorVerdict, SimpleComparison, UnitResult};
use schemars::JsonSchema;
use serde::Serialize;
use serde_json::{Map, Value};

use crate::{sweep::SweepManifest, verdict::verdict_rows};

/// `summary.json`: the verdict in machine-readable form.
#[derive(Debug, Serialize, JsonSchema)]
pub struct Summary {
    pub(crate) format: u32,
    pub(crate) tool: &'static str,
    pub(crate) title: String,
    /// The predicted quantity, and how far ahead; none for runs that calib did not make.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) predicts: Option<String>,
    /// The choice for each sensor.
    pub(crate) choices: Vec<SensorChoice>,
    /// The advice in words, one list of lines for each sensor.
    pub(crate) advice: Vec<Vec<String>>,
    /// For each choice, its regret on held-out data, and what to do if it is not good enough.
    pub(crate) plain: Vec<String>,
    /// Labels of the settings, in the order of the indices in `verdicts`.
    pub(crate) candidates: Vec<String>,
    /// One entry for each sensor.
    pub verdicts: Vec<SensorVerdict>,
    /// Caveats to read before relying on the verdicts.
    pub(crate) caveats: Vec<String>,
    /// Other notes on the sweep.
    pub(crate) notes: Vec<String>,
}

/// The choice for a sensor.
#[derive(Debug, Serialize, JsonSchema)]
pub struct SensorChoice {
    sensor: String,
    /// The swept keys of the agent, with their values.
    values: Map<String, Value>,
    /// Whether the choice is the study's default.
    is_default: bool,
    /// How well held-out data supports the choice.
    grade: Grade,
    /// The recommendation, as in the report.
    pub(crate) recommendation: Recommendation,
    /// The simple predictor to use instead of the agent. It is one that the agent is not known to match, or the one that the
    /// agent starts from if further learning is not shown to help, or the training mean if no predictor is shown to be better.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) simple_predictor: Option<SimpleComparison>,
}

impl SensorChoice {
    /// Whether a simple predictor is to be used.
    pub(crate) fn is_simple(&self) -> bool {
        self.recommendation == Recommendation::UseSimplePredictor
    }
}

impl Summary {
    /// Creates the summary of these verdicts. Their indices refer to `candidates`, and `rows` are the same verdicts in
    /// words.
    pub(crate) fn new(
        title: String,
        verdicts: Vec<SensorVerdict>,
        rows: &[calib_report::Verdict],
        candidates: &[Candidate],
    ) -> Self {
        Self {
            format: 3,
            tool: TOOL,
            title,
            predicts: None,
            choices: choices(&verdicts, rows, candidates),
            advice: rows.iter().map(verdict_rows::advice).collect(),
            plain: rows.iter().map(calib_report::Verdict::plain).collect(),
            candidates: candidates.iter().map(Candidate::label).collect(),
            verdicts,
            caveats: caveats(rows),
            notes: Vec::new(),
        }
    }
}

fn choices(
    verdicts: &[SensorVerdict],
    rows: &[calib_report::Verdict],
    candidates: &[Candidate],
) -> Vec<SensorChoice> {
    let choices = verdicts.iter().zip(rows).map(|(verdict, row)| {
        let candidate = &candidates[verdict.chosen];
        SensorChoice {
            sensor: verdict.sensor.clone(),
            values: candidate.values.iter().cloned().collect(),
            is_default: candidate.is_default,
            grade: verdict.grade,
            recommendation: verdict.recommendation(),
            simple_predictor: verdict
                .simpler()
                .or_else(|| {
                    let mean = SimplePredictor::Mean;
                    let not_learned = (verdict.grade == Grade::NotLearnt).then_some(mean);
                    let instead = row.without_learning().or(not_learned)?;
                    verdict.simple.iter().find(|simple| simple.predictor == instead)
                })
                .cloned(),
        }
    });
    choices.collect()
}

/// A judged sweep, with everything derived from it.
pub struct Judged {
    /// The job that was judged.
    pub job: Job,
    /// The manifest of its sweep.
    pub manifest: SweepManifest,
    /// The results of all units.
    pub results: Vec<UnitResult>,
    /// The contents of `summary.json`.
    pub summary: Summary,
    /// The recorded values of each sensor.
    pub(crate) recorded: Vec<RecordedFigure>,
    /// The verdicts in words.
    pub(crate) rows: Vec<calib_report::Verdict>,
    /// The clock that times are shown on.
    pub(crate) clock: ShownClock,
}

impl Judged {
    /// Returns the study of the judged model and deployment.
    pub fn study(&self) -> &Study {
        self.job.study()
    }

    /// Returns the layout of its results.
    pub(crate) fn paths(&self) -> &Layout {
        self.job.layout()
    }
}
