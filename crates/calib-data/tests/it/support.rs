//! Helpers that create small logs.

use std::{
    fs,
    path::{Path, PathBuf},
};

use calib_core::{Silent, Timestamp};
use calib_data::{
    Contradictions, DataConfig, DataError, Dataset, PreprocessConfig, Profile, inspect, load,
    survey, table::Table,
};
use calib_files::ScratchPlace;

pub(crate) const NAN: f64 = f64::NAN;

/// A folder of log files.
pub(crate) struct Folder(tempfile::TempDir);

impl Folder {
    pub(crate) fn new() -> Self {
        Self(tempfile::tempdir().expect("a folder"))
    }

    /// Creates a folder with one file.
    pub(crate) fn of(name: &str, table: &Table) -> Self {
        let folder = Self::new();
        folder.write(name, table);
        folder
    }

    /// Creates a folder with one file that is not Parquet.
    pub(crate) fn of_text(name: &str, text: &str) -> Self {
        let folder = Self::new();
        folder.write_file(name, text);
        folder
    }

    pub(crate) fn path(&self) -> &Path {
        self.0.path()
    }

    pub(crate) fn file(&self, name: &str) -> PathBuf {
        self.path().join(name)
    }

    pub(crate) fn write(&self, name: &str, table: &Table) -> &Self {
        table.write_parquet(&self.file(name)).expect("written");
        self
    }

    /// Writes a file that is not Parquet, possibly in a folder below this one.
    pub(crate) fn write_file(&self, name: &str, text: &str) {
        let path = self.file(name);
        fs::create_dir_all(path.parent().expect("has one")).expect("created");
        fs::write(path, text).expect("written");
    }

    /// Returns the configuration for the whole folder as one training range.
    pub(crate) fn data(&self) -> DataConfig {
        DataConfig { train_fraction: 1.0, ..DataConfig::at(self.path()) }
    }

    pub(crate) fn inspect(&self) -> Profile {
        profile(&self.data())
    }

    pub(crate) fn load(&self) -> Dataset {
        load_with(&self.data(), &PreprocessConfig::default())
    }
}

pub(crate) fn profile(data: &DataConfig) -> Profile {
    inspect(data, &PreprocessConfig::default(), &Silent).expect("a log")
}

/// Returns the default preprocessing with a channel of modes.
pub(crate) fn one_hot(name: &str) -> PreprocessConfig {
    PreprocessConfig { one_hot: Some(name.to_owned()), ..PreprocessConfig::default() }
}

/// Loads the log, and checks that it is the same in memory and on a disk.
pub(crate) fn load_with(data: &DataConfig, preprocess: &PreprocessConfig) -> Dataset {
    let dataset = load(data, preprocess, &Silent).expect("a log");
    let disk = tempfile::tempdir().expect("a folder");
    let place = ScratchPlace::Disk(disk.path().to_owned());
    let surveyed = survey(data, preprocess, &Silent).expect("a log");
    let mapped = surveyed.load(&place, &Silent).expect("room");
    assert_eq!(mapped.fingerprint, dataset.fingerprint);
    assert_eq!(mapped.held_out_fingerprint, dataset.held_out_fingerprint);
    assert_eq!(mapped.profile, dataset.profile);
    dataset
}

pub(crate) fn refused(data: &DataConfig, preprocess: &PreprocessConfig) -> DataError {
    load(data, preprocess, &Silent).expect_err("refused")
}

/// Returns the reason why the log is rejected under the default preprocessing.
pub(crate) fn refusal(data: &DataConfig) -> String {
    refused(data, &PreprocessConfig::default()).to_string()
}

/// Asserts that the log is rejected under the default preprocessing, with a message that contains
/// `parts`.
#[track_caller]
pub(crate) fn assert_refused(data: &DataConfig, parts: &[&str]) {
    assert_refused_with(data, &PreprocessConfig::default(), parts);
}

#[track_caller]
pub(crate) fn assert_refused_with(
    data: &DataConfig,
    preprocess: &PreprocessConfig,
    parts: &[&str],
) {
    let told = refused(data, preprocess).to_string();
    for part in parts {
        assert!(told.contains(part), "{told}\n{part}");
    }
}

/// Returns the names of all channels.
pub(crate) fn names(profile: &Profile) -> Vec<&str> {
    profile.channels.iter().map(|channel| channel.name.as_str()).collect()
}

/// Returns the names of the channels that are sensors.
pub(crate) fn kept(profile: &Profile) -> Vec<&str> {
    profile.kept().map(|channel| channel.name.as_str()).collect()
}

pub(crate) fn seconds(seconds: impl IntoIterator<Item = i64>) -> Vec<Timestamp> {
    seconds.into_iter().map(|second: i64| Timestamp::from_micros(second * 1_000_000)).collect()
}

/// Returns a log with one row per second from second `start` on.
pub(crate) fn log(start: i64, channels: &[(&str, &[f64])]) -> Table {
    let rows = channels.first().map_or(0, |(_, values)| values.len() as i64);
    log_at(start..start + rows, channels)
}

/// Returns a log with rows at these seconds.
pub(crate) fn log_at(times: impl IntoIterator<Item = i64>, channels: &[(&str, &[f64])]) -> Table {
    let table = Table::new().with("timestamp", seconds(times));
    channels
        .iter()
        .fold(table, |table, (name, values)| table.with_optional(*name, optional(values)))
}

pub(crate) fn optional(values: &[f64]) -> Vec<Option<f64>> {
    let values = values.iter().map(|&value| (!value.is_nan()).then_some(value));
    values.collect()
}

pub(crate) fn train_seconds(dataset: &Dataset) -> Vec<f64> {
    let timestamps = dataset.train.timestamps().iter();
    timestamps.map(|time| time.as_micros() as f64 / 1e6).collect()
}

/// Returns physical values of a column of the training range.
pub(crate) fn train_values(dataset: &Dataset, column: &str) -> Vec<f64> {
    let position = dataset.normaliser.position(column).expect("a column");
    let states = dataset.train.states();
    (0..states.rows())
        .map(|row| {
            let value = calib_core::Normalised(states.row(row)[position]);
            let physical = dataset.normaliser.physical(position, value).0;
            // The states are f32.
            (physical * 1e4).round() / 1e4
        })
        .collect()
}

/// Loads a log in which rows contradict each other, and returns the values of a column of the training range.
pub(crate) fn values_of_contradicting(
    folder: &Folder,
    contradictions: Contradictions,
    preprocess: &PreprocessConfig,
    column: &str,
) -> Vec<f64> {
    let data = DataConfig { contradictions, ..folder.data() };
    train_values(&load_with(&data, preprocess), column)
}

pub(crate) fn segment_lengths(dataset: &Dataset) -> Vec<usize> {
    dataset.train.segments().iter().map(|segment| segment.rows().len()).collect()
}
