//! A stand-in for a log that is not simulated yet, so that a dry run can estimate the cost of a study.

use std::{iter::repeat_n, path::Path};

use calib_core::{Frames, Monitor, Period, Segment, Segments, States, Timestamp};
use calib_data::{DataConfig, Dataset, table::write_log};
use calib_files::TemporaryFolder;
use calib_plant::{Plant, PlantOptions};
use calib_study::Job;

use crate::{
    StepError,
    clock::TimeTaken,
    cost::StepCost,
    ensure,
    log::{context::RunContext, plant_of_study},
    memory,
    output::bytes,
};

/// Number of rows that is enough to see which channels remain, and quick to simulate.
const ENOUGH_ROWS: u64 = 20_000;
/// The longest sampling interval that a plant is simulated with, in seconds.
const LONGEST_PERIOD: f64 = 3_600.0;

/// A log of the same plant at fewer instants, in a folder that is removed with it. Each of its rows represents several.
pub struct StandInLog {
    _folder: TemporaryFolder,
    job: Job,
    rows_each: usize,
    simulating: StepCost,
}

impl StandInLog {
    /// Simulates the stand-in for the log of `options` that the study of `job` reads.
    ///
    /// # Errors
    /// If its states would take more than an eighth of the available memory, because they are in memory once rows are
    /// repeated; if the study reads its log by its own clock, or no rows remain; if nothing can be written to the
    /// folder for temporary files; or the observer asks to stop.
    pub fn of(options: &PlantOptions, job: &Job, context: &RunContext) -> Result<Self, StepError> {
        let study = job.study();
        // The study's own subsampling is already applied here.
        let subsample = study.preprocess.subsample as u64;
        let instants = Plant::new(options.clone())?.instants();
        let wanted = (instants / subsample).div_ceil(ENOUGH_ROWS);
        let period = options.period.as_secs() * subsample as f64;
        let rows_each = wanted.clamp(1, (LONGEST_PERIOD / period).max(1.0) as u64);
        let options = PlantOptions {
            period: Period::from_secs(period * rows_each as f64).unwrap_or(options.period),
            ..options.clone()
        };
        let plant = Plant::new(options)?;
        let sampled_instants = plant.instants().max(1);
        let of_instant = 4 * plant.schema().len() as u64;
        let values = sampled_instants.saturating_mul(of_instant);
        let available = memory::available().unwrap_or(u64::MAX);
        let room = available / 8;
        ensure!(
            values <= room,
            "a sample of it takes {}, and {} may be taken",
            bytes(values),
            bytes(room)
        );
        let progress = context.progress();
        let folder = TemporaryFolder::new()?;
        let path = folder.path().join("log.parquet");
        let (written, taken) = TimeTaken::by(|| write(plant, &path, &progress));
        written?;
        let simulating = StepCost {
            processor_secs: taken.on_processors() * instants as f64 / sampled_instants as f64,
            // A day is in memory at a time.
            memory: 0,
            disk: instants.saturating_mul(of_instant),
        };
        let mut request = job.request().clone();
        let path = toml::Value::String(folder.path().display().to_string());
        request.set.push(format!("data.path={path}"));
        request.set.push("preprocess.subsample=1".to_owned());
        let job = Job::resolve(request)?;
        let data = plant_of_study::data_to_read(&job)?;
        let has_own_clock = data.period_secs.is_some() || data.resample.is_some();
        // Errors in the rest of the study are still found.
        let data = DataConfig { period_secs: None, resample: None, max_age_secs: None, ..data };
        let surveyed = calib_data::survey(&data, &job.study().preprocess, &progress)?;
        ensure!(!has_own_clock, "data.period_secs is another clock than a sample of the log has");
        let states = surveyed.state_bytes().saturating_mul(rows_each);
        ensure!(
            states <= room,
            "its states take {}, and {} may be taken",
            bytes(states),
            bytes(room)
        );
        Ok(Self { _folder: folder, job, rows_each: rows_each as usize, simulating })
    }

    /// Returns the study that reads it.
    pub fn job(&self) -> &Job {
        &self.job
    }

    /// Returns the expected cost of simulating the log that it stands in for.
    pub fn simulating(&self) -> StepCost {
        self.simulating
    }

    /// Returns the context for the steps of that study.
    pub fn context(&self, context: &RunContext) -> RunContext {
        context.with_stand_in(self.rows_each)
    }
}

/// Simulates the whole log of `plant`, and writes it to a file.
fn write(plant: Plant, path: &Path, monitor: &dyn Monitor) -> Result<(), StepError> {
    let names = plant.schema().iter().map(|channel| channel.name.clone());
    let mut channels: Vec<(String, Vec<f32>)> = names.map(|name| (name, Vec::new())).collect();
    let mut timestamps: Vec<Timestamp> = Vec::new();
    monitor.begin("simulating a sample", u64::from(plant.days()));
    for day in plant {
        monitor.check()?;
        timestamps.extend(day.timestamps);
        for ((_, values), column) in channels.iter_mut().zip(day.columns) {
            values.extend(column);
        }
        monitor.advance(1);
    }
    Ok(write_log(path, &timestamps, &channels)?)
}

/// Returns a log in which each row represents `count` rows: it has as many rows as the full log, with the states of
/// this one.
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
