use std::path::{Path, PathBuf};

use calib_core::Cancelled;
use calib_files::FileError;
use calib_text::SignError;

use crate::{BadRowsFound, ContradictionCause, names::hint};

/// Why a log cannot be used. Every message says what was found where, and what to do.
#[derive(Debug, thiserror::Error)]
pub enum DataError {
    /// A study says what is held out, and not what is learned from.
    #[error("data.held_out is set without data.train: set both, or data.train_fraction alone")]
    HeldOutWithoutTrain,
    /// A setting is out of range.
    #[error("{key} = {got}: expected {expected}")]
    Config {
        /// Section and key.
        key: String,
        /// The value.
        got: String,
        /// What is allowed.
        expected: &'static str,
    },
    /// A column that is asked for by its name is not there.
    #[error("the log has no column {name}{hint}")]
    NoSuchColumn {
        /// The name.
        name: String,
        /// Columns that are called alike.
        hint: String,
    },
    /// A column that should hold numbers holds something else.
    #[error(
        "column {name} is of type {type_name}, expected numbers or booleans; write its values as numbers"
    )]
    NoNumbers {
        /// Its name.
        name: String,
        /// What it is.
        type_name: String,
    },
    /// No path was given.
    #[error(
        "data.path is empty: name a Parquet or CSV file, a folder, a glob pattern, or a list of them"
    )]
    NoPath,
    /// A path or pattern leads to no file of a log.
    #[error("no log at {pattern}: {reason}; data.path names files, folders or patterns of logs")]
    NoFile {
        /// The path or pattern as it was given.
        pattern: String,
        /// What was looked for.
        reason: String,
    },
    /// The partition filter leaves no file.
    #[error("data.partitions: no file lies in a folder {key}={value}; there are: {available}")]
    NoPartition {
        /// Hive key.
        key: String,
        /// Value asked for.
        value: String,
        /// Partitions that exist.
        available: String,
    },
    /// Files of different partitions cover the same time.
    #[error(
        "{} and {} cover the same time but lie in different partitions: they are different plants or wells. \
         Choose one with data.partitions, for example partitions = {{ {key} = \"{value}\" }}",
        first.display(), second.display()
    )]
    MixedPartitions {
        /// A file.
        first: PathBuf,
        /// A file that overlaps it.
        second: PathBuf,
        /// Hive key in which they differ.
        key: String,
        /// The first file's value.
        value: String,
    },
    /// The system refused.
    #[error(transparent)]
    File(#[from] FileError),
    /// A file is not Parquet, or is damaged.
    #[error(
        "{} cannot be read as Parquet: {reason}. Either it is truncated or damaged: export it again; or a column has a type that is not supported (16-bit floats, times with offsets such as +05:30): \
         write it as another one, or leave it out with data.exclude",
        path.display()
    )]
    NotParquet {
        /// The file.
        path: PathBuf,
        /// What the reader found.
        reason: String,
    },
    /// A file is not text in records, or is damaged.
    #[error("{}: {reason}", path.display())]
    NotText {
        /// The file.
        path: PathBuf,
        /// What was found, and what to do.
        reason: String,
    },
    /// A cell of a text file is not what its column should hold.
    #[error("{}, line {line}: {reason}", path.display())]
    Record {
        /// The file.
        path: PathBuf,
        /// The line, from 1.
        line: u64,
        /// What was found, and what to do.
        reason: String,
    },
    /// Times can be read in two ways.
    #[error(
        "the times of {} can be read in several ways: {example:?} is {readings}. Choose one of them in the study, or with --set on the command line",
        path.display()
    )]
    AmbiguousTimes {
        /// The file.
        path: PathBuf,
        /// A time.
        example: String,
        /// The instants that it may be, and how to choose each.
        readings: String,
    },
    /// The files are of different shapes, or one could be of two.
    #[error("{reason}")]
    Shape {
        /// What was found, and what to do.
        reason: String,
    },
    /// Rows contradict each other.
    #[error(
        "rows of the same time contradict each other in {count} values: {}. \
         {}",
        examples.join("; "),
        ContradictionCause::remedy(cause.as_ref())
    )]
    Contradictions {
        /// Values that differ from another one of the same time.
        count: u64,
        /// Three of them.
        examples: Vec<String>,
        /// Why, if that can be told.
        cause: Option<ContradictionCause>,
    },
    /// Lines of text files are no rows.
    #[error(
        "{}{} {}",
        if found.count == 1 { String::new() } else { format!("{} of {lines} lines cannot be read: ", found.count) },
        ended(&found.examples.join("; ")),
        if *too_many_to_skip {
            "That is more than one line in a hundred, which data.bad_rows = \"skip\" would leave out: are data.separator, data.decimal and data.timestamp_format right?"
        } else {
            "Correct or remove such lines, or say how times are written with data.timestamp_format; data.bad_rows = \"skip\" leaves such lines out"
        }
    )]
    BadRows {
        /// How many, and the first few.
        found: BadRowsFound,
        /// All lines below the headers.
        lines: u64,
        /// Whether they are too many to be left out.
        too_many_to_skip: bool,
    },
    /// A file does not have the timestamp column.
    #[error("{} has no column {column:?} for the timestamps; {remedy}", path.display())]
    NoTimestamp {
        /// The file.
        path: PathBuf,
        /// The configured column.
        column: String,
        /// Columns that look like timestamps, or all columns, and what else to do.
        remedy: String,
    },
    /// The timestamp column does not hold timestamps.
    #[error(
        "column {column:?} of {} does not hold timestamps: {reason}",
        path.display()
    )]
    BadTimestamp {
        /// The file.
        path: PathBuf,
        /// The configured column.
        column: String,
        /// What was found and expected.
        reason: String,
    },
    /// The log has no rows.
    #[error(
        "the log in {path} has no rows: {}",
        why_no_rows(*files, *without_time)
    )]
    NoRows {
        /// `data.path`.
        path: String,
        /// Number of files.
        files: usize,
        /// Rows that have no time.
        without_time: u64,
    },
    /// The log has more rows than are counted in 32 bits.
    #[error(
        "the log has {rows} rows, more than the {} that calib can index; choose a part of it{}",
        u32::MAX,
        if *resampled { ", or raise data.period_secs" } else { "" }
    )]
    TooManyRows {
        /// Number of rows.
        rows: u64,
        /// Whether they are those of a clock that the study asks for.
        resampled: bool,
    },
    /// A clock that is far finer than what was recorded.
    #[error(
        "data.period_secs = {period_secs} makes {values} values of {samples} that were recorded; raise it, lower data.max_age_secs, \
         or choose channels with data.include"
    )]
    TooFine {
        /// From one row to the next, in seconds.
        period_secs: f64,
        /// Values of all channels on the clock.
        values: u64,
        /// Values that were recorded.
        samples: u64,
    },
    /// Reading the log takes more memory than there is.
    #[error("{what} takes {} of memory at least, and {} are available; {remedy}", size(*needed), size(*available))]
    TooLarge {
        /// What takes it.
        what: String,
        /// How much it takes, in bytes.
        needed: u64,
        /// How much there is.
        available: u64,
        /// What takes less.
        remedy: &'static str,
    },
    /// The sample period cannot be told.
    #[error("one row at {at} does not tell the sample period: set data.period_secs, or add rows")]
    NoPeriod {
        /// Time of the row.
        at: String,
    },
    /// The training and the held-out range overlap.
    #[error(
        "data.train ({train}) and data.held_out ({held_out}) overlap: an agent would be judged on what it was trained on"
    )]
    Overlap {
        /// Training range.
        train: String,
        /// Held-out range.
        held_out: String,
    },
    /// A range holds no rows.
    #[error("data.{key} ({range}) holds no rows: the log runs from {start} to {end}")]
    OutsideData {
        /// `train` or `held_out`.
        key: &'static str,
        /// The range.
        range: String,
        /// First row of the log.
        start: String,
        /// Last row of the log.
        end: String,
    },
    /// A share of the time leaves one range almost without rows.
    #[error(
        "data.train_fraction divides the time of the log, most of which lies between {} and {}: {train} rows are for training and {held_out} are held out. \
         If the time {} is wrong, correct or delete that row; else say which rows are for what with data.train and data.held_out",
        gap[0], gap[1], if train < held_out { &gap[0] } else { &gap[1] }
    )]
    Lopsided {
        /// Rows for training.
        train: usize,
        /// Rows held out.
        held_out: usize,
        /// Where the time without rows begins and ends.
        gap: [String; 2],
    },
    /// An entry of `data.angles` that makes no two channels.
    #[error("data.angles, {entry:?}: {reason}")]
    Angle {
        /// The name or pattern, or the channel that it names.
        entry: String,
        /// What was found, and what to do.
        reason: String,
    },
    /// An entry of `data.max_age_secs` that names no channel, or that another one contradicts.
    #[error("data.max_age_secs, {entry:?}: {reason}")]
    MaxAge {
        /// The name or pattern.
        entry: String,
        /// What was found, and what to do.
        reason: String,
    },
    /// A pattern names no channel.
    #[error("data.include has {pattern:?}, which names no channel{hint}")]
    NoSuchPattern {
        /// The pattern.
        pattern: String,
        /// Similar names, if there are any.
        hint: String,
    },
    /// A sensor is not a channel of the log.
    #[error("sensor {name:?} is not a channel of the log{hint}")]
    NoSuchSensor {
        /// The sensor.
        name: String,
        /// Similar names, if there are any.
        hint: String,
    },
    /// A sensor that is needed was dropped.
    #[error(
        "sensor {name:?} is needed but was dropped: {reason}; `calib inspect` shows every sensor: choose another, or other data"
    )]
    SensorDropped {
        /// The sensor.
        name: String,
        /// Why, and what to do.
        reason: String,
    },
    /// The mode column cannot be one-hot encoded.
    #[error("preprocess.one_hot = {name:?}: {reason}")]
    OneHot {
        /// The column.
        name: String,
        /// What was found and expected.
        reason: String,
    },
    /// A channel of text has more words than are told apart.
    #[error(
        "channel {name} has more different words, or longer ones, than calib tells apart; leave it out with data.exclude"
    )]
    TooManyWords {
        /// The channel.
        name: String,
    },
    /// No channel is left.
    #[error(
        "no channel is left of {channels} in the training range: {reasons}. `calib inspect` shows every channel; \
         data.train or data.train_fraction says which rows are for training"
    )]
    NoChannels {
        /// Number of channels in the log.
        channels: usize,
        /// How many were dropped for which reason.
        reasons: String,
    },
    /// A period that the times of the log contradict.
    #[error("{told}")]
    ContradictedPeriod {
        /// Both, and what to set, as [`contradicted_period`](crate::contradicted_period) says it.
        told: String,
    },
    /// Cleaning leaves no transition.
    #[error(
        "data.{key} has no two successive rows left: {rows} rows, {dropped} of them dropped for missing values, {segments} segments{culprits}"
    )]
    NoTransitions {
        /// `train` or `held_out`.
        key: &'static str,
        /// Rows of the log in the range.
        rows: usize,
        /// Rows dropped.
        dropped: usize,
        /// Segments left.
        segments: usize,
        /// Channels that miss most, and what to do.
        culprits: String,
    },
    /// A value cannot be represented after normalisation.
    #[error(
        "column {column:?} at {at} is too far outside its training range to be represented; set preprocess.clip or exclude it"
    )]
    NotFinite {
        /// The column.
        column: String,
        /// Time of the row.
        at: String,
    },
    /// The observer asked to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

