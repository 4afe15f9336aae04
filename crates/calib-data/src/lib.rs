//! Reads plant logs and writes tidy tables. This is the only crate that names polars.
//!
//! - [`DataConfig`], [`PreprocessConfig`]: the sections `[data]` and `[preprocess]` of a study.
//! - [`inspect`]: describes a log and the result of preprocessing: a [`Profile`].
//! - [`load`]: returns the cleaned, split and normalised log: a [`Dataset`]. [`survey`] returns its size first, and
//!   [`Surveyed::recorded`] returns columns as they were recorded.
//! - [`import`]: converts a log of any form to one wide Parquet file.
//! - [`write_arrow_stream`]: writes a table from the memory of another program as a Parquet file.
//! - [`sketch`]: describes a whole log, to help choose how to read it.
//! - [`entry_of`]: returns an entry for `data.exclude` that names one channel and no other.
//! - [`read_tags`]: reads units and labels of channels from a list of tags.
//! - [`table`]: typed tables and plant logs as Parquet files.
//! - [`number_columns`]: numbers in a text table that is no log.
//! - [`parse_time`], [`format_time`]: instants as text.
//!
//! Files are recognised by their first rows (`log::shape`). Wide Parquet is read in place. Text and tables of samples
//! are first converted to columns outside of memory (`text`, `log::columns`, `log::series`).
//!
//! A log is read in two passes. The first (`log`, `survey`) sorts the rows of all files by time, examines every
//! channel, and decides which channels are kept (`select`) and which rows are dropped (`impute`). The second
//! (`dataset`) reads the kept channels again and writes the states. Both process the channels in batches, file by file
//! and slice by slice: memory holds the states, the timestamps and one batch.
//!
//! ```
//! use calib_core::{Silent, Timestamp};
//! use calib_data::{DataConfig, Paths, PreprocessConfig, load, table::write_log};
//!
//! let directory = tempfile::tempdir()?;
//! let path = directory.path().join("log.parquet");
//! let times: Vec<Timestamp> = (0..100).map(|second| Timestamp::from_micros(second * 1_000_000)).collect();
//! let level: Vec<f32> = (0..100).map(|second| (second % 7) as f32).collect();
//! write_log(&path, &times, &[("LIT101", level)])?;
//!
//! let data = DataConfig { path: Paths::from(path), ..DataConfig::default() };
//! let dataset = load(&data, &PreprocessConfig::default(), &Silent)?;
//! assert_eq!(dataset.train.states().columns(), 1);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod angle;
mod arrow;
mod catch_panic;
mod channel;
mod channel_description;
mod checksums;
mod clock_changes;
mod config;
mod dataset;
mod describe;
mod doubts;
mod error;
mod features;
mod first_few;
mod frozen;
mod import;
mod impute;
mod log;
mod matrix;
mod modes;
mod names;
mod outliers;
mod profile;
mod recorded;
mod reject;
mod sample;
mod select;
mod sentinels;
mod shown_clock;
mod similar_names;
mod sketch;
mod statistics;
mod survey;
mod switches_read;
pub mod table;
mod tags;
mod text;
mod unit_change;

pub use calib_text::{
    NotANumber, NumberColumn, TimestampUnit, Zone, format_time, most_cells, number_columns,
    parse_time,
};

pub use angle::{AngleOf, AnglePart, angle_hint};
pub use arrow::{ArrowError, TakenOver, write_arrow_stream};
pub use catch_panic::is_reading_parquet;
pub use channel::is_same;
pub use channel_description::Description;
pub use config::{
    BadRows, Contradictions, DataConfig, MaxAge, Missing, Moment, Normalisation, Outliers, Paths,
    PreprocessConfig, Reduce, Resample, Shape, TimeRange,
};
pub use dataset::{Dataset, Surveyed, inspect, load, survey};
pub use doubts::{contradicted_period, long_gap, many_gaps, unused_exclude, without_times};
pub use error::DataError;
pub use import::{Dropped, Imported, import};
pub use log::{BadRowsFound, ContradictionCause, Declared, log_files, text_left_alone};
pub use names::entry_of;
pub use outliers::Fences;
pub use profile::{
    BackwardStep, BackwardSteps, BridgedStops, ChannelProfile, ContradictionsFound, Duplicates,
    FEW_CONTRADICT, FarOut, Gaps, PartProfile, Profile, ValueProfile,
};
pub use recorded::{RecordedColumns, TextFound};
pub use select::DropReason;
pub use sentinels::Sentinel;
pub use shown_clock::ShownClock;
pub use similar_names::{hint, nearest_names};
pub use sketch::{ChannelSketch, FEW_VALUES, Sketch, counts_on_evenly, sketch};
pub use tags::read_tags;
pub use unit_change::UnitChange;
