//! Finds the cause of rows that contradict each other at the same time.

use std::collections::HashMap;

use calib_core::Monitor;

use super::{
    column_aliases::names_plants,
    contradiction_cause::ContradictionCause,
    dedup::Contradicting,
    file::LogFile,
    filename_tag::prefixes,
    plant_log::{Channel, Log, Origin},
    read::Labels,
    rows::Rows,
    shared_times::SharedTimes,
};
use crate::{ContradictionsFound, DataError, clock_changes::comes_twice};

/// Maximum number of plants in a log.
const PLANTS: usize = 200;
/// The share of the rows at the same time that a cause must explain.
const EXPLAINED: f64 = 0.9;

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
    /// Rejects contradictions in some channels, unless the study selects one of the values.
    pub(crate) fn refuse_contradictions(
        &self,
        found: &[(usize, Contradicting)],
        monitor: &dyn Monitor,
    ) -> Result<(), DataError> {
        let ContradictionsFound { count, examples, .. } = self.contradictions_of(found);
        if count == 0 || !self.contradictions.refuses() {
            return Ok(());
        }
        let cause = self.cause_of_contradictions(monitor)?;
        Err(DataError::Contradictions { count, examples, cause })
    }

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