/// A number of bytes as people read it.
fn size(bytes: u64) -> String {
    const MIB: f64 = (1_u64 << 20) as f64;
    match bytes as f64 / MIB {
        mib if mib < 1024.0 => format!("{mib:.0} MiB"),
        mib => format!("{:.1} GiB", mib / 1024.0),
    }
}

impl From<SignError> for DataError {
    fn from(SignError { path, reason }: SignError) -> Self {
        Self::NotText { path, reason }
    }
}

impl DataError {
    /// A column that `data.where` names is not there.
    pub(crate) fn where_column<'a>(
        path: &Path,
        name: &str,
        columns: impl Iterator<Item = &'a str>,
    ) -> Self {
        Self::Shape {
            reason: format!(
                "{} has no column {name:?}, which data.where names{}",
                path.display(),
                hint(name, columns)
            ),
        }
    }

    pub(crate) fn angle(entry: &str, reason: String) -> Self {
        Self::Angle { entry: entry.to_owned(), reason }
    }

    pub(crate) fn max_age(entry: &str, reason: String) -> Self {
        Self::MaxAge { entry: entry.to_owned(), reason }
    }

    pub(crate) fn config(key: String, got: String, expected: &'static str) -> Self {
        Self::Config { key, got, expected }
    }
}

/// A sentence with its full stop, unless it ends as a question.
fn ended(sentence: &str) -> String {
    if sentence.ends_with('?') { sentence.to_owned() } else { format!("{sentence}.") }
}

/// Why a log of so many files has no rows, or none that has a time, and what to check.
fn why_no_rows(files: usize, without_time: u64) -> String {
    match (files, without_time) {
        (1, 0) => "the file has a header and no rows; check data.path".to_owned(),
        (files, 0) => format!("its {files} files have a header and no rows; check data.path"),
        (_, rows) => format!("{rows} rows have no time that can be read; check data.timestamp"),
    }
}
