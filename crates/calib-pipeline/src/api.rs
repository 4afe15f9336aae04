//! The steps, as others call them.

use std::path::Path;

use calib_base::{
    StepError,
    log::{
        context::RunContext,
        simulate::{self, Simulated},
    },
    options::{
        BuildOptions, ClusterPlanOptions, ClusterStatusOptions, ClusterSubmitOptions, Device, Logs,
        ProposeOptions, ValidityOptions,
    },
    outcome::{Outcome, StepResult, told},
    output::Printer,
    progress::recorded,
};
use calib_control::ActionModel;
use calib_model_steps::{
    model::{
        build_model::{self, BuiltModel},
        build_plan::BuildPlan,
    },
    represent::{self, Representations},
    rollouts::rollout::{self, Rollouts},
};
use calib_plant::PlantOptions;
use calib_propose::DecisionColumns;
use calib_study::{Job, StepKind, Study};
use calib_sweep_steps::{
    agents::pretrain::{self, PretrainedAgents},
    external,
    render::show_judgement,
    sweep::{self, SweepResult, plan::DryRunTally},
    verdict::{
        evaluate::Judgement,
        evaluation::{self, Evaluation},
    },
};

use crate::{
    changed_log,
    check::{self, CheckedResults},
    cluster::{
        self, ClusterDryPlan, ClusterPlan, ClusterScripts, ClusterShard, ClusterStatus,
        MergedSweeps, SubmittedPlan,
    },
    control::{self, ControlEvaluation, ControlPlan, SimulateTask, SimulatedTask},
    each::{Results, each},
    propose::{self, ProposedControlStudy, ProposedStudy},
    run_study::{self, StudyRun},
    status::{self, StandingOf, StatusRequest},
    validity::{self, ValidityAnswer, ValidityPlan},
};

/// Every step that a study needs, from its log to the verdict, as far as it is missing; representations, networks and the agents of sweeps are trained
/// through libtorch on `device`, if one is named.
///
/// # Errors
/// If the study or the data is wrong, the machine refuses, or the observer asks to stop.
pub fn run(job: &Job, device: Option<Device>, printer: &Printer) -> Result<StudyRun, StepError> {
    recorded("run", job, printer, |printer| run_study::run(job, device, &RunContext::new(printer)))
}

/// Write the log of the plant that the study describes; nothing is said of a study that describes none.
///
/// # Errors
/// As [`run`]; also if the folder holds other logs.
pub fn simulate(job: &Job, printer: &Printer) -> Result<Option<Simulated>, StepError> {
    simulate::of_study(job, printer)
}

/// Write the log of this plant, a Parquet file a day, as far as it is missing; `force` begins anew.
///
/// # Errors
/// As [`simulate()`].
pub fn simulate_plant(
    directory: &Path,
    plant: PlantOptions,
    force: bool,
    printer: &Printer,
) -> Result<Simulated, StepError> {
    simulate::simulate(directory, plant, force, printer)
}

/// Train or import representations of the states, score them, and choose one.
///
/// # Errors
/// As [`run`].
pub fn represent(
    job: &Job,
    device: Option<Device>,
    printer: &Printer,
) -> Result<Results<StepResult<Representations>>, StepError> {
    recorded(StepKind::Represent.command(), job, printer, |printer| {
        let context = &RunContext::new(printer);
        let has_several = job.parts(StepKind::Represent.scope())?.len() > 1;
        each(StepKind::Represent, job, printer, |job| {
            // Of several models some search among the states themselves.
            if has_several && !job.study().has_representation() {
                printer.say("no representation: nothing to train");
                return Ok(StepResult::Nothing(Outcome::Done));
            }
            represent::run(job, device, context)
        })
    })
}

