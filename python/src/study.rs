//! A resolved study, and its steps.

use std::path::PathBuf;

use calib_pipeline::{BuildOptions, Job, Outcome, Printer, Request, StepError, Told as _};
use calib_study::{Existing, Policy, StepKind, Writes};
use pyo3::prelude::*;
use serde::Serialize;

use crate::{errors, work::run_step};

/// A resolved study.
#[pyclass(frozen, module = "calib_rl._calib", name = "Job")]
pub(crate) struct PyJob {
    pub(crate) job: Job,
}

#[pymethods]
impl PyJob {
    /// Resolves the study in a file, or `text` as the content of that file.
    #[new]
    #[expect(clippy::too_many_arguments, reason = "what may be typed beside a study")]
    #[pyo3(signature = (path, text=None, *, set=Vec::new(), profile=None, model=None, deployment=None, output=None, redo=false))]
    fn new(
        py: Python<'_>,
        path: PathBuf,
        text: Option<String>,
        set: Vec<String>,
        profile: Option<String>,
        model: Option<String>,
        deployment: Option<String>,
        output: Option<PathBuf>,
        redo: bool,
    ) -> PyResult<Self> {
        let existing = if redo { Existing::Redo } else { Existing::Keep };
        let policy = Policy { existing, writes: Writes::Missing, share: None };
        let request = Request { study: path, set, profile, model, deployment, output, policy };
        let job = match text {
            Some(text) => Job::of_text(request, text),
            None => Job::resolve(request),
        };
        Ok(Self { job: job.map_err(|error| errors::of_study(py, &error))? })
    }

    /// Runs a step whose results are in its folder.
    #[pyo3(signature = (name, observer=None))]
    fn step(
        &self,
        py: Python<'_>,
        name: &str,
        observer: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        let step = step(name)?;
        run_step(py, observer, |printer| step(&self.job, printer))
    }

    /// Runs all steps of a study of agents that predict. Returns the verdict.
    #[pyo3(signature = (observer=None))]
    fn run(&self, py: Python<'_>, observer: Option<&Bound<'_, PyAny>>) -> PyResult<VerdictJson> {
        let run = run_step(py, observer, |printer| calib_pipeline::run(&self.job, None, printer))?;
        let outcome = run.outcome();
        verdict_json(&product(run.evaluation), outcome)
    }

    /// Runs the step that judges the sweep. Returns the verdict.
    #[pyo3(signature = (observer=None))]
    fn evaluate(
        &self,
        py: Python<'_>,
        observer: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<VerdictJson> {
        let ended = run_step(py, observer, |printer| calib_pipeline::evaluate(&self.job, printer))?;
        let evaluation = product(ended.made());
        verdict_json(&evaluation, evaluation.outcome())
    }

    /// Runs the step of agents that act. Returns what `calib control --json` prints, and the advice with all reasons.
    #[pyo3(signature = (observer=None))]
    fn control(
        &self,
        py: Python<'_>,
        observer: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<(String, Vec<String>)> {
        let ended = run_step(py, observer, |printer| calib_pipeline::control(&self.job, printer))?;
        let evaluation = product(ended.made());
        let summary = evaluation.to_json().map_err(|error| errors::of_step(py, &error))?;
        Ok((summary, evaluation.why()))
    }

    /// Returns the path of a step's results: `"model"`, `"rollout"`, `"sweep"`, `"evaluate"`, `"control"`, `"report"`, or
    /// `"root"` for all of them.
    fn path(&self, name: &str) -> PyResult<PathBuf> {
        let layout = self.job.layout();
        Ok(match name {
            "root" => layout.root().to_owned(),
            "study" => layout.study().to_owned(),
            "control_model" => layout.control_model(),
            "report" => layout.report(),
            folder => match StepKind::of_folder(folder) {
                Some(step) => layout.directory(step),
                None => return Err(errors::value(format!("no results are called {folder}"))),
            },
        })
    }

    /// Returns the resolved study, as JSON.
    fn json(&self) -> PyResult<String> {
        serde_json::to_string(self.job.study()).map_err(errors::unusable)
    }

    /// Returns whether the study is about agents that act, and has no sensors to predict.
    #[getter]
    fn is_of_acting_agents(&self) -> bool {
        self.job.study().is_of_acting_agents()
    }

    /// Returns whether the study has a calibration model.
    #[getter]
    fn has_model(&self) -> bool {
        self.job.study().has_model()
    }

    /// Returns the command that runs the same step on the command line.
    fn command(&self, step: &str) -> PyResult<String> {
        let step = StepKind::of_command(step)
            .ok_or_else(|| errors::value(format!("no step is called {step}")))?;
        Ok(self.job.command(step))
    }
}

/// What `calib evaluate --json` prints, and whether the answer is negative.
pub(crate) type VerdictJson = (String, bool);

/// Converts a verdict for Python.
pub(crate) fn verdict_json(summary: &impl Serialize, outcome: Outcome) -> PyResult<VerdictJson> {
    let summary = serde_json::to_string(summary).map_err(errors::unusable)?;
    Ok((summary, outcome == Outcome::Negative))
}

/// Returns the product of a step.
fn product<T>(made: Option<T>) -> T {
    made.unwrap_or_else(|| unreachable!("jobs of Python are neither dry runs nor shares"))
}

type Run = fn(&Job, &Printer) -> Result<(), StepError>;

fn step(name: &str) -> PyResult<Run> {
    if name == "control_model" {
        return Ok(|job, printer| calib_pipeline::control_model(job, printer).map(drop));
    }
    let step = StepKind::of_command(name)
        .ok_or_else(|| errors::value(format!("no step is called {name}")))?;
    Ok(match step {
        StepKind::Simulate => |job, printer| calib_pipeline::simulate(job, printer).map(drop),
        StepKind::Pretrain => |job, printer| calib_pipeline::pretrain(job, printer).map(drop),
        StepKind::Represent => {
            |job, printer| calib_pipeline::represent(job, None, printer).map(drop)
        }
        StepKind::BuildModel => |job, printer| {
            calib_pipeline::build_model(job, &BuildOptions::default(), printer).map(drop)
        },
        StepKind::Rollout => |job, printer| calib_pipeline::rollout(job, printer).map(drop),
        StepKind::Sweep => |job, printer| calib_pipeline::sweep(job, None, printer).map(drop),
        StepKind::Prepare | StepKind::Evaluate | StepKind::Control => {
            return Err(errors::value(format!("Job.{name} runs this step")));
        }
    })
}
