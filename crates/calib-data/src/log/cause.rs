//! Finds the cause of rows that contradict each other at the same time.

use std::collections::HashMap;

use calib_core::Monitor;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{
    Channel, Log, Origin,
    column_aliases::{TAGS, plain},
    file::LogFile,
    filename_tag::prefixes,
    read::Labels,
    rows::Rows,
    shared_times::SharedTimes,
};
use crate::{DataError, clock_changes::comes_twice};

/// Maximum number of plants in a log.
const PLANTS: usize = 200;
const NAMED: usize = 4;
/// The share of the rows at the same time that a cause must explain.
const EXPLAINED: f64 = 0.9;
/// Names of numeric columns that may identify plants; other such names end in id, no or nr.
const PLANT_NAMES: [&str; 18] = [
    "asset", "unit", "turbine", "machine", "pump", "well", "site", "device", "station", "room",
    "location", "plant", "line", "engine", "vehicle", "building", "meter", "id",
];

/// Why rows with the same time contradict each other.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ContradictionCause {
    /// They come from several plants, which a column distinguishes.
    Column {
        /// Name of the column.
        column: String,
        /// Values of the column, in order.
        values: Vec<String>,
    },
    /// They come from several files with the same columns.
    Files {
        /// Prefixes that the names of the channels would get, for the first files.
        prefixes: Vec<String>,
    },
    /// A clock was set back in autumn, so that an hour occurs twice.
    ClockSetBack {
        /// The day.
        date: String,
    },
    /// Most times are shared by an equal number of rows of one file: the export may have cut times to whole minutes
    /// or hours.
    SharedTimes {
        /// Rows per time.
        rows: u64,
        /// Seconds from one time to the next.
        step_secs: f64,
    },
}

impl ContradictionCause {
    /// Returns what to do about contradictions with this cause.
    pub(crate) fn remedy(cause: Option<&Self>) -> String {
        match cause {
            Some(Self::Column { column, values }) if TAGS.contains(&plain(column).as_str()) => format!(
                "They are of {} different {column:?} ({}): if these are tags, the log is a long table: set data.tag = {column:?}, data.value to the column of their \
                 values and, if there is one, data.quality to that of their quality. If they are of different plants, choose one with data.where",
                values.len(),
                named(values)
            ),
            Some(Self::Column { column, values }) => format!(
                "They are of {} different {column:?} ({}): choose one with data.where, on the command line as --set 'data.where={{ {column:?} = {:?} }}'. \
                 If each row is a sample of what {column:?} names, set data.tag = {column:?} and data.value instead",
                values.len(),
                named(values),
                values.first().map_or("", String::as_str)
            ),
            Some(Self::Files { prefixes }) => format!(
                "They are in files with the same columns ({}): if each file is of a room or a machine, data.file_as_prefix = true names channels after both (on the command line, --set data.file_as_prefix=true). \
                 If the files are exports of the same sensors, data.contradictions = \"first\" or \"last\" keeps one of the values",
                named(prefixes)
            ),
            Some(Self::ClockSetBack { date }) => format!(
                "The hour from 02:00 on {date} comes twice: on the last Sunday of October clocks in Europe are set back. Set data.time_zone to that of the log, such as \
                 \"Europe/Berlin\", and both hours are read (on the command line, --set data.time_zone=Europe/Berlin)"
            ),
            Some(Self::SharedTimes { rows, step_secs }) => {
                let spacing = (1e3 * step_secs / *rows as f64).round() / 1e3;
                format!(
                    "About {rows} rows share each time, and times are {step_secs} s apart. If the export cut the times, data.contradictions = \"spread\" puts these rows {spacing} s apart \
                     (on the command line, --set data.contradictions=spread). If the rows are of different machines, export the column that names them, and choose one with data.where"
                )
            }
            None => "If several rows of one time are of different sensors, the log is a long table: name the column that tells them apart with data.tag. \
                 If they are of different plants, choose one with data.where. If a clock was set back, data.time_zone may tell the two hours apart. \
                 Else data.contradictions = \"first\" or \"last\" keeps one of them"
                .to_owned(),
        }
    }
}

/// Lists the first of some values.
fn named(values: &[String]) -> String {
    let more = if values.len() > NAMED { ", …" } else { "" };
    format!("{}{more}", values.iter().take(NAMED).cloned().collect::<Vec<_>>().join(", "))
}

/// Returns the file of each row of the log.
fn owners(rows: &Rows) -> Vec<u32> {
    let mut owners = vec![0; rows.timestamps.len()];
    for (file, map) in rows.maps.iter().enumerate() {
        for file_row in map.needed() {
            if let Some(row) = map.row(file_row) {
                owners[row] = file as u32;
            }
        }
    }
    owners
}

