//! The log that a study reads, if `[simulate]` describes how it is made.

use std::path::PathBuf;

use calib_data::DataConfig;
use calib_plant::{Plant, PlantOptions};
use calib_study::{Job, StepKind, StudyError};

use crate::{
    Context as _, StepError, bail,
    log::simulate::{self, PlantLogState, Simulated},
    memory,
    output::Printer,
};

/// Maximum number of similar channels that an error names.
const NEAREST: usize = 8;

/// The plant of a study, the place of its log, and the state of that log.
pub struct PlantOfStudy {
    /// Folder of the log.
    pub directory: PathBuf,
    /// Options of the plant.
    pub options: PlantOptions,
    /// State of the existing log.
    pub found: PlantLogState,
}

impl PlantOfStudy {
    /// Returns the plant of `[simulate]`, or `None` if the study has no such section.
    ///
    /// # Errors
    /// If the section is wrong, the folder of the log cannot be named, or its present state cannot be
    /// read.
    pub fn of(job: &Job) -> Result<Option<Self>, StepError> {
        let Some(config) = &job.study().simulate else { return Ok(None) };
        let options = config.plant().context("[simulate]")?;
        let folder = data_to_read(job)?.path.0.into_iter().next();
        let directory = PathBuf::from(folder.context("data.path is empty")?);
        let found = simulate::find(&directory, &options)?;
        Ok(Some(Self { directory, options, found }))
    }

    /// Refuses sensors to predict that the plant does not have, before its log exists.
    ///
    /// # Errors
    /// The first such sensor, with the most similar channel names.
    pub fn check_sensors(&self, job: &Job) -> Result<(), StepError> {
        let study = job.study();
        // The study reads other files, or renames the channels.
        if study.data.path.0.len() > 1 || study.data.file_as_prefix {
            return Ok(());
        }
        let plant = Plant::new(self.options.clone())?;
        let names = plant.schema().iter().map(|channel| channel.name.as_str());
        for sensor in &study.sweep.sensors {
            // An angle of the plant is two columns of the states.
            let angle = sensor.strip_suffix("_sin").or_else(|| sensor.strip_suffix("_cos"));
            if names.clone().any(|name| name == sensor || Some(name) == angle) {
                continue;
            }
            let nearest = calib_data::nearest_names(sensor, names.clone());
            let shown = nearest[..nearest.len().min(NEAREST)].join(", ");
            let rest = match nearest.len().saturating_sub(NEAREST) {
                0 => String::new(),
                more => format!(
                    " and {more} more: `{}` writes its log, and `calib inspect` then shows all",
                    job.command(StepKind::Simulate)
                ),
            };
            let hint = calib_data::hint(sensor, names.clone());
            let has =
                if hint.is_empty() { "; it has".to_owned() } else { format!("{hint} It has") };
            bail!(
                "sweep.sensors: sensor {sensor:?} is not a channel of the plant that [simulate] describes{has} {shown}{rest}"
            );
        }
        Ok(())
    }

    /// Writes the missing days of the log; `force` writes all of them again.
    ///
    /// # Errors
    /// As [`simulate`](simulate::simulate).
    pub fn make(self, force: bool, printer: &Printer) -> Result<Simulated, StepError> {
        simulate::simulate(&self.directory, self.options, force, printer)
    }
}

/// Returns the `[data]` section for reading an existing log.
///
/// # Errors
/// As [`PlantOfStudy::of`]; also if the log of the plant does not exist, or is of another plant.
pub fn data_of(job: &Job) -> Result<DataConfig, StepError> {
    if let Some(PlantOfStudy { directory, found, .. }) = PlantOfStudy::of(job)? {
        let directory = directory.display();
        let command = job.command(StepKind::Simulate);
        match found {
            // Logs that calib did not simulate are read as they are.
            PlantLogState::Whole | PlantLogState::NotSimulated => {}
            PlantLogState::Unfinished => {
                bail!(
                    "the log of the plant that [simulate] describes is not in {directory}; run `{command}` first"
                )
            }
            PlantLogState::Another => bail!(
                "{directory} holds another simulation than [simulate] describes; run `{command} --force` to replace it"
            ),
        }
    }
    Ok(data_to_read(job)?)
}

/// Refuses a log that differs from the one that `[simulate]` wrote, if the study has such a section.
pub(crate) fn check_days(job: &Job) -> Result<(), StepError> {
    match PlantOfStudy::of(job)? {
        Some(PlantOfStudy { directory, found: PlantLogState::Whole, .. }) => {
            simulate::check_days(&directory)
        }
        _ => Ok(()),
    }
}

/// Returns the `[data]` section with environment variables expanded.
///
/// # Errors
/// If a variable of the environment is not set.
pub fn data_to_read(job: &Job) -> Result<DataConfig, StudyError> {
    let data = job.data_to_read(|name| std::env::var(name).ok())?;
    Ok(memory::on_this_machine(data))
}

/// Returns the plant that a study describes, and the folder of its log, or `None` without a
/// description.
///
/// # Errors
/// If the description is not valid, or the folder cannot be named.
pub fn plant_of(job: &Job) -> Result<Option<(PathBuf, PlantOptions)>, StepError> {
    let plant = PlantOfStudy::of(job)?;
    Ok(plant.map(|PlantOfStudy { directory, options, .. }| (directory, options)))
}

/// Writes the missing part of the log of the plant that a study describes.
///
/// # Errors
/// As [`simulate`](simulate::simulate); also if the description is not valid.
pub fn write_log(job: &Job, printer: &Printer) -> Result<Option<Simulated>, StepError> {
    let plant = PlantOfStudy::of(job)?;
    plant.map(|plant| plant.make(job.policy().redoes(), printer)).transpose()
}
