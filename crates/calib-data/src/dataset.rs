//! The second pass over a log: turns the values of the kept channels into states.

use std::ops::Range;

use calib_core::{
    Bounds, Column, ColumnKind, Frames, Monitor, Normaliser, Period, Segments, Timestamp,
};
use calib_files::{Fingerprint, Fingerprinter, ScratchPlace};
use rayon::prelude::*;

use crate::{
    DataConfig, DataError, PreprocessConfig, Profile, features,
    impute::impute,
    log::Batch,
    matrix::Matrix,
    survey::{Sensor, Survey, sampled_period},
};

/// A cleaned and normalised log.
#[derive(Clone, Debug)]
pub struct Dataset {
    /// The columns of the states, with their maps to physical units.
    pub normaliser: Normaliser,
    /// The training range.
    pub train: Frames,
    /// The held-out range, if there is one.
    pub held_out: Option<Frames>,
    /// Time from one row of a segment to the next.
    pub period: Period,
    /// Description of the log and of its cleaning.
    pub profile: Profile,
    /// Fingerprint of the input of a model: columns, bounds, timestamps, segments and states of the training range. It
    /// does not depend on how the log is split into files, nor on the held-out range.
    pub fingerprint: Fingerprint,
    /// Fingerprint of the held-out range.
    pub held_out_fingerprint: Option<Fingerprint>,
}

impl Dataset {
    /// Returns the fingerprint of `frames`: states with the columns of this log, such as a part of its training range.
    pub fn fingerprint_of(&self, frames: &Frames) -> Fingerprint {
        fingerprint(&self.normaliser, self.period, frames)
    }
}

/// Memory for reading in addition to the states, in bytes: a batch of channels, and per row of the log its time and
/// flags.
const READING: u64 = 320 << 20;
const READING_A_ROW: u64 = 28;

/// Reads, cleans, splits and normalises a log.
///
/// The states have these columns, in order: kept channels as in the files; their traces, one decay rate after the
/// other, called `trace(0.9) NAME`; `time_of_day_sin` and `time_of_day_cos` in `[-1, 1]`; `MODE=value` as 0 or 1.
///
/// The files are read twice: once to describe every channel, and once for the values of the kept channels. Memory is
/// bounded by the states, 8 bytes per row for each channel of a batch (256 MB, or two channels), and the timestamps.
///
/// # Errors
/// If the files, the ranges or the settings do not give a log with at least one transition in each range.
pub fn load(
    data: &DataConfig,
    preprocess: &PreprocessConfig,
    monitor: &dyn Monitor,
) -> Result<Dataset, DataError> {
    survey(data, preprocess, monitor)?.load(&ScratchPlace::Memory, monitor)
}

/// Runs the first pass of [`load`], which determines the size and columns of the states.
///
/// # Errors
/// As [`load`].
pub fn survey(
    data: &DataConfig,
    preprocess: &PreprocessConfig,
    monitor: &dyn Monitor,
) -> Result<Surveyed, DataError> {
    let survey = Survey::new(data, preprocess, monitor)?;
    survey.refuse_contradictions(data.contradictions)?;
    survey.refuse_period()?;
    survey.refuse_empty(data, preprocess)?;
    let columns = survey.columns(preprocess);
    Ok(Surveyed { survey, columns, preprocess: preprocess.clone() })
}

/// A log after the first pass: all is known except the states.
#[expect(missing_debug_implementations, reason = "it would be the log")]
pub struct Surveyed {
    pub(crate) survey: Survey,
    columns: Vec<Column>,
    pub(crate) preprocess: PreprocessConfig,
}

impl Surveyed {
    /// Returns the number of training states.
    pub fn rows(&self) -> usize {
        self.survey.train.samples.rows()
    }

    /// Returns the profile of the log.
    pub fn profile(&self) -> &Profile {
        &self.survey.profile
    }

    /// Returns the time of each training state.
    pub fn timestamps(&self) -> Vec<Timestamp> {
        self.survey.train.samples.timestamps(&self.survey.log.rows.timestamps)
    }

    /// Returns the segments of training states without a gap.
    pub fn segment_rows(&self) -> &Segments {
        &self.survey.train.samples.segments
    }

    /// Returns the number of held-out states.
    pub fn held_out_rows(&self) -> usize {
        self.survey.held_out.as_ref().map_or(0, |part| part.samples.rows())
    }