impl Log {
    /// Counts the rows that were merged with a row of another file that has none of their channels.
    pub(crate) fn merged_rows(&self) -> u64 {
        let rows = self.recorded();
        if rows.duplicates.is_empty() || rows.maps.len() < 2 {
            return 0;
        }
        let owners = owners(rows);
        let mut apart: HashMap<(u32, u32), bool> = HashMap::new();
        let mut merged = 0;
        for duplicate in &rows.duplicates {
            let files = (owners[duplicate.row as usize], duplicate.file);
            let is_apart = apart
                .entry(files)
                .or_insert_with(|| files.0 != files.1 && !self.share_a_channel(files.0, files.1));
            merged += u64::from(*is_apart);
        }
        merged
    }

    fn share_a_channel(&self, one: u32, other: u32) -> bool {
        self.channels.iter().any(|channel| {
            channel.positions.contains_key(&(one as usize))
                && channel.positions.contains_key(&(other as usize))
        })
    }

    /// Returns the cause of contradicting rows of wide files, if a column or their files show it.
    pub(crate) fn cause_of_contradictions(
        &self,
        monitor: &dyn Monitor,
    ) -> Result<Option<ContradictionCause>, DataError> {
        let Origin::Tables(files) = &self.origin else { return Ok(None) };
        let rows = self.recorded();
        if rows.duplicates.is_empty() {
            return Ok(None);
        }
        if let Some(date) = self.clock_set_back() {
            return Ok(Some(ContradictionCause::ClockSetBack { date }));
        }
        for channel in (0..self.channels.len()).filter(|&at| may_name_plants(&self.channels[at])) {
            if let Some(values) = self.plants(channel, files, monitor)? {
                let column = self.channels[channel].name.clone();
                return Ok(Some(ContradictionCause::Column { column, values }));
            }
        }
        let owners = owners(rows);
        let is_other =
            |duplicate: &&super::rows::Duplicate| owners[duplicate.row as usize] != duplicate.file;
        let others = rows.duplicates.iter().filter(is_other).count();
        let names = prefixes(&files.iter().map(LogFile::path).collect::<Vec<_>>());
        let mut prefixes: Vec<String> = names.iter().map(|name| name.trim().to_owned()).collect();
        prefixes.sort();
        prefixes.dedup();
        let explains = others as f64 >= EXPLAINED * rows.duplicates.len() as f64;
        let is_named = prefixes.len() > 1 && prefixes.iter().all(|name| !name.is_empty());
        if explains && is_named {
            return Ok(Some(ContradictionCause::Files { prefixes }));
        }
        let mut counts = vec![1; rows.timestamps.len()];
        for duplicate in rows.duplicates.iter().filter(|duplicate| !is_other(duplicate)) {
            counts[duplicate.row as usize] += 1;
        }
        let times: Vec<i64> = rows.timestamps.iter().map(|time| time.as_micros()).collect();
        let shared = SharedTimes::of(&times, counts);
        Ok(shared.map(|SharedTimes { rows, step }| ContradictionCause::SharedTimes {
            rows,
            step_secs: step as f64 / 1e6,
        }))
    }

    /// Returns the first day on which clocks in Europe were set back, if nearly all rows with equal times are in such
    /// an hour and the log has no zone.
    fn clock_set_back(&self) -> Option<String> {
        let rows = self.recorded();
        let mut days = rows
            .duplicates
            .iter()
            .filter_map(|duplicate| comes_twice(rows.timestamps[duplicate.row as usize]))
            .peekable();
        let first = days.peek().filter(|_| !self.utc)?.clone();
        (days.count() as f64 >= EXPLAINED * rows.duplicates.len() as f64).then_some(first)
    }

    /// Returns the values of a channel, if they distinguish the rows at the same time.
    fn plants(
        &self,
        channel: usize,
        files: &[LogFile],
        monitor: &dyn Monitor,
    ) -> Result<Option<Vec<String>>, DataError> {
        let mut labels = Labels::default();
        let [codes, others] = self.codes_of_files(files, channel, &mut labels, monitor)?;
        let mut values = labels.list();
        if !(2..=PLANTS).contains(&values.len()) {
            return Ok(None);
        }
        let duplicates = &self.recorded().duplicates;
        let different = duplicates.iter().zip(&others).filter(|(duplicate, code)| {
            let kept = codes[duplicate.row as usize];
            !kept.is_nan() && !code.is_nan() && kept.to_bits() != code.to_bits()
        });
        values.sort();
        Ok((different.count() as f64 >= EXPLAINED * duplicates.len() as f64).then_some(values))
    }
}

/// Whether a channel may identify plants: by words, or by numbers under such a name.
fn may_name_plants(channel: &Channel) -> bool {
    channel.readable
        && channel.angle.is_none()
        && (channel.type_name.contains("text") || names_plants(&channel.name))
}

pub(super) fn names_plants(column: &str) -> bool {
    let name = plain(column);
    TAGS.contains(&name.as_str())
        || PLANT_NAMES.iter().any(|known| name.starts_with(known) || name.ends_with(known))
        || ["no", "nr", "number"].iter().any(|end| name.ends_with(end))
}
