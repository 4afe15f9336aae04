//! One file a command: load, call the crates, write, summarise.

mod artefact;
mod build_check;
mod build_model;
mod build_network;
mod build_plan;
mod chain;
mod changes;
mod check;
mod collapse;
mod compare;
mod compare_choices;
mod compare_pairs;
mod compare_tables;
mod comparison;
mod deployed;
mod described;
mod dtw;
mod environments;
mod evaluate;
mod explain;
mod figures;
mod frames;
mod generate;
mod import;
mod init;
mod inspect;
mod inspect_channels;
mod jumps;
mod kept_report;
mod learning;
mod model;
mod model_files;
mod one_step;
mod partition;
mod plant_of_study;
mod prepared;
mod pretrain;
mod pretrain_files;
mod quickstart;
mod recorded;
mod recurrence;
mod report;
mod report_data;
mod represent;
mod rollout;
mod series;
mod simulate;
mod stale;
mod standing_still;
mod starts;
mod streams;
mod sweep;
mod sweep_notes;
mod sweep_plan;
mod sweep_tables;
mod torch;
mod train_model;
mod trajectory;
mod trajectory_columns;
mod truth;
mod validity;
mod verdict_rows;

use anyhow::Context as _;
use calib_represent::RepresentationKind;
use calib_study::{Each, Job};

use crate::{
    cli::{BuildModelArgs, Cli, Command, RepresentArgs},
    exit::ExitStatus,
    output::{Printer, watch_for_interrupts},
};

/// More threads than any machine gains from; each takes memory and time to start.
const MANY_THREADS: usize = 1024;

/// Do what the command line says.
pub(crate) fn run(cli: Cli, printer: &Printer) -> anyhow::Result<ExitStatus> {
    if let Some(threads) = cli.global.threads {
        anyhow::ensure!(
            (1..=MANY_THREADS).contains(&threads),
            "--threads must be from 1 to {MANY_THREADS}, got {threads}"
        );
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build_global()
            .context("cannot set the number of threads")?;
    }
    // Warping has nothing to finish or to put aside: the system may end it at once.
    if !matches!(cli.command, Command::Dtw(_)) {
        watch_for_interrupts();
    }
    let printer = &printer.answering(cli.command.answer());
    match cli.command {
        Command::Quickstart(args) => quickstart::run(&args, printer),
        Command::Simulate(args) => simulate::run(&args, printer),
        Command::Init(args) => init::run(&args, printer),
        Command::Inspect(args) => inspect::run(&args, printer),
        Command::Import(args) => import::run(&args, printer),
        Command::Run(args) => chain::run(&args.job()?, printer),
        Command::Represent(RepresentArgs { study, device }) => {
            each(Each::Model, &study.job()?, printer, |job, which| {
                // Of several models some search among the states themselves.
                let study = job.study();
                let none =
                    study.is_parametric() || study.representation.kind == RepresentationKind::None;
                if which == Which::OneOfSeveral && none {
                    printer.say("no representation: nothing to train");
                    return Ok(ExitStatus::Done);
                }
                represent::run(job, device, printer)
            })
        }
        Command::BuildModel(BuildModelArgs { study, options }) => {
            let job = study.job()?;
            each(Each::Model, &job, printer, |job, _| build_model::run(job, &options, printer))
        }
        Command::Rollout(args) => {
            each(Each::Rollouts, &args.job()?, printer, |job, _| rollout::run(job, printer))
        }
        Command::Pretrain(args) => {
            let job = args.job()?;
            job.refuse_deployment()?;
            pretrain::run(&job, printer)
        }
        Command::Sweep(args) => {
            let counted = sweep_plan::Counted::default();
            let run = |job: &Job, _| sweep::run(job, &counted, printer);
            each(Each::Deployment, &args.job()?, printer, run)
        }
        Command::Evaluate(args) => {
            let job = args.job()?;
            match job.parts(Each::Deployment)?.as_slice() {
                [only] if only.is_same_part(&job) => evaluate::run(&job, printer),
                parts => compare::run(&job, parts, &[], printer),
            }
        }
        Command::Check(args) => check::run(&args, printer),
        Command::Validity(args) => validity::run(&args, printer),
        Command::Dtw(args) => dtw::run(&args, printer),
        Command::Explain { key, .. } => explain::run(key.as_deref(), printer),
        Command::Completions { shell } => generate::completions(shell, printer),
        Command::Man { directory } => generate::man(&directory, printer),
    }
}

/// Whether a command works on a whole study or on one of its models and deployments.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Which {
    TheOnly,
    OneOfSeveral,
}

/// Run a command on each part of the study, or on the study if it has none.
fn each(
    each: Each,
    job: &Job,
    printer: &Printer,
    run: impl Fn(&Job, Which) -> anyhow::Result<ExitStatus>,
) -> anyhow::Result<ExitStatus> {
    let parts = job.parts(each)?;
    if let [only] = parts.as_slice() {
        return run(only, Which::TheOnly);
    }
    anyhow::ensure!(
        !printer.is_for_machines(),
        "--json prints one result, and the study has several; add {}",
        job.missing_names(&parts).join(" and ")
    );
    each_of(&parts, printer, |part| run(part, Which::OneOfSeveral))
}

/// Run a step of a longer chain on each deployment of a study, or of one of its models.
fn each_part(
    each: Each,
    job: &Job,
    printer: &Printer,
    run: impl Fn(&Job) -> anyhow::Result<ExitStatus>,
) -> anyhow::Result<ExitStatus> {
    match job.parts(each)?.as_slice() {
        [only] => run(only),
        parts => each_of(parts, printer, run),
    }
}

fn each_of(
    parts: &[Job],
    printer: &Printer,
    run: impl Fn(&Job) -> anyhow::Result<ExitStatus>,
) -> anyhow::Result<ExitStatus> {
    let mut ended = ExitStatus::Done;
    for part in parts {
        printer.heading(&part.name());
        match run(part)? {
            ExitStatus::Done => {}
            other => ended = other,
        }
    }
    Ok(ended)
}