    /// Returns the number of columns of the states.
    pub fn columns(&self) -> usize {
        self.columns.len()
    }

    /// Returns the number of rows of the log.
    pub fn log_rows(&self) -> usize {
        self.survey.log.rows.timestamps.len()
    }

    /// Returns the size of all states, in bytes.
    pub fn state_bytes(&self) -> u64 {
        let rows = (self.rows() + self.held_out_rows()) as u64;
        rows * self.columns() as u64 * size_of::<f32>() as u64
    }

    /// Returns the memory that computing the states needs in addition to the states, in bytes: a batch of channels,
    /// and per row of the log its time and flags.
    pub fn working_bytes(&self) -> u64 {
        READING + READING_A_ROW * self.log_rows() as u64
    }

    /// Runs the second pass of [`load`]: reads the kept channels and computes the states, which are stored in `place`.
    /// On a disk they take twice their size there while they are computed.
    ///
    /// # Errors
    /// If a file can no longer be read, a state is not finite, there is no room, or the monitor interrupts.
    pub fn load(self, place: &ScratchPlace, monitor: &dyn Monitor) -> Result<Dataset, DataError> {
        let Self { survey, columns, preprocess } = self;
        let mut train = Matrix::new(&survey.train, columns.len(), place)?;
        let held_out = survey.held_out.as_ref();
        let mut held_out =
            held_out.map(|part| Matrix::new(part, columns.len(), place)).transpose()?;
        let mut matrices: Vec<&mut Matrix<'_>> =
            [&mut train].into_iter().chain(&mut held_out).collect();
        survey.fill(&preprocess, &mut matrices, monitor)?;
        let timestamps = &survey.log.rows.timestamps;
        let train = train.into_frames(timestamps, &columns)?;
        let held_out =
            held_out.map(|matrix| matrix.into_frames(timestamps, &columns)).transpose()?;
        let normaliser = Normaliser::new(columns);
        let period = sampled_period(survey.log.period, &preprocess);
        Ok(Dataset {
            fingerprint: fingerprint(&normaliser, period, &train),
            held_out_fingerprint: held_out
                .as_ref()
                .map(|held_out| fingerprint(&normaliser, period, held_out)),
            profile: survey.profile,
            normaliser,
            train,
            held_out,
            period,
        })
    }
}

/// Describes a log, and what [`load`] would make of it.
///
/// # Errors
/// If the files, the ranges or the settings do not give a log. Ranges without a transition, and logs without a usable
/// channel, are not errors here: the profile shows the reason.
pub fn inspect(
    data: &DataConfig,
    preprocess: &PreprocessConfig,
    monitor: &dyn Monitor,
) -> Result<Profile, DataError> {
    Survey::new(data, preprocess, monitor).map(|survey| survey.profile)
}

impl Survey {
    /// Returns the name and the bounds of each sensor, in order.
    fn bounds_by_name(&self) -> impl Iterator<Item = (String, Bounds)> {
        self.sensors
            .iter()
            .map(move |sensor| (self.log.channels[sensor.channel].name.clone(), sensor.bounds))
    }

    /// Returns the columns of the states, in order.
    fn columns(&self, preprocess: &PreprocessConfig) -> Vec<Column> {
        let mut columns: Vec<Column> = self
            .bounds_by_name()
            .map(|(name, bounds)| Column { name, kind: ColumnKind::Sensor, bounds })
            .collect();
        for decay in &preprocess.traces {
            columns.extend(self.bounds_by_name().map(|(name, bounds)| {
                let name = format!("trace({decay}) {name}");
                Column { name, kind: ColumnKind::Feature, bounds }
            }));
        }
        if preprocess.time_of_day {
            let names = ["time_of_day_sin", "time_of_day_cos"];
            columns.extend(names.map(|name| feature(name.to_owned())));
        }
        if let Some(modes) = &self.modes {
            let name = &self.log.channels[modes.channel].name;
            columns.extend(modes.columns(name).map(feature));
        }
        columns
    }

