//! The status of a study. Nothing is written, and running commands are not disturbed.

mod begun;
mod find;
mod ranking;
mod show;
mod standing;

use std::{mem, path::PathBuf};

use calib_base::{
    StepError, artefact,
    log::context::RunContext,
    output::Printer,
    progress::{self, CommandState, Note},
};
use calib_study::{Job, Scope, StepKind};
use calib_sweep_steps::{sweep::SweepManifest, verdict::report_cache::is_judged_since};

use self::{
    begun::BegunSweep,
    find::Subject,
    ranking::rankings,
    standing::{Command, Overall, StepStanding, StepState},
};
pub(crate) use self::{find::study_unless_folder, ranking::Ranking};
use crate::{
    changed_log, cluster,
    control::{self, VerdictStanding},
    plan::{Plan, PlannedStep, State},
};

pub use self::{
    find::StatusRequest,
    standing::{ClusterStanding, StandingOf, StudyStanding},
};

/// Returns the status of the requested study or plan.
///
/// # Errors
/// Returns an error if there is no such study or folder, or the study is wrong.
pub(crate) fn status(request: &StatusRequest, printer: &Printer) -> Result<StandingOf, StepError> {
    match find::find(request)? {
        Subject::Study(job) => Ok(StandingOf::Study(of_study(&job, printer)?)),
        Subject::Cluster(directory) => Ok(StandingOf::Cluster(of_cluster(directory)?)),
    }
}

fn of_study(job: &Job, printer: &Printer) -> Result<StudyStanding, StepError> {
    let results = job.layout().of_study().to_owned();
    let commands: Vec<Command> = progress::running(&results)
        .into_iter()
        .map(|note| Command { standing: note.standing(), note })
        .collect();
    let at_work: Vec<&Note> = commands
        .iter()
        .filter(|command| command.standing == CommandState::Running)
        .map(|command| &command.note)
        .collect();
    let is_control = job.study().control.is_some();
    let sweeps = if is_control { Vec::new() } else { BegunSweep::all_of(job)? };
    let verdict = VerdictStanding::of(job)?;
    let steps = if is_control {
        let is_running = at_work.iter().any(|note| note.command == StepKind::Control.command());
        vec![of_control(&verdict, is_running)]
    } else {
        steps(job, &sweeps, &at_work, printer)?
    };
    let left = at_work.iter().map(|note| note.secs_left).collect::<Option<Vec<f64>>>();
    let secs_left = left.and_then(|left| left.into_iter().reduce(f64::max));
    let state = if !at_work.is_empty() {
        Overall::Running
    } else if steps.iter().all(|step| step.state == StepState::Done) {
        Overall::Done
    } else if commands.is_empty() {
        Overall::Waiting
    } else {
        Overall::Killed
    };
    let rankings = of_sweeps(sweeps, &steps);
    let control = control::ranking(job, &verdict)?;
    let are_made = control.as_ref().is_some_and(|ranking| ranking.runs[0] == ranking.runs[1]);
    let is_next = are_made && state == Overall::Waiting;
    Ok(StudyStanding {
        next: is_next.then(|| job.command(StepKind::Control)),
        control,
        study: job.layout().study().to_owned(),
        state,
        secs_left,
        steps,
        rankings,
        report: Some(report(job)).filter(|report| report.is_file()),
        results,
        commands,
    })
}

/// Returns the path of a study's report.
fn report(job: &Job) -> PathBuf {
    if job.study().control.is_some() {
        job.layout().control().join("report.html")
    } else {
        job.layout().report()
    }
}

/// Returns the only step of a study of agents that act.
fn of_control(verdict: &VerdictStanding, is_running: bool) -> StepStanding {
    let (state, stale) = match verdict {
        _ if is_running => (StepState::Running, None),
        VerdictStanding::Current => (StepState::Done, None),
        VerdictStanding::Stale(reason) => (StepState::ToDo, Some(reason.clone())),
        VerdictStanding::Missing => (StepState::ToDo, None),
    };
    StepStanding { step: StepKind::Control.label(), model: None, deployment: None, state, stale }
}