/// Build the calibration models.
///
/// # Errors
/// As [`run`].
pub fn build_model(
    job: &Job,
    options: &BuildOptions,
    printer: &Printer,
) -> Result<Results<StepResult<BuiltModel, Option<BuildPlan>>>, StepError> {
    recorded(StepKind::BuildModel.command(), job, printer, |printer| {
        let context = &RunContext::new(printer);
        each(StepKind::BuildModel, job, printer, |job| build_model::run(job, options, context))
    })
}

/// Roll the models out, and compare with what was recorded.
///
/// # Errors
/// As [`run`].
pub fn rollout(job: &Job, printer: &Printer) -> Result<Results<StepResult<Rollouts>>, StepError> {
    recorded(StepKind::Rollout.command(), job, printer, |printer| {
        let context = &RunContext::new(printer);
        each(StepKind::Rollout, job, printer, |job| rollout::run(job, context))
    })
}

/// Pre-train one agent a sensor.
///
/// # Errors
/// As [`run`].
pub fn pretrain(job: &Job, printer: &Printer) -> Result<StepResult<PretrainedAgents>, StepError> {
    recorded(StepKind::Pretrain.command(), job, printer, |printer| {
        job.refuse_deployment()?;
        told(pretrain::run(job, &RunContext::new(printer))?, job, printer)
    })
}

/// Train agents for every value of the grid, in the models, Online and on the replayed log; through libtorch on `device`, if one is named, which
/// is an arithmetic of its own: such results never stand beside others.
///
/// # Errors
/// As [`run`]; also if agents are not networks in single precision and a device is named.
pub fn sweep(
    job: &Job,
    device: Option<Device>,
    printer: &Printer,
) -> Result<Results<SweepResult>, StepError> {
    recorded(StepKind::Sweep.command(), job, printer, |printer| {
        let context = &RunContext::new(printer);
        let tally = DryRunTally::default();
        each(StepKind::Sweep, job, printer, |job| sweep::run(job, &tally, device, context))
    })
}

/// Choose a value, judge the choice by held-out data, and write the report.
///
/// # Errors
/// As [`run`].
pub fn evaluate(job: &Job, printer: &Printer) -> Result<StepResult<Evaluation>, StepError> {
    let context = &RunContext::new(printer);
    let parts = job.parts(StepKind::Evaluate.scope())?;
    if let Some(warning) = changed_log::old_verdict(job) {
        printer.warn(&warning);
    }
    told(evaluation::run(job, &parts, &[], context)?, job, printer)
}

/// Read a log of decisions, build its model with actions, let every candidate act in it, and say which to deploy.
///
/// # Errors
/// As [`run`]; also if the study has no `[control]` section.
pub fn control(
    job: &Job,
    printer: &Printer,
) -> Result<StepResult<ControlEvaluation, ControlPlan>, StepError> {
    recorded(StepKind::Control.command(), job, printer, |printer| {
        told(control::run(job, printer)?, job, printer)
    })
}

/// Read a log of decisions and build its model with actions, if it is not there.
///
/// # Errors
/// As [`control()`].
pub fn control_model(job: &Job, printer: &Printer) -> Result<ActionModel, StepError> {
    control::build(job, printer)
}

/// Write the log of a policy in a classic task, and a study of it.
///
/// # Errors
/// If the folder cannot be written, or the observer asks to stop.
pub fn simulate_task(wanted: &SimulateTask, printer: &Printer) -> Result<SimulatedTask, StepError> {
    control::simulate(wanted, printer)
}

/// Judge runs that something else made, of a table that [`SweepStreams::write`](calib_sweep_steps::external::SweepStreams::write) wrote or that has its columns,
/// by the `[evaluate]` of a study; with `output`, write `summary.json`, figures and `report.html` there.
///
/// # Errors
/// As [`run`]; also if the table lacks a column, or a value of it is none.
pub fn evaluate_runs(
    runs: &Path,
    study: &Study,
    output: Option<&Path>,
    printer: &Printer,
) -> Result<Judgement, StepError> {
    let judged = external::runs::run(runs, study, output)?;
    show_judgement(&judged, printer)?;
    Ok(judged)
}

