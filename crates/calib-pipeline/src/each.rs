//! A step of each model and deployment of a study.

use calib_study::{Job, StepKind};

use crate::{Outcome, StepError, ensure, output::Printer};

/// Whether a step is for a whole study or for one of its models and deployments.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Which {
    TheOnly,
    OneOfSeveral,
}

/// Run a step on each part of the study, or on the study if it has none.
pub(crate) fn each(
    step: StepKind,
    job: &Job,
    printer: &Printer,
    run: impl Fn(&Job, Which) -> Result<Outcome, StepError>,
) -> Result<Outcome, StepError> {
    let parts = job.parts(step.scope())?;
    if let [only] = parts.as_slice() {
        return run(only, Which::TheOnly);
    }
    ensure!(
        !printer.is_for_machines(),
        "--json prints one result, and the study has several; add {}",
        job.missing_names(&parts).join(" and ")
    );
    each_of(&parts, printer, |part| run(part, Which::OneOfSeveral))
}

/// Run a step of a longer chain on each deployment of a study, or of one of its models.
pub(crate) fn each_part(
    step: StepKind,
    job: &Job,
    printer: &Printer,
    run: impl Fn(&Job) -> Result<Outcome, StepError>,
) -> Result<Outcome, StepError> {
    match job.parts(step.scope())?.as_slice() {
        [only] => run(only),
        parts => each_of(parts, printer, run),
    }
}

fn each_of(
    parts: &[Job],
    printer: &Printer,
    run: impl Fn(&Job) -> Result<Outcome, StepError>,
) -> Result<Outcome, StepError> {
    let mut ended = Outcome::Done;
    for part in parts {
        printer.heading(&part.name());
        match run(part)? {
            Outcome::Done => {}
            other => ended = other,
        }
    }
    Ok(ended)
}
