use std::path::{Path, PathBuf};

use calib_core::Cancelled;
use calib_files::FileError;
use calib_text::SignError;

use crate::{BadRowsFound, ContradictionCause, similar_names::hint};

/// The reason why a log cannot be used. Every message says what was found, where, and what to do.
#[derive(Debug, thiserror::Error)]
pub enum DataError {
    /// A study sets the held-out range, but not the training range.
    #[error("data.held_out is set without data.train: set both, or data.train_fraction alone")]
    HeldOutWithoutTrain,
    /// A setting is out of range.
    #[error("{key} = {got}: expected {expected}")]
    Config {
        /// Section and key.
        key: String,
        /// The value.
        got: String,
        /// Allowed values.
        expected: &'static str,
    },
    /// A column that is requested by name does not exist.
    #[error("the log has no column {name}{hint}")]
    NoSuchColumn {
        /// The name.
        name: String,
        /// Columns with similar names.
        hint: String,
    },
    /// A column that should hold numbers holds another type.
    #[error(
        "column {name} is of type {type_name}, expected numbers or booleans; write its values as numbers"
    )]
    NoNumbers {
        /// Name of the column.
        name: String,
        /// Type of the column.
        type_name: String,
    },
    /// No path was given.
    #[error(
        "data.path is empty: name a Parquet or CSV file, a folder, a glob pattern, or a list of them"
    )]
    NoPath,
    /// A path or pattern matches no log file.
    #[error("no log at {pattern}: {reason}; data.path names files, folders or patterns of logs")]
    NoFile {
        /// The given path or pattern.
        pattern: String,
        /// What was searched for.
        reason: String,
    },
    /// The partition filter leaves no file.
    #[error("data.partitions: no file lies in a folder {key}={value}; there are: {available}")]
    NoPartition {
        /// Hive key.
        key: String,
        /// Requested value.
        value: String,
        /// Existing partitions.
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
        /// Hive key in which the two differ.
        key: String,
        /// Value of the first file.
        value: String,
    },
    /// The operating system refused access.
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
        /// Finding of the reader.
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
    /// A cell of a text file is not of the type of its column.
    #[error("{}, line {line}: {reason}", path.display())]
    Record {
        /// The file.
        path: PathBuf,
        /// The line, from 1.
        line: u64,
        /// What was found, and what to do.
        reason: String,
    },
    /// Times can be read in several ways.
    #[error(
        "the times of {} can be read in several ways: {example:?} is {readings}. Choose one of them in the study, or with --set on the command line",
        path.display()
    )]
    AmbiguousTimes {
        /// The file.
        path: PathBuf,
        /// A time.
        example: String,
        /// The possible instants, and how to choose each.
        readings: String,
    },
    /// The files have different shapes, or a file could have two.
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
        /// Number of values that differ from another one at the same time.
        count: u64,
        /// Three of these values.
        examples: Vec<String>,
        /// The cause, if it is known.
        cause: Option<ContradictionCause>,
    },
    /// Lines of text files are not rows.
    #[error(
        "{}{} {}",
        if found.count == 1 { String::new() } else { format!("{} of {lines} lines cannot be read: ", found.count) },
        ended(&found.examples.join("; ")),
        if *too_many_to_skip {
            "That is more than one line in a hundred, which data.bad_rows = \"skip\" would leave out: are data.separator, data.decimal and data.timestamp_format right?"
        } else {
            found.remedy()
        }
    )]
    BadRows {
        /// Their number, and the first few.
        found: BadRowsFound,
        /// Number of all lines below the headers.
        lines: u64,
        /// Whether they are too many to skip.
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
        /// Rows without a time.
        without_time: u64,
    },
    /// The log has more rows than 32 bits can count.
    #[error(
        "the log has {rows} rows, more than the {} that calib can index; choose a part of it{}",
        u32::MAX,
        if *resampled { ", or raise data.period_secs" } else { "" }
    )]
    TooManyRows {
        /// Number of rows.
        rows: u64,
        /// Whether these are rows of a clock that the study asks for.
        resampled: bool,
    },
    /// A clock that is far finer than the recorded data.
    #[error(
        "data.period_secs = {period_secs} makes {values} values of {samples} that were recorded; raise it, lower data.max_age_secs, \
         or choose channels with data.include"
    )]
    TooFine {
        /// Time from one row to the next, in seconds.
        period_secs: f64,
        /// Values of all channels on the clock.
        values: u64,
        /// Recorded values.
        samples: u64,
    },
    /// Reading the log needs more memory than is available.
    #[error("{what} takes {} of memory at least, and {} are available; {remedy}", size(*needed), size(*available))]
    TooLarge {
        /// The part that needs the memory.
        what: String,
        /// Needed memory, in bytes.
        needed: u64,
        /// Available memory, in bytes.
        available: u64,
        /// How to reduce the need.
        remedy: &'static str,
    },
    /// The sample period cannot be determined.
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
    /// A fraction of the time span leaves one range almost without rows.
    #[error(
        "data.train_fraction divides the time of the log, most of which lies between {} and {}: {train} rows are for training and {held_out} are held out. \
         If the time {} is wrong, correct or delete that row; else say which rows are for what with data.train and data.held_out",
        gap[0], gap[1], if train < held_out { &gap[0] } else { &gap[1] }
    )]
    Lopsided {
        /// Training rows.
        train: usize,
        /// Held-out rows.
        held_out: usize,
        /// Begin and end of the time without rows.
        gap: [String; 2],
    },
    /// An entry of `data.angles` that cannot be split into two channels.
    #[error("data.angles, {entry:?}: {reason}")]
    Angle {
        /// The name or pattern, or the channel that it names.
        entry: String,
        /// What was found, and what to do.
        reason: String,
    },
    /// An entry of `data.max_age_secs` that names no channel, or contradicts another one.
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
        /// The reason, and what to do.
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
    /// A channel of text has more distinct words than calib can distinguish.
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
        /// Number of dropped channels per reason.
        reasons: String,
    },
    /// A period that the times of the log contradict.
    #[error("{told}")]
    ContradictedPeriod {
        /// Both periods, and what to set, in the words of
        /// [`contradicted_period`](crate::contradicted_period).
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
        /// Channels with the most missing values, and what to do.
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
    /// The observer requested a stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

/// Formats a number of bytes for people.
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
    /// Returns the error for a column in `data.where` that does not exist.
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

    pub(crate) fn not_parquet(path: &Path, reason: String) -> Self {
        Self::NotParquet { path: path.to_owned(), reason }
    }

    pub(crate) fn one_hot(name: &str, reason: String) -> Self {
        Self::OneHot { name: name.to_owned(), reason }
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

/// Ends a sentence with a full stop, unless it is a question.
fn ended(sentence: &str) -> String {
    if sentence.ends_with('?') { sentence.to_owned() } else { format!("{sentence}.") }
}

/// Explains why a log of `files` files has no rows, or no row with a time, and what to check.
fn why_no_rows(files: usize, without_time: u64) -> String {
    match (files, without_time) {
        (1, 0) => "the file has a header and no rows; check data.path".to_owned(),
        (files, 0) => format!("its {files} files have a header and no rows; check data.path"),
        (_, rows) => format!("{rows} rows have no time that can be read; check data.timestamp"),
    }
}