/// Look at a log, try small models of it, and write a study with a reason for every value.
///
/// # Errors
/// As [`run`]; also if nothing in the log can be predicted.
pub fn propose(options: &ProposeOptions, printer: &Printer) -> Result<ProposedStudy, StepError> {
    told(propose::run(options, &RunContext::new(printer))?, &(), printer)
}

/// Look at a log of decisions, time short runs of agents that act, and write a study of such agents with a reason for every value.
/// The sensors and the horizon of the options are of agents that predict: nothing asks for them here.
///
/// # Errors
/// As [`run`]; also if a column is not in the log, there are no two actions, or no action can be worth more than another.
pub fn propose_control(
    options: &ProposeOptions,
    columns: &DecisionColumns,
    printer: &Printer,
) -> Result<ProposedControlStudy, StepError> {
    told(propose::run_control(options, columns, printer)?, &(), printer)
}

/// Compare a folder of results with what was written.
///
/// # Errors
/// If there is no such folder, it holds no results, or the observer asks to stop. Damage is no error.
pub fn check(results: &Path, logs: Logs, printer: &Printer) -> Result<CheckedResults, StepError> {
    check::run(results, logs, printer)
}

/// How a study, the study of a folder of results, or a plan for a cluster stands: what is done, what runs, and how the
/// settings stand by the runs that are there. Nothing is written.
///
/// # Errors
/// If there is no such study or folder, or the study is wrong.
pub fn status(request: &StatusRequest, printer: &Printer) -> Result<StandingOf, StepError> {
    status::status(request, printer)
}

/// Judge how well calib chooses, over several studies with held-out data.
///
/// # Errors
/// As [`run`].
pub fn validity(
    options: &ValidityOptions,
    printer: &Printer,
) -> Result<StepResult<ValidityAnswer, ValidityPlan>, StepError> {
    told(validity::run(options, &RunContext::new(printer))?, &(), printer)
}

/// Divide what is left of a study's sweeps into shards, with everything that they read, in a folder of their own.
///
/// # Errors
/// As [`run`]; also if the folder holds a plan already.
pub fn cluster_plan(
    job: &Job,
    options: &ClusterPlanOptions,
    printer: &Printer,
) -> Result<StepResult<ClusterPlan, ClusterDryPlan>, StepError> {
    told(cluster::plan(job, options, &RunContext::new(printer))?, &(), printer)
}

/// Make one shard of a plan. Whoever makes it twice gets the same bytes.
///
/// # Errors
/// If the plan is another calib's or damaged, the shard fails ([`StepError::is_incomplete`]), or the observer asks to stop.
pub fn cluster_run(
    plan: &Path,
    shard: usize,
    printer: &Printer,
) -> Result<ClusterShard, StepError> {
    told(cluster::run(plan, shard, printer)?, &(), printer)
}

/// Say what is done of a plan, what is not, and why; [`Outcome::Incomplete`] if anything is not.
///
/// # Errors
/// If there is no plan, or it is damaged.
pub fn cluster_status(
    plan: &Path,
    options: ClusterStatusOptions,
    printer: &Printer,
) -> Result<ClusterStatus, StepError> {
    told(cluster::status(plan, options)?, &(), printer)
}

/// Bring the results of all shards together, as one process would have written them; each sweep is told when it is there.
///
/// # Errors
/// If a shard is missing or not what it should be ([`StepError::is_incomplete`]): nothing is written then.
pub fn cluster_merge(plan: &Path, printer: &Printer) -> Result<MergedSweeps, StepError> {
    cluster::merge(plan, &RunContext::new(printer))
}

/// Hand a plan to a system that runs its shards.
///
/// # Errors
/// If there is no plan, or the system refuses.
pub fn cluster_submit(
    plan: &Path,
    options: &ClusterSubmitOptions,
    printer: &Printer,
) -> Result<StepResult<SubmittedPlan, ClusterScripts>, StepError> {
    told(cluster::submit(plan, options)?, &(), printer)
}
