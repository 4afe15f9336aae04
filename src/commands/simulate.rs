use std::path::PathBuf;

use calib_data::Moment;
use calib_pipeline::{
    ExistingFile, Job, Outcome, Printer, Request, SimulateTask, StepError, Stopwatch, bail, ensure,
    output::duration, plant_of,
};
use calib_plant::PlantOptions;
use calib_study::{SimulateConfig, shell_words};

use crate::cli::{PlantArgs, SimulateArgs, Task};

/// Default number of recorded steps in a task.
const TRANSITIONS: usize = 5000;

/// Simulates a plant, and writes one Parquet file per day.
pub(super) fn run(args: &SimulateArgs, printer: &Printer) -> Result<Outcome, StepError> {
    if let Some(task) = args.task.task {
        return of_task(args, task, printer);
    }
    let clock = Stopwatch::start();
    let is_study = args.target.extension().is_some_and(|extension| extension == "toml");
    let (directory, plant, next) = if is_study {
        described(args)?
    } else {
        ensure!(
            args.set.is_empty() && args.profile.is_none(),
            "--set and --profile change a study, and {} is a folder; give the options of the plant, such as --days",
            args.target.display()
        );
        let next = shell_words(["calib", "inspect", &args.target.display().to_string()]);
        (args.target.clone(), config(&args.plant)?.plant()?, next)
    };
    let simulated = calib_pipeline::simulate_plant(&directory, plant, args.force, printer)?;
    if printer.is_json() {
        printer.json(&simulated)?;
    } else {
        printer.result(&format!("{} in {}", simulated.line(), duration(clock.elapsed())))?;
        if let Some(line) = simulated.changes_line() {
            printer.result(&line)?;
            simulated.changes().iter().try_for_each(|told| printer.result(told))?;
        }
    }
    printer.next(&[next]);
    Ok(Outcome::Done)
}

/// Writes the log of a policy in a classic task.
fn of_task(args: &SimulateArgs, task: Task, printer: &Printer) -> Result<Outcome, StepError> {
    let seed = args.plant.seed;
    ensure!(
        PlantArgs { seed: None, ..args.plant.clone() } == PlantArgs::default()
            && args.set.is_empty()
            && args.profile.is_none(),
        "--task takes --policy, --transitions, --seed and --force; the other options are of the plant"
    );
    let existing = if args.force { ExistingFile::Replaced } else { ExistingFile::Kept };
    let simulated = calib_pipeline::simulate_task(
        &SimulateTask {
            directory: args.target.clone(),
            task: task.into(),
            policy: args.task.policy.map_or_else(Default::default, Into::into),
            transitions: args.task.transitions.unwrap_or(TRANSITIONS),
            seed: seed.unwrap_or(0),
            existing,
        },
        printer,
    )?;
    if printer.is_json() {
        printer.json(&simulated)?;
    } else {
        printer.result(&simulated.line())?;
    }
    let study = simulated.study.display().to_string();
    printer.next(&[shell_words(["calib", "control", &study])]);
    Ok(Outcome::Done)
}

/// Returns the folder and the plant of `calib simulate STUDY`, and the hint for the next command.
fn described(args: &SimulateArgs) -> Result<(PathBuf, PlantOptions, String), StepError> {
    let shown = args.target.display();
    ensure!(
        args.plant == PlantArgs::default(),
        "{shown} describes its plant in [simulate]: change it there, or for once with --set, such as --set simulate.days=2"
    );
    let job = Job::resolve(Request {
        set: args.set.clone(),
        profile: args.profile.clone(),
        ..Request::new(&args.target)
    })?;
    let Some((directory, plant)) = plant_of(&job)? else {
        let unused =
            if args.set.is_empty() { "" } else { " (one is not used where --set names the data)" };
        bail!("{shown} has no [simulate] section{unused}; add one, or simulate into a folder")
    };
    Ok((directory, plant, job.run_command()))
}

/// Combines the given options with the defaults.
fn config(args: &PlantArgs) -> Result<SimulateConfig, StepError> {
    let defaults = SimulateConfig::default();
    let start = args.start.as_ref().map(|start| {
        Moment::new(start).map_err(|reason| StepError::message(format!("--start: {reason}")))
    });
    Ok(SimulateConfig {
        days: args.days.unwrap_or(defaults.days),
        channels: args.channels.unwrap_or(defaults.channels),
        period_secs: args.period.unwrap_or(defaults.period_secs),
        start: start.transpose()?.unwrap_or(defaults.start),
        seed: args.seed.unwrap_or(defaults.seed),
        drift: args.drift.unwrap_or(defaults.drift),
        noise: args.noise.unwrap_or(defaults.noise),
        storms_per_day: args.storms_per_day.unwrap_or(defaults.storms_per_day),
        missing_fraction: args.missing_fraction.unwrap_or(defaults.missing_fraction),
        gaps_per_day: args.gaps_per_day.unwrap_or(defaults.gaps_per_day),
        stuck_per_day: args.stuck_per_day.unwrap_or(defaults.stuck_per_day),
        duplicates_per_day: args.duplicates_per_day.unwrap_or(defaults.duplicates_per_day),
        change: args.change,
        membranes_per_year: args.membranes_per_year,
        feeds_per_year: args.feeds_per_year,
        sensors_per_year: args.sensors_per_year,
        settings_per_year: args.settings_per_year,
        pumps_per_year: args.pumps_per_year,
    })
}
