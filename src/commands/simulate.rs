use std::path::{Path, PathBuf};

use anyhow::{bail, ensure};
use calib_core::{Monitor as _, Timestamp};
use calib_data::{Moment, table::write_log};
use calib_files::{read_json, remove_file, write_json};
use calib_plant::{ChannelInfo, DayLog, Plant, PlantOptions};
use calib_study::{SimulateConfig, shell_words};
use serde::{Deserialize, Serialize};

use super::{
    artefact::{Below, Claim, TOOL},
    changes::{self, CHANGES, DatedChange},
    plant_of_study,
};
use crate::{
    cli::{PlantArgs, SimulateArgs},
    clock::Stopwatch,
    exit::{ExitStatus, Interrupted},
    output::{Printer, bytes, count, duration},
};

/// The file that says what the day files beside it were made from.
const SIMULATION: &str = "simulation.json";

/// `simulation.json`: what the day files beside it were made from, and the truth about each channel.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct Simulation {
    tool: String,
    options: PlantOptions,
    channels: Vec<ChannelInfo>,
}

/// What was written, for `--json`.
#[derive(Debug, Serialize)]
pub(super) struct Simulated {
    directory: PathBuf,
    channels: usize,
    files: Vec<PathBuf>,
    written: usize,
    /// What changes in the plant; of one that does not, nothing.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    changes: Vec<DatedChange>,
}

impl Simulated {
    /// What there is now, in words.
    pub(super) fn line(&self) -> String {
        format!(
            "{} day files of {} channels in {} ({} written, {} already there)",
            self.files.len(),
            count(self.channels),
            self.directory.display(),
            self.written,
            self.files.len() - self.written,
        )
    }

    /// How often the plant changed, in words; nothing of one that does not.
    pub(super) fn changes_line(&self) -> Option<String> {
        let (first, last) = (self.changes.first()?, self.changes.last()?);
        let path = self.directory.join(CHANGES);
        Some(format!(
            "{} changes from {} to {}, in {}",
            self.changes.len(),
            first.at(),
            last.at(),
            path.display()
        ))
    }
}

/// Simulate a plant and write one Parquet file a day.
pub(super) fn run(args: &SimulateArgs, printer: &Printer) -> anyhow::Result<ExitStatus> {
    let clock = Stopwatch::start();
    let is_study = args.target.extension().is_some_and(|extension| extension == "toml");
    let (directory, options, next) = if is_study {
        plant_of_study::described(args)?
    } else {
        ensure!(
            args.set.is_empty() && args.profile.is_none(),
            "--set and --profile change a study, and {} is a folder; give the options of the plant, such as --days",
            args.target.display()
        );
        let next = shell_words(["calib", "inspect", &args.target.display().to_string()]);
        (args.target.clone(), config(&args.plant)?.plant()?, next)
    };
    let simulated = simulate(&directory, options, args.force, printer)?;
    if printer.is_for_machines() {
        printer.json(&simulated)?;
    } else {
        printer.result(&format!("{} in {}", simulated.line(), duration(clock.elapsed())))?;
        if let Some(line) = simulated.changes_line() {
            printer.result(&line)?;
            simulated.changes.iter().try_for_each(|told| printer.result(&told.line()))?;
        }
    }
    printer.next(&[next]);
    Ok(ExitStatus::Done)
}

/// What was typed, and the defaults for the rest.
fn config(args: &PlantArgs) -> anyhow::Result<SimulateConfig> {
    let defaults = SimulateConfig::default();
    let start = args
        .start
        .as_ref()
        .map(|start| Moment::new(start).map_err(|reason| anyhow::anyhow!("--start: {reason}")));
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

/// Write the days of a plant that are not there yet. A day file is there as a whole or not at all,
/// so an interrupted simulation goes on where it stopped.
pub(super) fn simulate(
    directory: &Path,
    options: PlantOptions,
    force: bool,
    printer: &Printer,
) -> anyhow::Result<Simulated> {
    let mut plant = Plant::new(options.clone())?;
    let simulation =
        Simulation { tool: TOOL.to_owned(), options, channels: plant.schema().to_vec() };
    let _claim = Claim::new(directory, Below::Unknown)?;
    own(directory, &simulation, force)?;
    let changes = changes::write(directory, &plant)?;
    let names: Vec<String> = plant.schema().iter().map(|channel| channel.name.clone()).collect();
    printer.say(&format!("simulate: {}", sentence(&plant)));
    let progress = printer.progress();
    progress.begin("simulating", u64::from(plant.days()));
    let mut simulated = Simulated {
        directory: directory.to_owned(),
        channels: names.len(),
        files: Vec::new(),
        written: 0,
        changes,
    };
    while plant.day() < plant.days() {
        if progress.interrupted() {
            return Err(Interrupted.into());
        }
        let path = directory.join(file_name(simulation.options.start, plant.day()));
        if path.exists() && !force {
            if plant.skip_day().is_none() {
                break;
            }
        } else {
            let Some(DayLog { timestamps, columns, .. }) = plant.next() else { break };
            let channels: Vec<_> = names.iter().zip(columns).collect();
            write_log(&path, &timestamps, &channels)?;
            simulated.written += 1;
        }
        simulated.files.push(path);
        progress.advance(1);
    }
    Ok(simulated)
}

/// What simulating a plant takes.
pub(super) fn sentence(plant: &Plant) -> String {
    let channels = plant.schema().len();
    let per_day = plant.instants() * (4 * channels as u64 + 8) / u64::from(plant.days()).max(1);
    format!(
        "{} x {} channels, {} rows; about {} of memory, at most {} on disk",
        days(plant.options().days),
        count(channels),
        count(plant.instants() as usize),
        bytes(3 * per_day),
        bytes(per_day * u64::from(plant.days())),
    )
}

/// "4.5 days".
fn days(days: f64) -> String {
    format!("{days} day{}", if days == 1.0 { "" } else { "s" })
}

/// What lies where the log of a plant should be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Found {
    /// All of it.
    Whole,
    /// Nothing, or a part of it.
    Unfinished,
    /// The log of another plant.
    Another,
    /// Parquet files that no simulation wrote.
    NotSimulated,
}