/// Returns the steps of a study of agents that predict, with their states.
fn steps(
    job: &Job,
    begun: &[BegunSweep],
    at_work: &[&Note],
    printer: &Printer,
) -> Result<Vec<StepStanding>, StepError> {
    let context = RunContext::new(&printer.silent());
    let models = job.models()?;
    let models: Vec<&Job> = models.iter().collect();
    let sweeps = job.parts(Scope::Deployment)?;
    let arithmetic = sweeps
        .iter()
        .find_map(|part| artefact::read::<SweepManifest>(&part.layout().sweep()))
        .and_then(|found| found.facts.arithmetic);
    let plan = Plan::of(job, &models, arithmetic.as_deref(), &context)?;
    let is_swept =
        !plan.steps().iter().any(|step| step.step == StepKind::Sweep && step.state == State::ToDo);
    let folders: Vec<PathBuf> = sweeps.iter().map(|part| part.layout().sweep()).collect();
    let is_judged = is_swept && is_judged_since(job, &folders);
    let mut standings = Vec::new();
    for step in plan.steps() {
        let is_done =
            step.state == State::UpToDate || (step.step == StepKind::Evaluate && is_judged);
        let state = if is_done {
            StepState::Done
        } else if at_work.iter().any(|note| is_at(note, step)) {
            StepState::Running
        } else {
            StepState::ToDo
        };
        let mut standing = StepStanding {
            step: step.step.label(),
            model: step.model.clone(),
            deployment: step.deployment.clone(),
            state,
            stale: None,
        };
        if state == StepState::ToDo {
            let own = begun.iter().find(|sweep| sweep.is_of(&standing));
            standing.stale = match step.step {
                StepKind::Prepare => changed_log::why_read_again(job),
                _ => own.and_then(BegunSweep::why_to_do),
            };
        }
        standings.push(standing);
    }
    Ok(standings)
}

/// Whether a command is working on a step: it is the command of that step alone, or its stage has the step's name.
fn is_at(note: &Note, step: &PlannedStep) -> bool {
    // "[3/5] sweep, model laplacian"
    let doing = note.doing.as_deref().and_then(|doing| doing.split_once("] "));
    let of_step = match doing {
        Some((_, doing)) => {
            let (label, model) = doing.split_once(", model ").unwrap_or((doing, ""));
            label == step.step.label()
                && (model.is_empty() || step.model.as_deref().is_none_or(|own| own == model))
        }
        None => note.command == step.step.command(),
    };
    let of_part = note.part.as_deref().is_none_or(|part| {
        let names = [step.model.as_deref(), step.deployment.as_deref()];
        names.into_iter().flatten().all(|name| part.contains(name))
    });
    of_step && of_part
}

/// Ranks the settings in all sweeps of a study. Runs of a changed study are left out, unless they are running.
fn of_sweeps(sweeps: Vec<BegunSweep>, steps: &[StepStanding]) -> Vec<Ranking> {
    let mut all = Vec::new();
    for mut sweep in sweeps {
        let is_running =
            steps.iter().any(|step| sweep.is_of(step) && step.state == StepState::Running);
        let found = mem::take(&mut sweep.rankings);
        let differences = sweep.differences();
        all.extend(
            found
                .into_iter()
                .filter(|found| is_running || sweep.has_runs_for(&found.sensor, &differences)),
        );
    }
    all
}

/// Returns the status of the shards of a plan, and the settings ranked by their runs.
fn of_cluster(directory: PathBuf) -> Result<ClusterStanding, StepError> {
    let (cluster, parts) = cluster::standing(&directory)?;
    let mut all = Vec::new();
    for part in &parts {
        let stored = part.planned.stored(&|unit, key| part.get(unit, key));
        let names = (part.model.as_deref(), part.deployment.as_deref());
        all.extend(rankings(&part.planned, &stored, names)?);
    }
    Ok(ClusterStanding { directory, cluster, rankings: all })
}
