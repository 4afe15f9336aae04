//! A log that stands in for one that is not simulated yet, so that a dry run can say what a study will take.

use std::{iter::repeat_n, path::Path};

use calib_core::{Frames, Period, Segment, Segments, Silent, States, Timestamp};
use calib_data::{Dataset, table::write_log};
use calib_files::TemporaryFolder;
use calib_plant::{Plant, PlantOptions};
use calib_study::Job;

use crate::{
    StepError,
    log::{context::RunContext, plant_of_study},
    memory,
};

/// Rows that are enough to see which channels are left, and quick to simulate.
const ENOUGH_ROWS: u64 = 20_000;
/// The longest time between rows that a plant is simulated with, in seconds.
const LONGEST_PERIOD: f64 = 3_600.0;

/// The log of the same plant at fewer instants, in a folder that goes with it. Each of its rows stands for several.
pub struct StandInLog {
    _folder: TemporaryFolder,
    job: Job,
    rows_each: usize,
}

impl StandInLog {
    /// For the log of `options` that the study of `job` reads; nothing if its states would take more than a third of the memory that is there, for
    /// they are made when rows are repeated.
    ///
    /// # Errors
    /// If the plant cannot be simulated, nothing can be written to the folder for temporary files, or nothing of the log is left for the study.
    pub fn of(options: &PlantOptions, job: &Job) -> Result<Option<Self>, StepError> {
        let folder = TemporaryFolder::new()?;
        let subsample = job.study().preprocess.subsample as u64;
        let wanted = Plant::new(options.clone())?.instants() / (ENOUGH_ROWS * subsample);
        let period = options.period.as_secs();
        let rows_each = wanted.clamp(1, (LONGEST_PERIOD / period).max(1.0) as u64);
        let secs = period * rows_each as f64;
        let period = Period::from_secs(secs).unwrap_or(options.period);
        write(Plant::new(PlantOptions { period, ..options.clone() })?, folder.path())?;
        let mut request = job.request().clone();
        let path = toml::Value::String(folder.path().display().to_string());
        request.set.push(format!("data.path={path}"));
        let job = Job::resolve(request)?;
        let data = plant_of_study::data_to_read(&job)?;
        let surveyed = calib_data::survey(&data, &job.study().preprocess, &Silent)?;
        let states = surveyed.state_bytes().saturating_mul(rows_each);
        let fits = memory::available().is_none_or(|available| states <= available / 3);
        Ok(fits.then_some(Self { _folder: folder, job, rows_each: rows_each as usize }))
    }

    /// The study that reads it.
    pub fn job(&self) -> &Job {
        &self.job
    }

    /// What the steps of that study talk to.
    pub fn context(&self, context: &RunContext) -> RunContext {
        context.with_stand_in(self.rows_each)
    }
}

/// Write all days of a plant into one file.
fn write(mut plant: Plant, folder: &Path) -> Result<(), StepError> {
    let names = plant.schema().iter().map(|channel| channel.name.clone());
    let mut channels: Vec<(String, Vec<f32>)> = names.map(|name| (name, Vec::new())).collect();
    let mut timestamps = Vec::new();
    for day in plant.by_ref() {
        timestamps.extend(day.timestamps);
        for ((_, values), column) in channels.iter_mut().zip(day.columns) {
            values.extend(column);
        }
    }
    Ok(write_log(&folder.join("log.parquet"), &timestamps, &channels)?)
}

/// A log whose rows each stand for `count` of another: as many rows as that has, with the states of this one.
pub(crate) fn repeated(dataset: Dataset, count: usize) -> Result<Dataset, StepError> {
    let secs = dataset.period.as_secs() / count as f64;
    let period = Period::from_secs(secs).unwrap_or(dataset.period);
    Ok(Dataset {
        train: repeated_rows(&dataset.train, count, secs)?,
        held_out: dataset
            .held_out
            .as_ref()
            .map(|frames| repeated_rows(frames, count, secs))
            .transpose()?,
        period,
        ..dataset
    })
}

fn repeated_rows(frames: &Frames, count: usize, period_secs: f64) -> Result<Frames, StepError> {
    let lengths = frames.segments().iter().map(Segment::rows).map(|rows| rows.len() * count);
    let states = frames.states();
    let mut values = Vec::with_capacity(states.as_slice().len() * count);
    let mut timestamps = Vec::with_capacity(frames.rows() * count);
    for (row, time) in frames.timestamps().iter().enumerate() {
        for part in 0..count {
            let after = (part as f64 * period_secs * 1e6) as i64;
            timestamps.push(Timestamp::from_micros(time.as_micros() + after));
        }
        values.extend(repeat_n(states.row(row), count).flatten());
    }
    let states = States::new(values, frames.rows() * count, states.columns())?;
    Ok(Frames::new(timestamps, Segments::from_lengths(lengths)?, states)?)
}
