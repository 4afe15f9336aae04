//! One file a command: load, call the crates, write, summarise.

mod artefact;
mod build_model;
mod comparison;
mod dtw;
mod evaluate;
mod figures;
mod generate;
mod inspect;
mod jumps;
mod learning;
mod model_files;
mod quickstart;
mod report;
mod represent;
mod rollout;
mod series;
mod simulate;
mod starts;
mod sweep;
mod sweep_plan;
mod sweep_tables;

use anyhow::Context as _;

use crate::{
    cli::{Cli, Command, StudyArgs},
    exit::ExitStatus,
    output::{Printer, watch_for_interrupts},
    study::{Study, StudyPaths},
};

/// Do what the command line says.
pub(crate) fn run(cli: Cli, printer: &Printer) -> anyhow::Result<ExitStatus> {
    if let Some(threads) = cli.global.threads {
        anyhow::ensure!(threads > 0, "--threads must be at least 1");
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build_global()
            .context("cannot set the number of threads")?;
    }
    watch_for_interrupts();
    match cli.command {
        Command::Quickstart(args) => quickstart::run(&args, printer),
        Command::Simulate(args) => simulate::run(&args, printer),
        Command::Inspect(args) => inspect::run(&args, printer),
        Command::Represent(args) => represent::run(&args, printer),
        Command::BuildModel(args) => build_model::run(&args, printer),
        Command::Rollout(args) => rollout::run(&args, printer),
        Command::Sweep(args) => sweep::run(&args, printer),
        Command::Evaluate(args) => evaluate::run(&args, printer),
        Command::Dtw(args) => dtw::run(&args, printer),
        Command::Completions { shell } => generate::completions(shell, printer),
        Command::Man { directory } => generate::man(&directory, printer),
    }
}

/// The study that `args` name, with its overrides.
fn load_study(args: &StudyArgs) -> anyhow::Result<(Study, StudyPaths)> {
    let (study, paths) = Study::load(&args.study, &args.set)?;
    let paths = match &args.output {
        Some(output) => StudyPaths::new(args.study.clone(), output.clone()),
        None => paths,
    };
    Ok((study, paths))
}