/// Whether `directory` has the log of this plant.
pub(super) fn find(directory: &Path, options: &PlantOptions) -> anyhow::Result<Found> {
    let found = match read_json::<Simulation>(&directory.join(SIMULATION)) {
        Ok(found) => found,
        Err(error) if !error.is_not_found() => return Err(error.into()),
        Err(_) if holds_logs(directory) => return Ok(Found::NotSimulated),
        Err(_) => return Ok(Found::Unfinished),
    };
    if found.options != *options {
        return Ok(Found::Another);
    }
    let days = Plant::new(options.clone())?.days();
    let is_there = |day| directory.join(file_name(options.start, day)).exists();
    Ok(if (0..days).all(is_there) { Found::Whole } else { Found::Unfinished })
}

/// Whether a folder has anything but hidden files: logs may lie in folders of their own.
fn holds_logs(directory: &Path) -> bool {
    let entries = std::fs::read_dir(directory).into_iter().flatten().flatten();
    entries.into_iter().any(|entry| !entry.file_name().to_string_lossy().starts_with('.'))
}

/// Make the directory this simulation's, unless it is another one's.
fn own(directory: &Path, simulation: &Simulation, force: bool) -> anyhow::Result<()> {
    let path = directory.join(SIMULATION);
    match read_json::<Simulation>(&path) {
        Ok(found) if found == *simulation => return Ok(()),
        Ok(_) if !force => bail!(
            "{} holds another simulation; choose another directory, or replace it with --force",
            directory.display()
        ),
        Err(error) if !error.is_not_found() && !force => return Err(error.into()),
        Err(_) if !force && has_parquet(directory) => bail!(
            "{} holds Parquet files that calib did not simulate; choose another directory",
            directory.display()
        ),
        _ => {}
    }
    if force {
        remove_days(directory)?;
        let days = Plant::new(simulation.options.clone())?.days();
        let day = |day| directory.join(file_name(simulation.options.start, day));
        if let Some(taken) = (0..days).map(day).find(|path| path.symlink_metadata().is_ok()) {
            bail!(
                "{} is in the way, and no simulation wrote it; move it, or choose another directory",
                taken.display()
            );
        }
    }
    Ok(write_json(&path, simulation)?)
}

fn parquet_files(directory: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(directory).into_iter().flatten().flatten();
    let paths = entries.map(|entry| entry.path());
    paths.filter(|path| path.extension().is_some_and(|extension| extension == "parquet")).collect()
}

fn has_parquet(directory: &Path) -> bool {
    !parquet_files(directory).is_empty()
}

/// Remove the days of the simulation that is being replaced; other Parquet files stay.
fn remove_days(directory: &Path) -> anyhow::Result<()> {
    let Ok(previous) = read_json::<Simulation>(&directory.join(SIMULATION)) else {
        return Ok(());
    };
    for day in 0..previous.options.days.ceil() as u32 {
        let path = directory.join(file_name(previous.options.start, day));
        remove_file(&path)?;
    }
    Ok(())
}

/// The date of a day of the plant, as a file name.
fn file_name(start: Timestamp, day: u32) -> String {
    let micros = start.as_micros() + i64::from(day) * 86_400_000_000;
    let date = jiff::Timestamp::from_microsecond(micros)
        .map(|instant| instant.to_zoned(jiff::tz::TimeZone::UTC).date().to_string());
    // The options were checked to lie between 1900 and 2200, which every calendar can name.
    format!("{}.parquet", date.unwrap_or_else(|_| format!("day-{day}")))
}
