use std::path::Path;

use calib_core::Seed;
use calib_files::write_atomically;
use calib_plant::PlantOptions;

use super::{build_model, evaluate, rollout, simulate, sweep};
use crate::{
    cli::{BuildModelArgs, QuickstartArgs, StudyArgs},
    clock::Stopwatch,
    exit::ExitStatus,
    output::{Printer, duration},
};

/// The study that quickstart runs; `configs/quickstart.toml` in the repository.
const STUDY: &str = include_str!("../../configs/quickstart.toml");

/// Simulate a plant, run the whole chain on it, and leave everything in a directory.
pub(super) fn run(args: &QuickstartArgs, printer: &Printer) -> anyhow::Result<ExitStatus> {
    let clock = Stopwatch::start();
    let directory = &args.directory;
    printer.heading("calib quickstart: two days of a simulated plant, from its logs to a verdict");
    let study = write_study(directory, args.seed)?;
    let plant =
        PlantOptions { channels: 64, seed: Seed::new(args.seed), ..PlantOptions::default() };
    simulate::simulate(&directory.join("data"), plant, false, printer)?;
    let args_for = |json: bool| StudyArgs {
        study: study.clone(),
        set: Vec::new(),
        model: None,
        output: None,
        force: false,
        dry_run: false,
        json,
    };
    // Only the verdict is the result of this command; the steps before it just report.
    let steps = printer.talking();
    steps.heading("1. build-model");
    build_model::run(&BuildModelArgs::new(args_for(false), 100), &steps)?;
    steps.heading("2. rollout");
    rollout::run(&args_for(false), &steps)?;
    steps.heading("3. sweep");
    sweep::run(&args_for(false), &steps)?;
    printer.heading("4. evaluate");
    let status = evaluate::run(&args_for(args.json), printer)?;
    printer.say(&format!(
        "done in {}. Open the report in a browser; then copy {} and point it at your own logs.",
        duration(clock.elapsed()),
        study.display(),
    ));
    Ok(status)
}

/// Leave the study file beside the data, as a start for the user's own.
fn write_study(directory: &Path, seed: u64) -> anyhow::Result<std::path::PathBuf> {
    let path = directory.join("study.toml");
    let text = STUDY.replacen("seed = 0", &format!("seed = {seed}"), 1);
    match std::fs::read_to_string(&path) {
        Ok(found) if found == text => return Ok(path),
        Ok(_) => anyhow::bail!(
            "{} exists and is another study; run the steps on it one by one, or choose another directory",
            path.display()
        ),
        Err(_) => {}
    }
    write_atomically(&path, |file| std::io::Write::write_all(file, text.as_bytes()))?;
    Ok(path)
}
