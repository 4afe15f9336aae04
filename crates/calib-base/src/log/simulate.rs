//! The log of a simulated plant: a Parquet file for each day, and the changes of the plant beside them.

use std::path::{Path, PathBuf};

use calib_core::{Monitor as _, Timestamp};
use calib_data::table::write_log;
use calib_files::{FileError, FolderRecord, read_sealed_json, remove_file, write_sealed_json};
use calib_plant::{ChannelInfo, DayLog, Plant, PlantOptions};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{
    Context as _, StepError,
    artefact::{Below, DirectoryLock, Files, TOOL, fingerprint_once, fingerprints},
    bail, disk_room, ensure,
    log::changes::{self, CHANGES, DatedChange},
    output::{Printer, bytes, count},
};

/// The file that describes the plant of the day files beside it.
const SIMULATION: &str = "simulation.json";

/// `simulation.json`: the plant of the day files beside it, and the ground truth about each channel.
#[derive(Debug, Serialize, Deserialize)]
struct Simulation {
    tool: String,
    options: PlantOptions,
    channels: Vec<ChannelInfo>,
    /// The day files, once all of them are written.
    #[serde(default, skip_serializing_if = "Files::is_empty")]
    files: Files,
}

impl Simulation {
    fn is_of_plant(&self, other: &Self) -> bool {
        (&self.tool, &self.options, &self.channels)
            == (&other.tool, &other.options, &other.channels)
    }

    fn read(directory: &Path) -> Result<Self, FileError> {
        read_sealed_json(&directory.join(SIMULATION))
    }

    /// Returns the names of all files of the simulation: the day files and their descriptions.
    fn names(&self) -> Result<Vec<String>, StepError> {
        // Options that are invalid for every plant do not come from a simulation.
        let plant = Plant::new(self.options.clone())?;
        let changes = (plant.options().change.strength > 0.0).then_some(CHANGES);
        let days = (0..plant.days()).map(|day| file_name(self.options.start, day));
        let beside = [SIMULATION].into_iter().chain(changes).map(str::to_owned);
        Ok(beside.chain(days).collect())
    }

    /// Refuses existing days that have changed since they were written: the simulation would silently depend on
    /// them.
    fn check_days(&self, directory: &Path) -> Result<(), StepError> {
        for (name, written) in &self.files {
            let path = directory.join(name);
            ensure!(
                !path.exists() || fingerprint_once(&path)? == *written,
                "{} is not what was simulated: it was damaged or edited; remove it to have it simulated again, \
                 or keep edited logs in another folder, without [simulate]",
                path.display()
            );
        }
        Ok(())
    }
}

/// A simulated log.
#[derive(Debug, Serialize, JsonSchema)]
pub struct Simulated {
    directory: PathBuf,
    channels: usize,
    files: Vec<PathBuf>,
    written: usize,
    /// Changes in the plant; empty if it does not change.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    changes: Vec<DatedChange>,
}

impl Simulated {
    /// Returns a line about the present state of the log.
    pub fn line(&self) -> String {
        format!(
            "{} day files of {} channels in {} ({} written, {} already there)",
            self.files.len(),
            count(self.channels),
            self.directory.display(),
            self.written,
            self.files.len() - self.written,
        )
    }

    /// Returns the dated changes of the plant as text.
    pub fn changes(&self) -> Vec<String> {
        self.changes.iter().map(DatedChange::line).collect()
    }

