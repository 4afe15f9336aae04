//! Runs a step for each model and deployment of a study.

use calib_base::{
    StepError, ensure,
    outcome::{Outcome, Told, told},
    output::Printer,
};
use calib_study::{Job, StepKind};

/// The results of a step, one per model and deployment.
#[derive(Debug)]
pub struct Results<T> {
    parts: Vec<PartResult<T>>,
}

/// The result of a step for one model and deployment.
#[derive(Debug)]
pub struct PartResult<T> {
    /// The model, if the study compares several.
    pub model: Option<String>,
    /// The deployment, if the study has several and the step runs once per deployment.
    pub deployment: Option<String>,
    /// The result.
    pub result: T,
}

impl<T> Results<T> {
    /// Returns all results, in the order of the models and deployments.
    pub fn parts(&self) -> &[PartResult<T>] {
        &self.parts
    }

    /// Returns the only result, if the study has one model and one deployment.
    pub fn only(mut self) -> Option<T> {
        if self.parts.len() == 1 { self.parts.pop().map(|part| part.result) } else { None }
    }
}

impl<T> From<Vec<PartResult<T>>> for Results<T> {
    fn from(parts: Vec<PartResult<T>>) -> Self {
        Self { parts }
    }
}

impl<T: Told> Results<T> {
    /// Returns the outcome of the step: that of its last part that was not simply done.
    pub fn outcome(&self) -> Outcome {
        let ended = self.parts.iter().map(|part| part.result.outcome());
        ended.filter(|outcome| *outcome != Outcome::Done).last().unwrap_or(Outcome::Done)
    }
}

/// Runs a step on each part of the study, or on the study if it has no parts. Reports each result when it is
/// ready.
pub(crate) fn each<T: Told>(
    step: StepKind,
    job: &Job,
    printer: &Printer,
    run: impl Fn(&Job) -> Result<T, StepError>,
) -> Result<Results<T>, StepError> {
    let parts = job.parts(step.scope())?;
    ensure!(
        parts.len() == 1 || !printer.is_json(),
        "--json prints one result, and the study has several; add {}",
        job.missing_names(&parts).join(" and ")
    );
    each_of(&parts, printer, run)
}

/// Runs a step of a longer chain on each part of a study, or of one of its models.
pub(crate) fn each_part<T: Told>(
    step: StepKind,
    job: &Job,
    printer: &Printer,
    run: impl Fn(&Job) -> Result<T, StepError>,
) -> Result<Outcome, StepError> {
    Ok(each_of(&job.parts(step.scope())?, printer, run)?.outcome())
}

/// Runs a step of a longer chain whose results are the same for all deployments, and reports them.
pub(crate) fn for_all_deployments<T: Told>(
    job: &Job,
    printer: &Printer,
    run: impl FnOnce(&Job) -> Result<T, StepError>,
) -> Result<Outcome, StepError> {
    let job = &job.before_deployment()?;
    Ok(told(run(job)?, job, printer)?.outcome())
}

fn each_of<T: Told>(
    parts: &[Job],
    printer: &Printer,
    run: impl Fn(&Job) -> Result<T, StepError>,
) -> Result<Results<T>, StepError> {
    let mut results = Vec::with_capacity(parts.len());
    for part in parts {
        if parts.len() > 1 {
            printer.heading(&part.name());
        }
        let result = told(run(part)?, part, printer)?;
        let model = part.model().map(str::to_owned);
        let deployment = part.deployment().map(str::to_owned);
        results.push(PartResult { model, deployment, result });
    }
    Ok(Results { parts: results })
}
