//! A resolved study, and its steps.

use std::path::PathBuf;

use calib_pipeline::{
    BuildOptions, Job, Outcome, Printer, Request, StepError, StepResult, Told as _,
};
use calib_study::{Existing, Policy, StepKind, Writes};
use pyo3::prelude::*;

use crate::{
    errors,
    lost::Step,
    observer::watch_printer,
    work::{Needs, watched},
};

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

    /// Runs a step. Returns `"done"`, or `"negative"` if that is its answer.
    #[pyo3(signature = (name, observer=None))]
    fn step(
        &self,
        py: Python<'_>,
        name: &str,
        observer: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<&'static str> {
        let step = step(name)?;
        let job = &self.job;
        let ended = watched(py, Needs::Tables, observer, |watch| {
            let _at_work = Step::begin();
            step(job, &watch_printer(watch))
        })?;
        match ended {
            Ok(Outcome::Done) => Ok("done"),
            Ok(Outcome::Negative) => Ok("negative"),
            Ok(Outcome::Faulty) => Ok("faulty"),
            // Only clusters have this outcome, and they have no step here.
            Ok(Outcome::Incomplete) => Ok("incomplete"),
            Err(error) => Err(errors::of_step(py, &error)),
        }
    }

    /// Runs the step of agents that act. Returns what `calib control --json` prints, and the advice with all reasons.
    #[pyo3(signature = (observer=None))]
    fn control(
        &self,
        py: Python<'_>,
        observer: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<(String, Vec<String>)> {
        let job = &self.job;
        let ended = watched(py, Needs::Tables, observer, |watch| {
            let _at_work = Step::begin();
            calib_pipeline::control(job, &watch_printer(watch))
        })?;
        match ended {
            Ok(StepResult::Made(evaluation)) => {
                let summary = evaluation.to_json().map_err(|error| errors::of_step(py, &error))?;
                Ok((summary, evaluation.why()))
            }
            Ok(StepResult::Planned(_) | StepResult::Nothing(_)) => {
                unreachable!("jobs of Python are neither dry runs nor shares")
            }
            Err(error) => Err(errors::of_step(py, &error)),
        }
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

type Run = fn(&Job, &Printer) -> Result<Outcome, StepError>;

fn step(name: &str) -> PyResult<Run> {
    if name == "control_model" {
        return Ok(|job, printer| {
            calib_pipeline::control_model(job, printer).map(|_| Outcome::Done)
        });
    }
    let step = StepKind::of_command(name)
        .ok_or_else(|| errors::value(format!("no step is called {name}")))?;
    Ok(match step {
        StepKind::Simulate => {
            |job, printer| calib_pipeline::simulate(job, printer).map(|_| Outcome::Done)
        }
        StepKind::Prepare => {
            |job, printer| calib_pipeline::run(job, None, printer).map(|ended| ended.outcome())
        }
        StepKind::Pretrain => {
            |job, printer| calib_pipeline::pretrain(job, printer).map(|made| made.outcome())
        }
        StepKind::Represent => {
            |job, printer| calib_pipeline::represent(job, None, printer).map(|made| made.outcome())
        }
        StepKind::BuildModel => |job, printer| {
            calib_pipeline::build_model(job, &BuildOptions::default(), printer)
                .map(|built| built.outcome())
        },
        StepKind::Rollout => {
            |job, printer| calib_pipeline::rollout(job, printer).map(|made| made.outcome())
        }
        StepKind::Sweep => {
            |job, printer| calib_pipeline::sweep(job, None, printer).map(|swept| swept.outcome())
        }
        StepKind::Evaluate => {
            |job, printer| calib_pipeline::evaluate(job, printer).map(|judged| judged.outcome())
        }
        StepKind::Control => return Err(errors::value("Job.control runs this step")),
    })
}
