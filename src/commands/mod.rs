//! One file a command: load, call the crates, write, summarise.

mod artefact;
mod build_model;
mod build_network;
mod build_plan;
mod chain;
mod collapse;
mod compare_models;
mod comparison;
mod dtw;
mod evaluate;
mod figures;
mod generate;
mod inspect;
mod jumps;
mod learning;
mod model;
mod model_files;
mod partition;
mod plant_of_study;
mod pretrain;
mod pretrain_files;
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
mod torch;
mod train_model;
mod trajectory;

use anyhow::Context as _;
use calib_represent::RepresentationKind;

use crate::{
    cli::{BuildModelArgs, Cli, Command, StudyArgs},
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
        Command::Run(args) => chain::run(&args, printer),
        Command::Represent(args) => each_model(&args.study, printer, |study_args, which| {
            // Of several models some search among the states themselves.
            let (study, _) = load_study(study_args)?;
            let none =
                study.is_parametric() || study.representation.kind == RepresentationKind::None;
            if which == Which::OneOfSeveral && none {
                printer.say("no representation: nothing to train");
                return Ok(ExitStatus::Done);
            }
            represent::run(study_args, args.device, printer)
        }),
        Command::BuildModel(args) => each_model(&args.study, printer, |study, _| {
            build_model::run(&BuildModelArgs { study: study.clone(), ..args }, printer)
        }),
        Command::Rollout(args) => each_model(&args, printer, |args, _| rollout::run(args, printer)),
        Command::Pretrain(args) => pretrain::run(&args, printer),
        Command::Sweep(args) => each_model(&args, printer, |args, _| sweep::run(args, printer)),
        Command::Evaluate(args) => match several(&args)?.as_slice() {
            [] => evaluate::run(&args, printer),
            names => compare_models::run(&args, names, &[], printer),
        },
        Command::Dtw(args) => dtw::run(&args, printer),
        Command::Completions { shell } => generate::completions(shell, printer),
        Command::Man { directory } => generate::man(&directory, printer),
    }
}

/// Whether a command works on a whole study or on one of the models that it compares.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Which {
    TheOnly,
    OneOfSeveral,
}

/// Run a command on each of the study's models, or on the study if it has no several.
fn each_model(
    args: &StudyArgs,
    printer: &Printer,
    run: impl Fn(&StudyArgs, Which) -> anyhow::Result<ExitStatus>,
) -> anyhow::Result<ExitStatus> {
    let names = several(args)?;
    if names.is_empty() {
        return run(args, Which::TheOnly);
    }
    anyhow::ensure!(
        !args.json,
        "--json prints one result, and the study has several models; add --model NAME ({})",
        names.join(", ")
    );
    let mut ended = ExitStatus::Done;
    for name in names {
        printer.heading(&format!("model {name}"));
        let args = StudyArgs { model: Some(name), ..args.clone() };
        match run(&args, Which::OneOfSeveral)? {
            ExitStatus::Done => {}
            other => ended = other,
        }
    }
    Ok(ended)
}

/// The models that a command is to go through; none if the study has no several, or one is named.
fn several(args: &StudyArgs) -> anyhow::Result<Vec<String>> {
    match args.model {
        Some(_) => Ok(Vec::new()),
        None => Study::model_names(&args.study, &args.set),
    }
}

/// The study that `args` name, with its overrides.
fn load_study(args: &StudyArgs) -> anyhow::Result<(Study, StudyPaths)> {
    let model = args.model.as_deref();
    let (study, paths) = Study::load(&args.study, &args.set, model)?;
    let paths = match &args.output {
        Some(output) => StudyPaths::new(args.study.clone(), output.clone()),
        None => paths,
    };
    Ok((study, model.map_or(paths.clone(), |name| paths.of_model(name))))
}