    fn fill(
        &self,
        preprocess: &PreprocessConfig,
        matrices: &mut [&mut Matrix<'_>],
        monitor: &dyn Monitor,
    ) -> Result<(), DataError> {
        let mut batch = Batch::default();
        let runs = self.runs();
        let count = self.sensors.len();
        monitor.begin("reading kept channels", count as u64);
        let size = self.log.batch_size();
        for (position, sensors) in self.sensors.chunks(size).enumerate() {
            let first = position * size;
            let channels: Vec<usize> = sensors.iter().map(|sensor| sensor.channel).collect();
            let channels = self.log.read(&channels, &mut batch, monitor)?;
            channels.par_iter_mut().zip(sensors).for_each(|(channel, sensor)| {
                self.repair(&mut channel.values, sensor, preprocess);
            });
            let bounded: Vec<(&[f64], Bounds)> = channels
                .iter()
                .zip(sensors)
                .map(|(channel, sensor)| (channel.values.as_slice(), sensor.bounds))
                .collect();
            for matrix in matrices.iter_mut() {
                matrix.fill(first, &bounded)?;
            }
            for (trace, &decay) in preprocess.traces.iter().enumerate() {
                let traced: Vec<Vec<f64>> = channels
                    .par_iter()
                    .map(|channel| {
                        let mut values = channel.values.clone();
                        features::trace(&mut values, &runs, decay);
                        values
                    })
                    .collect();
                let bounded: Vec<(&[f64], Bounds)> = traced
                    .iter()
                    .zip(sensors)
                    .map(|(values, sensor)| (values.as_slice(), sensor.bounds))
                    .collect();
                for matrix in matrices.iter_mut() {
                    matrix.fill((trace + 1) * count + first, &bounded)?;
                }
            }
        }
        self.fill_features(preprocess, matrices)
    }

    fn fill_features(
        &self,
        preprocess: &PreprocessConfig,
        matrices: &mut [&mut Matrix<'_>],
    ) -> Result<(), DataError> {
        let first = self.sensors.len() * (1 + preprocess.traces.len());
        let times = preprocess
            .time_of_day
            .then(|| features::time_of_day(&self.log.rows.timestamps))
            .into_iter()
            .flatten();
        let modes = self
            .modes
            .iter()
            .flat_map(|modes| (0..modes.labels.len()).map(move |mode| modes.one_hot(mode)));
        for (position, values) in times.chain(modes).enumerate() {
            for matrix in matrices.iter_mut() {
                matrix.fill(first + position, &[(&values, Bounds::IDENTITY)])?;
            }
        }
        Ok(())
    }

    /// Treats outliers and fills missing values as the first pass decided, then clips.
    fn repair(&self, values: &mut [f64], sensor: &Sensor, preprocess: &PreprocessConfig) {
        let profile = &self.profile.channels[sensor.channel];
        if let Some(fences) = sensor.fences.filter(|_| profile.far_out.spikes > 0) {
            fences.treat(values, &self.stretches, preprocess.outliers);
        }
        if profile.imputed > 0 {
            let timestamps = &self.log.rows.timestamps;
            let missing = preprocess.missing;
            let limit = preprocess.fill_limit;
            impute(values, timestamps, &self.stretches, missing, limit, |_| {});
        }
        let bounds = sensor.bounds;
        if preprocess.clip {
            let low = bounds.offset;
            let high = bounds.offset + bounds.scale;
            for value in values {
                *value = value.clamp(low, high);
            }
        }
    }

    fn runs(&self) -> Vec<Range<usize>> {
        let held_out = self.held_out.iter().flat_map(|part| &part.runs);
        self.train.runs.iter().chain(held_out).cloned().collect()
    }
}

/// Returns a computed column that is not a sensor.
fn feature(name: String) -> Column {
    Column { name, kind: ColumnKind::Feature, bounds: Bounds::IDENTITY }
}

/// Returns the fingerprint of the states of one range and of their columns.
fn fingerprint(normaliser: &Normaliser, period: Period, frames: &Frames) -> Fingerprint {
    let mut all = Fingerprinter::default();
    all.add(b"dataset 1").add(&period.as_micros().to_le_bytes());
    for column in normaliser.columns() {
        all.add(column.name.as_bytes())
            .add(&column.bounds.offset.to_le_bytes())
            .add(&column.bounds.scale.to_le_bytes());
    }
    let times: Vec<i64> = frames.timestamps().iter().map(|time| time.as_micros()).collect();
    let ends: Vec<u32> = frames.segments().iter().map(|segment| segment.end).collect();
    all.add(bytemuck::cast_slice(&times))
        .add(bytemuck::cast_slice(&ends))
        .add(bytemuck::cast_slice(frames.states().as_slice()));
    all.finish()
}
