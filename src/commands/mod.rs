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
mod compare_pairs;
mod compare_tables;
mod comparison;
mod deployed;
mod dtw;
mod environments;
mod evaluate;
mod figures;
mod generate;
mod import;
mod inspect;
mod jumps;
mod learning;
mod model;
mod model_files;
mod one_step;
mod partition;
mod plant_of_study;
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
mod starts;
mod streams;
mod sweep;
mod sweep_plan;
mod sweep_tables;
mod torch;
mod train_model;
mod trajectory;
mod trajectory_columns;
mod truth;
mod validity;

use anyhow::Context as _;
use calib_represent::RepresentationKind;

use crate::{
    cli::{BuildModelArgs, Cli, Command, StudyArgs},
    exit::ExitStatus,
    output::{Printer, watch_for_interrupts},
    study::{Chosen, Rollouts, Study, StudyPaths},
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
    match cli.command {
        Command::Quickstart(args) => quickstart::run(&args, printer),
        Command::Simulate(args) => simulate::run(&args, printer),
        Command::Inspect(args) => inspect::run(&args, printer),
        Command::Import(args) => import::run(&args, printer),
        Command::Run(args) => chain::run(&args, printer),
        Command::Represent(args) => each(Of::Model, &args.study, printer, |study_args, which| {
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
        Command::BuildModel(args) => each(Of::Model, &args.study, printer, |study, _| {
            build_model::run(&BuildModelArgs { study: study.clone(), ..args }, printer)
        }),
        Command::Rollout(args) => {
            each(Of::Rollouts, &args, printer, |args, _| rollout::run(args, printer))
        }
        Command::Pretrain(args) => {
            refuse_deployment(&args)?;
            pretrain::run(&args, printer)
        }
        Command::Sweep(args) => {
            let counted = sweep_plan::Counted::default();
            each(Of::Deployment, &args, printer, |args, _| sweep::run(args, &counted, printer))
        }
        Command::Evaluate(args) => match parts(Of::Deployment, &args)?.as_slice() {
            [only] if only.is_same_part(&args) => evaluate::run(&args, printer),
            parts => compare::run(&args, parts, &[], printer),
        },
        Command::Check(args) => check::run(&args, printer),
        Command::Validity(args) => validity::run(&args, printer),
        Command::Dtw(args) => dtw::run(&args, printer),
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

/// What a command does something for, once each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Of {
    /// Each model.
    Model,
    /// Each model, and each deployment where its start states follow from the deployment.
    Rollouts,
    /// Each deployment of each model.
    Deployment,
}

/// Run a command on each part of the study, or on the study if it has none.
fn each(
    of: Of,
    args: &StudyArgs,
    printer: &Printer,
    run: impl Fn(&StudyArgs, Which) -> anyhow::Result<ExitStatus>,
) -> anyhow::Result<ExitStatus> {
    let parts = parts(of, args)?;
    if let [only] = parts.as_slice() {
        return run(only, Which::TheOnly);
    }
    anyhow::ensure!(
        !args.json,
        "--json prints one result, and the study has several; add {}",
        missing_names(args, &parts).join(" and ")
    );
    each_of(&parts, printer, |part| run(part, Which::OneOfSeveral))
}

/// Run a step of a longer chain on each deployment of a study, or of one of its models.
fn each_part(
    of: Of,
    args: &StudyArgs,
    printer: &Printer,
    run: impl Fn(&StudyArgs) -> anyhow::Result<ExitStatus>,
) -> anyhow::Result<ExitStatus> {
    match parts(of, args)?.as_slice() {
        [only] => run(only),
        parts => each_of(parts, printer, run),
    }
}

fn each_of(
    parts: &[StudyArgs],
    printer: &Printer,
    run: impl Fn(&StudyArgs) -> anyhow::Result<ExitStatus>,
) -> anyhow::Result<ExitStatus> {
    let mut ended = ExitStatus::Done;
    for part in parts {
        printer.heading(&name(part));
        match run(part)? {
            ExitStatus::Done => {}
            other => ended = other,
        }
    }
    Ok(ended)
}

/// What a part of the study is called.
fn name(part: &StudyArgs) -> String {
    let model = part.model.as_ref().map(|name| format!("model {name}"));
    let deployment = part.deployment.as_ref().map(|name| format!("deployment {name}"));
    model.into_iter().chain(deployment).collect::<Vec<_>>().join(", ")
}

/// What would choose one of several parts.
fn missing_names(args: &StudyArgs, parts: &[StudyArgs]) -> Vec<String> {
    let names = |of: fn(&StudyArgs) -> Option<&String>| {
        let mut once: Vec<&str> = Vec::new();
        for name in parts.iter().filter_map(of) {
            if !once.contains(&name.as_str()) {
                once.push(name);
            }
        }
        once.join(", ")
    };
    let model = args.model.is_none().then(|| names(|part| part.model.as_ref()));
    let deployment = args.deployment.is_none().then(|| names(|part| part.deployment.as_ref()));
    [("--model", model), ("--deployment", deployment)]
        .into_iter()
        .filter_map(|(option, names)| Some((option, names.filter(|names| !names.is_empty())?)))
        .map(|(option, names)| format!("{option} NAME ({names})"))
        .collect()
}

/// The parts that a command is to go through: the study itself, if it has no several.
fn parts(of: Of, args: &StudyArgs) -> anyhow::Result<Vec<StudyArgs>> {
    let models = match args.model {
        Some(_) => Vec::new(),
        None => Study::model_names(&args.study, &args.set, args.profile.as_deref())?,
    };
    let of_model = |name| StudyArgs { model: Some(name), ..args.clone() };
    let mut parts: Vec<StudyArgs> = models.into_iter().map(of_model).collect();
    if parts.is_empty() {
        parts.push(args.clone());
    }
    if of == Of::Model {
        refuse_deployment(args)?;
        return Ok(parts);
    }
    if args.deployment.is_none() {
        let whole = StudyArgs { model: None, ..args.clone() };
        let (study, _) = load_study(&whole)?;
        let names = study.deployment_names();
        if !names.is_empty() {
            let of_deployment = |part: StudyArgs| {
                let part = move |name: &String| StudyArgs {
                    deployment: Some(name.clone()),
                    ..part.clone()
                };
                names.iter().map(part).collect::<Vec<_>>()
            };
            parts = parts.into_iter().flat_map(of_deployment).collect();
        }
    }
    if of == Of::Rollouts {
        parts = once_where_shared(parts)?;
    }
    Ok(parts)
}

/// The first of those parts that share their rollouts, which is then all of them.
fn once_where_shared(parts: Vec<StudyArgs>) -> anyhow::Result<Vec<StudyArgs>> {
    let mut directories = Vec::new();
    let mut kept = Vec::new();
    for part in parts {
        let (study, paths) = load_study(&part)?;
        if !directories.contains(&paths.rollout()) {
            directories.push(paths.rollout());
            let deployment =
                part.deployment.clone().filter(|_| starts::follow_from_deployment(&study));
            kept.push(StudyArgs { deployment, ..part });
        }
    }
    Ok(kept)
}

/// Nothing that comes before rollouts knows of deployments.
fn refuse_deployment(args: &StudyArgs) -> anyhow::Result<()> {
    anyhow::ensure!(
        args.deployment.is_none(),
        "--deployment is for rollout, sweep and evaluate: what this command makes is the same for every deployment; \
         leave it out"
    );
    Ok(())
}

/// The study that `args` name, with its overrides.
fn load_study(args: &StudyArgs) -> anyhow::Result<(Study, StudyPaths)> {
    let (model, deployment) = (args.model.as_deref(), args.deployment.as_deref());
    let chosen = Chosen { profile: args.profile.as_deref(), model, deployment };
    let (study, paths) = Study::load(&args.study, &args.set, chosen)?;
    let paths = match &args.output {
        Some(output) => paths.at(output.clone()),
        None => paths,
    };
    let paths = match model {
        Some(name) => paths.of_model(name),
        None => paths,
    };
    let rollouts = if starts::follow_from_deployment(&study) {
        Rollouts::OfDeployment
    } else {
        Rollouts::OfModel
    };
    let paths = match deployment {
        Some(name) => paths.of_deployment(name, rollouts),
        None => paths,
    };
    Ok((study, paths))
}
