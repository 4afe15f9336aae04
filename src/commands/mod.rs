//! The commands. Those that do more than run one step of the pipeline have a file of their own.

mod check;
mod cluster;
mod dtw;
mod explain;
mod generate;
mod import;
mod inspect;
mod inspect_channels;
mod quickstart;
mod schemas;
mod series;
mod serve;
mod share;
mod simulate;
mod status;

use calib_pipeline::{
    Context as _, Outcome, Printer, ProposeOptions, StepError, Told as _, ValidityOptions, ensure,
};
pub use schemas::json_schemas;

use crate::{
    cli::{
        BuildModelArgs, Cli, Command, ControlArgs, DeviceArgs, EvaluateArgs, InitArgs,
        PretrainArgs, RepresentArgs, RunArgs,
    },
    output::watch_for_interrupts,
};

/// Upper limit for threads. No machine gains from more, and each takes memory and time to start.
const MANY_THREADS: usize = 1024;

/// Returns a printer that prints all reasons if `why` is set.
pub(crate) fn explaining(printer: &Printer, why: bool) -> Printer {
    if why { printer.clone().explaining() } else { printer.clone() }
}

/// Proposes a study: for acting agents if a column of actions is named, otherwise for predicting agents.
fn init(args: InitArgs, printer: &Printer) -> Result<Outcome, StepError> {
    let columns = args.decision_columns();
    let options = ProposeOptions::from(args);
    Ok(match columns {
        Some(columns) => calib_pipeline::propose_control(&options, &columns, printer)?.outcome(),
        None => calib_pipeline::propose(&options, printer)?.outcome(),
    })
}

/// Runs the command of the command line.
pub(crate) fn run(cli: Cli, printer: &Printer) -> Result<Outcome, StepError> {
    if let Some(threads) = cli.global.threads {
        ensure!(
            (1..=MANY_THREADS).contains(&threads),
            "--threads must be from 1 to {MANY_THREADS}, got {threads}"
        );
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build_global()
            .context("cannot set the number of threads")?;
    }
    // `dtw` has no state to save, so the system may end it at once.
    if !matches!(cli.command, Command::Dtw(_)) {
        watch_for_interrupts(cli.command.after_interruption());
    }
    let printer = &printer.in_format(cli.command.output_format());
    Ok(match cli.command {
        Command::Quickstart(args) => quickstart::run(&args, printer)?,
        Command::Simulate(args) => simulate::run(&args, printer)?,
        Command::Init(args) => init(args, printer)?,
        Command::Inspect(args) => inspect::run(&args, printer)?,
        Command::Import(args) => import::run(&args, printer)?,
        Command::Run(RunArgs { study: DeviceArgs { study, device }, why, serve }) => {
            let printer = &explaining(printer, why);
            let page =
                serve.map(|address| status::page_of(&study, address, printer)).transpose()?;
            let job = study.job()?;
            // A study of acting agents consists of one step.
            let done = if job.study().is_of_acting_agents() {
                calib_pipeline::control(&job, printer).map(|judged| judged.outcome())
            } else {
                calib_pipeline::run(&job, device.map(Into::into), printer).map(|run| run.outcome())
            };
            drop(page);
            done?
        }
        Command::Represent(RepresentArgs { study, share, device }) => {
            let job = share::shared(study.job()?, share.as_deref())?;
            calib_pipeline::represent(&job, device.map(Into::into), printer)?.outcome()
        }
        Command::BuildModel(BuildModelArgs { study, options }) => {
            calib_pipeline::build_model(&study.job()?, &options.into(), printer)?.outcome()
        }
        Command::Rollout(args) => calib_pipeline::rollout(&args.job()?, printer)?.outcome(),
        Command::Pretrain(PretrainArgs { study, share }) => {
            let job = share::shared(study.job()?, share.as_deref())?;
            calib_pipeline::pretrain(&job, printer)?.outcome()
        }
        Command::Sweep(DeviceArgs { study, device }) => {
            calib_pipeline::sweep(&study.job()?, device.map(Into::into), printer)?.outcome()
        }
        Command::Evaluate(EvaluateArgs { study, runs: None, why }) => {
            calib_pipeline::evaluate(&study.job()?, &explaining(printer, why))?.outcome()
        }
        Command::Evaluate(EvaluateArgs { study, runs: Some(runs), why }) => {
            let printer = &explaining(printer, why);
            let (study, output) = EvaluateArgs::judging(study)?;
            calib_pipeline::evaluate_runs(&runs, &study, output.as_deref(), printer)?.outcome()
        }
        Command::Control(ControlArgs { study, share, why }) => {
            share::refuse_verdict(&study, share.as_deref())?;
            let job = share::shared(study.job()?, share.as_deref())?;
            calib_pipeline::control(&job, &explaining(printer, why))?.outcome()
        }
        Command::Status(args) => status::run(args, printer)?,
        Command::Check(args) => check::run(&args, printer)?,
        Command::Cluster { command } => cluster::run(command, printer)?,
        Command::Validity(args) => {
            let share = args.share.as_ref();
            let share = share.map(|typed| share::share(typed, share::environment)).transpose()?;
            let options = ValidityOptions { share, ..args.into() };
            calib_pipeline::validity(&options, printer)?.outcome()
        }
        Command::Dtw(args) => dtw::run(&args, printer)?,
        Command::Explain { key, .. } => explain::run(key.as_deref(), printer)?,
        Command::Completions { shell } => generate::completions(shell, printer)?,
        Command::Man { directory } => generate::man(&directory, printer)?,
    })
}
