//! The public functions of this crate, one per step.

use std::path::Path;

use calib_base::{
    StepError,
    log::{
        context::RunContext,
        plant_of_study,
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
    model::{build_model, build_plan::BuildPlan, built_model::BuiltModel},
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
    run_study::{self, RunUntil, StudyRun},
    status::{self, StandingOf, StatusRequest},
    validity::{self, ValidityAnswer, ValidityPlan},
};

/// Runs every step that a study needs, from its log to the verdict. Finished steps are skipped. Representations,
/// networks and the agents of sweeps are trained through libtorch on `device`, if one is given.
///
/// # Errors
/// Returns an error if the study or the data is wrong, the machine lacks resources, or the observer asks to stop.
pub fn run(job: &Job, device: Option<Device>, printer: &Printer) -> Result<StudyRun, StepError> {
    recorded("run", job, printer, |printer| {
        run_study::run(RunUntil::Report, job, device, &RunContext::new(printer))
    })
}

/// Writes the simulated log of the plant that the study describes. Returns `None` for a study without a plant.
///
/// # Errors
/// Fails as [`run`] does, and if the folder holds other logs.
pub fn simulate(job: &Job, printer: &Printer) -> Result<Option<Simulated>, StepError> {
    plant_of_study::write_log(job, printer)
}

/// Writes the missing files of this plant's log, one Parquet file per day. `force` starts over.
///
/// # Errors
/// Fails as [`simulate()`] does.
pub fn simulate_plant(
    directory: &Path,
    plant: PlantOptions,
    force: bool,
    printer: &Printer,
) -> Result<Simulated, StepError> {
    simulate::simulate(directory, plant, force, printer)
}

/// Trains or imports representations of the states, scores them, and chooses one.
///
/// # Errors
/// Fails as [`run`] does.
pub fn represent(
    job: &Job,
    device: Option<Device>,
    printer: &Printer,
) -> Result<Results<StepResult<Representations>>, StepError> {
    recorded(StepKind::Represent.command(), job, printer, |printer| {
        let context = &RunContext::new(printer);
        let has_several = job.parts(StepKind::Represent.scope())?.len() > 1;
        each(StepKind::Represent, job, printer, |job| {
            // With several models, some may search among the states themselves.
            if has_several && !job.study().has_representation() {
                printer.say("no representation: nothing to train");
                return Ok(StepResult::Nothing(Outcome::Done));
            }
            represent::run(job, device, context)
        })
    })
}

/// Builds the calibration models.
///
/// # Errors
/// Fails as [`run`] does.
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

/// Rolls out the models, and compares the rollouts with the recorded log.
///
/// # Errors
/// Fails as [`run`] does.
pub fn rollout(job: &Job, printer: &Printer) -> Result<Results<StepResult<Rollouts>>, StepError> {
    recorded(StepKind::Rollout.command(), job, printer, |printer| {
        let context = &RunContext::new(printer);
        each(StepKind::Rollout, job, printer, |job| rollout::run(job, context))
    })
}

/// Pre-trains one agent per sensor.
///
/// # Errors
/// Fails as [`run`] does.
pub fn pretrain(job: &Job, printer: &Printer) -> Result<StepResult<PretrainedAgents>, StepError> {
    recorded(StepKind::Pretrain.command(), job, printer, |printer| {
        job.refuse_deployment()?;
        told(pretrain::run(job, &RunContext::new(printer))?, job, printer)
    })
}

/// Trains agents for every setting of the grid, in the models, Online and on the replayed log. With a `device` they are
/// trained through libtorch. Its arithmetic differs from calib's own, so such results are never compared with others.
///
/// # Errors
/// Fails as [`run`] does, and if a device is given and agents are not networks in single precision.
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

/// Chooses a setting, judges the choice on held-out data, and writes the report.
///
/// # Errors
/// Fails as [`run`] does.
pub fn evaluate(job: &Job, printer: &Printer) -> Result<StepResult<Evaluation>, StepError> {
    let context = &RunContext::new(printer);
    let parts = job.parts(StepKind::Evaluate.scope())?;
    if let Some(warning) = changed_log::old_verdict(job) {
        printer.warn(&warning);
    }
    told(evaluation::run(job, &parts, &[], context)?, job, printer)
}

/// Reads a log of decisions, builds its model with actions, and trains the agent of every setting in it. Reports which
/// one to deploy.
///
/// # Errors
/// Fails as [`run`] does, and if the study has no `[control]` section.
pub fn control(
    job: &Job,
    printer: &Printer,
) -> Result<StepResult<ControlEvaluation, ControlPlan>, StepError> {
    recorded(StepKind::Control.command(), job, printer, |printer| {
        told(control::run(job, printer)?, job, printer)
    })
}

/// Reads a log of decisions, and builds its model with actions if it is missing.
///
/// # Errors
/// Fails as [`control()`] does.
pub fn control_model(job: &Job, printer: &Printer) -> Result<ActionModel, StepError> {
    control::build(job, printer)
}

/// Writes the log of a policy in a classic task, and a study of that log.
///
/// # Errors
/// Returns an error if the folder cannot be written, or the observer asks to stop.
pub fn simulate_task(wanted: &SimulateTask, printer: &Printer) -> Result<SimulatedTask, StepError> {
    control::simulate(wanted, printer)
}

/// Judges runs of another program by the `[evaluate]` section of a study. They are in a table that
/// [`SweepStreams::write`](calib_sweep_steps::external::SweepStreams::write) wrote, or one with its columns. With
/// `output`, it writes `summary.json`, figures and `report.html` there.
///
/// # Errors
/// Fails as [`run`] does, and if the table lacks a column or holds an invalid value.
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

/// Examines a log, tries small models of it, and writes a study with a reason for every choice.
///
/// # Errors
/// Fails as [`run`] does, and if nothing in the log can be predicted.
pub fn propose(options: &ProposeOptions, printer: &Printer) -> Result<ProposedStudy, StepError> {
    told(propose::run(options, &RunContext::new(printer))?, &(), printer)
}

/// Examines a log of decisions, times short runs of agents that act, and writes a study of such agents with a reason
/// for every choice. The options for sensors and horizon are ignored, because they apply to agents that predict.
///
/// # Errors
/// Fails as [`run`] does. Also fails if a column is not in the log, there are fewer than two actions, no action can be
/// worth more than another, or not exactly one of `columns` and the options gives a reward.
pub fn propose_control(
    options: &ProposeOptions,
    columns: &DecisionColumns,
    printer: &Printer,
) -> Result<ProposedControlStudy, StepError> {
    told(propose::run_control(options, columns, printer)?, &(), printer)
}

/// Compares the results of a study file, or a folder of results, with their recorded fingerprints.
///
/// # Errors
/// Returns an error if the path is missing, the study is wrong, there are no results, or the observer asks to stop.
/// Damage is reported and is not an error.
pub fn check(results: &Path, logs: Logs, printer: &Printer) -> Result<CheckedResults, StepError> {
    check::run(results, logs, printer)
}

/// Returns the status of a study, of the study of a folder of results, or of a cluster plan. It tells which parts are
/// done or running, and ranks the settings by the available runs. Nothing is written.
///
/// # Errors
/// Returns an error if there is no such study or folder, or the study is wrong.
pub fn status(request: &StatusRequest, printer: &Printer) -> Result<StandingOf, StepError> {
    status::status(request, printer)
}

/// Judges how well calib chooses, over several studies with held-out data.
///
/// # Errors
/// Fails as [`run`] does.
pub fn validity(
    options: &ValidityOptions,
    printer: &Printer,
) -> Result<StepResult<ValidityAnswer, ValidityPlan>, StepError> {
    told(validity::run(options, &RunContext::new(printer))?, &(), printer)
}

/// Divides the remaining work of a study's sweeps into shards, and writes them with all their inputs to a folder.
///
/// # Errors
/// Fails as [`run`] does, and if the folder already holds a plan.
pub fn cluster_plan(
    job: &Job,
    options: &ClusterPlanOptions,
    printer: &Printer,
) -> Result<StepResult<ClusterPlan, ClusterDryPlan>, StepError> {
    told(cluster::plan(job, options, &RunContext::new(printer))?, &(), printer)
}

/// Runs one shard of a plan. Running it again gives the same bytes.
///
/// # Errors
/// Returns an error if the plan comes from another version of calib or another kind of processor, the plan is damaged,
/// the shard fails ([`StepError::Incomplete`]), or the observer asks to stop.
pub fn cluster_run(
    plan: &Path,
    shard: usize,
    printer: &Printer,
) -> Result<ClusterShard, StepError> {
    told(cluster::run(plan, shard, printer)?, &(), printer)
}

/// Reports which shards of a plan are done, which are not, and why. The outcome is [`Outcome::Incomplete`] if any is
/// not done.
///
/// # Errors
/// Returns an error if the plan is missing or damaged.
pub fn cluster_status(
    plan: &Path,
    options: ClusterStatusOptions,
    printer: &Printer,
) -> Result<ClusterStatus, StepError> {
    told(cluster::status(plan, options)?, &(), printer)
}

/// Merges the results of all shards into the files that one process would have written. Reports each finished sweep.
///
/// # Errors
/// Returns an error if a shard is missing or invalid ([`StepError::Incomplete`]). Nothing is written in that case.
pub fn cluster_merge(plan: &Path, printer: &Printer) -> Result<MergedSweeps, StepError> {
    cluster::merge(plan, &RunContext::new(printer))
}

/// Submits a plan to a system that runs its shards.
///
/// # Errors
/// Returns an error if there is no plan, or the system refuses it.
pub fn cluster_submit(
    plan: &Path,
    options: &ClusterSubmitOptions,
    printer: &Printer,
) -> Result<StepResult<SubmittedPlan, ClusterScripts>, StepError> {
    told(cluster::submit(plan, options)?, &(), printer)
}
