//! Merging of all results, or none.

use std::path::Path;

use calib_base::{
    StepError,
    log::context::RunContext,
    outcome::{Outcome, told},
    output::{Printer, count, counted},
};
use calib_sweep_steps::sweep::{SharedRuns, SweepResult, put_together};

use crate::{
    cluster::{
        plan_file::OpenedPlan,
        results::{self, Completeness},
        shard_ranges::ranges,
    },
    each::{PartResult, Results},
};

/// Number of faults that are listed one by one.
const TOLD: usize = 20;

/// The sweeps of a plan, as one process would have written them.
#[derive(Debug)]
pub struct MergedSweeps {
    /// The sweep of each model and deployment.
    pub sweeps: Results<SweepResult>,
}

impl MergedSweeps {
    /// Returns the outcome of the merge. It is a success only if every sweep succeeded.
    pub fn outcome(&self) -> Outcome {
        match self.sweeps.outcome() {
            Outcome::Done => Outcome::Done,
            Outcome::Negative | Outcome::Faulty | Outcome::Incomplete => Outcome::Negative,
        }
    }
}

/// Writes the results of all shards as one process would have written them. Reports each finished sweep.
pub(crate) fn merge(directory: &Path, context: &RunContext) -> Result<MergedSweeps, StepError> {
    let opened = OpenedPlan::of(directory)?;
    opened.plan.maker.check()?;
    let pool = collect(&opened, context)?;
    context.say(&format!(
        "{} of {} are whole",
        counted(pool.len(), "result"),
        counted(opened.plan.shards.len(), "shard")
    ));
    let job = opened.plan.asked.job()?;
    let mut sweeps = Vec::with_capacity(opened.plan.parts.len());
    for part in &opened.plan.parts {
        let job = job.choose(part.model.as_deref(), part.deployment.as_deref())?;
        let name = part.name();
        if !name.is_empty() {
            context.heading(&name);
        }
        let result = told(put_together(&job, &pool, context)?, &job, context)?;
        let model = part.model.clone();
        let deployment = part.deployment.clone();
        sweeps.push(PartResult { model, deployment, result });
    }
    Ok(MergedSweeps { sweeps: sweeps.into() })
}

/// Returns the results of all shards.
///
/// # Errors
/// Reports each missing or invalid shard, and returns [`Incomplete`] if there is any.
fn collect(opened: &OpenedPlan, printer: &Printer) -> Result<SharedRuns, StepError> {
    let mut pool = SharedRuns::new();
    let mut faulty = Vec::new();
    for number in 0..opened.plan.shards.len() {
        let fault = match opened.read(number) {
            Ok(Some(results)) if results.completeness == Completeness::Whole => {
                results::add(&mut pool, results.units.into_values());
                continue;
            }
            Ok(Some(results)) => format!(
                "it has {} of {} training runs",
                count(results::training_runs(&results.units)),
                count(opened.plan.shards[number].training_runs())
            ),
            Ok(None) => "it has no results".to_owned(),
            Err(error) => error.to_string(),
        };
        if faulty.len() < TOLD {
            printer.error(&format!("shard {number}: {fault}"));
        }
        faulty.push(number);
    }
    if !faulty.is_empty() {
        let place = opened.directory.display();
        return Err(StepError::Incomplete(format!(
            "{} of {} are not whole ({}); nothing was written; run them (again), \
             or `calib cluster submit {place} --engine ENGINE --missing-only`",
            count(faulty.len()),
            counted(opened.plan.shards.len(), "shard"),
            ranges(&faulty),
        )));
    }
    Ok(pool)
}