    /// Returns a line about how often the plant changed, or `None` if it does not change.
    pub fn changes_line(&self) -> Option<String> {
        let first = self.changes.first()?;
        let last = self.changes.last()?;
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

/// Writes the missing days of a plant. A day file exists as a whole or not at all, so an interrupted simulation
/// resumes where it stopped.
///
/// # Errors
/// If the options are wrong, the folder holds other logs or cannot be written, or the observer asks to stop.
pub fn simulate(
    directory: &Path,
    options: PlantOptions,
    force: bool,
    printer: &Printer,
) -> Result<Simulated, StepError> {
    let mut plant = Plant::new(options.clone())?;
    let simulation = Simulation {
        tool: TOOL.to_owned(),
        options,
        channels: plant.schema().to_vec(),
        files: Files::new(),
    };
    require_room(directory, &plant)?;
    let mut claim = DirectoryLock::new(directory, Below::Unknown)?;
    let record = claim.record();
    let known = own(directory, record, &simulation, force)?;
    let changes = changes::write(directory, record, &plant)?;
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
        progress.check()?;
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
    let named = simulated.files.iter().filter_map(|path| path.file_name()?.to_str());
    let files = fingerprints(directory, named)?;
    if files != known {
        write_sealed_json(&directory.join(SIMULATION), &Simulation { files, ..simulation })?;
    }
    Ok(simulated)
}

/// Refuses days that do not fit on the disk. Existing days are kept, or replaced by files of the same size.
fn require_room(directory: &Path, plant: &Plant) -> Result<(), StepError> {
    let start = plant.options().start;
    let missing = (0..plant.days()).filter(|&day| !directory.join(file_name(start, day)).exists());
    disk_room::require(
        day_bytes(plant).saturating_mul(missing.count() as u64),
        "the log of the plant",
        directory,
        "simulate fewer days or channels, or into a folder on another disk",
    )
}

/// Returns an upper bound on the bytes per day of the log: Parquet compresses it.
fn day_bytes(plant: &Plant) -> u64 {
    let channels = plant.schema().len() as u64;
    plant.instants() * (4 * channels + 8) / u64::from(plant.days()).max(1)
}

/// Returns a sentence about the cost of simulating a plant.
pub fn sentence(plant: &Plant) -> String {
    let channels = plant.schema().len();
    let per_day = day_bytes(plant);
    format!(
        "{} x {} channels, {} rows; about {} of memory, at most {} on disk",
        days(plant.options().days),
        count(channels),
        count(plant.instants() as usize),
        bytes(3 * per_day),
        bytes(per_day * u64::from(plant.days())),
    )
}

/// Formats a number of days: "4.5 days".
fn days(days: f64) -> String {
    format!("{days} day{}", if days == 1.0 { "" } else { "s" })
}

/// The state of the folder in which the log of a plant should be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PlantLogState {
    /// The whole log.
    Whole,
    /// No days, or a part of them.
    Unfinished,
    /// The log of another plant.
    Another,
    /// Parquet files that no simulation wrote.
    NotSimulated,
}

/// Checks whether `directory` has the log of this plant.
pub(crate) fn find(directory: &Path, options: &PlantOptions) -> Result<PlantLogState, StepError> {
    let found = match Simulation::read(directory) {
        Ok(found) => found,
        Err(error) if !error.is_not_found() => {
            return Err(error).with_context(|| records(directory));
        }
        Err(_) if holds_logs(directory) => return Ok(PlantLogState::NotSimulated),
        Err(_) => return Ok(PlantLogState::Unfinished),
    };
    if found.options != *options {
        return Ok(PlantLogState::Another);
    }
    let days = Plant::new(options.clone())?.days();
    Ok(
        if !found.files.is_empty()
            && (0..days).all(|day| directory.join(file_name(options.start, day)).exists())
        {
            PlantLogState::Whole
        } else {
            PlantLogState::Unfinished
        },
    )
}

/// Refuses days of a simulated log that have changed since they were written, before they are read.
pub(crate) fn check_days(directory: &Path) -> Result<(), StepError> {
    Simulation::read(directory).map_or(Ok(()), |found| found.check_days(directory))
}

/// Returns the remedy for a log whose simulation is unknown.
fn records(directory: &Path) -> String {
    format!(
        "it is not known what the logs in {} were simulated from; simulate into another folder, or remove them with {SIMULATION}",
        directory.display()
    )
}

/// Whether a folder has anything but hidden files: logs may be in subfolders.
fn holds_logs(directory: &Path) -> bool {
    let entries = std::fs::read_dir(directory).into_iter().flatten().flatten();
    entries.into_iter().any(|entry| !entry.file_name().to_string_lossy().starts_with('.'))
}

/// Makes the directory this simulation's own, unless it belongs to another one. Returns the description of existing
/// days.
fn own(
    directory: &Path,
    record: &mut FolderRecord,
    simulation: &Simulation,
    force: bool,
) -> Result<Files, StepError> {
    let path = directory.join(SIMULATION);
    let found = Simulation::read(directory);
    if let Ok(found) = &found
        && !record.has(SIMULATION)
    {
        // A calib that kept no record has written these.
        record.add(found.names()?)?;
    }
    match found {
        Ok(found) if !force && found.is_of_plant(simulation) => {
            found.check_days(directory)?;
            record.note(simulation.names()?)?;
            return Ok(found.files);
        }
        Ok(_) if !force => bail!(
            "{} holds another simulation; choose another directory, or replace it with --force",
            directory.display()
        ),
        Err(error) if !error.is_not_found() && !force => {
            return Err(error).with_context(|| records(directory));
        }
        Err(_) if !force && has_parquet(directory) => bail!(
            "{} holds Parquet files that calib did not simulate; choose another directory",
            directory.display()
        ),
        _ => {}
    }
    if force {
        remove_days(directory, record)?;
    }
    record.note(simulation.names()?)?;
    write_sealed_json(&path, simulation)?;
    Ok(Files::new())
}

fn has_parquet(directory: &Path) -> bool {
    let entries = std::fs::read_dir(directory).into_iter().flatten().flatten();
    let mut paths = entries.map(|entry| entry.path());
    paths.any(|path| path.extension().is_some_and(|extension| extension == "parquet"))
}

/// Removes the days of the simulation that is being replaced. Other Parquet files are kept.
fn remove_days(directory: &Path, record: &FolderRecord) -> Result<(), FileError> {
    let days = record.names().iter().filter(|name| name.ends_with(".parquet"));
    days.map(|name| directory.join(name)).try_for_each(|path| remove_file(&path))
}

/// Returns the date of a day of the plant, as a file name.
fn file_name(start: Timestamp, day: u32) -> String {
    let micros = start.as_micros() + i64::from(day) * 86_400_000_000;
    let date = jiff::Timestamp::from_microsecond(micros)
        .map(|instant| instant.to_zoned(jiff::tz::TimeZone::UTC).date().to_string());
    // The options were checked to lie between 1900 and 2200, which every calendar can name.
    format!("{}.parquet", date.unwrap_or_else(|_| format!("day-{day}")))
}
