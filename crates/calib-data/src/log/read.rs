//! The values of some channels over all rows of the log.

use std::collections::HashMap;

use calib_core::Monitor;
use rayon::prelude::*;

use super::{
    Log,
    rows::{LEFT_OUT, RowMap},
    values::{NotNumbers, to_labels, to_numbers},
};
use crate::DataError;

/// What a batch of channels may hold in memory, in bytes.
const BATCH_BYTES: usize = 256 << 20;
/// Channels in a batch at least and at most.
const BATCH_CHANNELS: (usize, usize) = (2, 64);

/// Channels that are read together; its memory is used again for the next batch.
#[derive(Default)]
pub(crate) struct Batch(Vec<ChannelValues>);

/// The values of one channel in time order.
#[derive(Default)]
pub(crate) struct ChannelValues {
    /// One per row of the log, NaN where missing.
    pub(crate) values: Vec<f64>,
    /// One per duplicate of the log.
    pub(crate) duplicates: Vec<f64>,
    pub(crate) not_numbers: NotNumbers,
}

impl Log {
    /// How many channels are read together, so that memory stays bounded.
    pub(crate) fn batch_size(&self) -> usize {
        let (least, most) = BATCH_CHANNELS;
        let bytes = self.rows.timestamps.len().max(1) * size_of::<f64>();
        (BATCH_BYTES / bytes).clamp(least, most)
    }

    /// Read `channels` into `batch`: file by file, slice by slice, channels in parallel.
    pub(crate) fn read<'a>(
        &self,
        channels: &[usize],
        batch: &'a mut Batch,
        monitor: &dyn Monitor,
    ) -> Result<&'a mut [ChannelValues], DataError> {
        batch.0.resize_with(batch.0.len().max(channels.len()), ChannelValues::default);
        let batch = &mut batch.0[..channels.len()];
        batch.par_iter_mut().for_each(|channel| {
            channel.values.clear();
            channel.values.resize(self.rows.timestamps.len(), f64::NAN);
            channel.duplicates.clear();
            channel.duplicates.resize(self.rows.duplicates.len(), f64::NAN);
            channel.not_numbers = NotNumbers::default();
        });
        for file in 0..self.files.len() {
            self.read_file(file, channels, batch, monitor)?;
        }
        monitor.advance(channels.len() as u64);
        Ok(batch)
    }

    fn read_file(
        &self,
        file: usize,
        channels: &[usize],
        batch: &mut [ChannelValues],
        monitor: &dyn Monitor,
    ) -> Result<(), DataError> {
        let present: Vec<(usize, usize)> = channels
            .iter()
            .enumerate()
            .filter_map(|(slot, &channel)| {
                let position = self.channels[channel].positions.get(&file)?;
                Some((slot, *position))
            })
            .collect();
        let map = &self.rows.maps[file];
        if present.is_empty() {
            return Ok(());
        }
        let log_file = &self.files[file];
        let fields: Vec<usize> = present.iter().map(|&(_, field)| field).collect();
        for slice in log_file.slices(&map.needed()) {
            if monitor.interrupted() {
                return Err(DataError::Interrupted);
            }
            let columns = log_file.read(&fields, &slice)?;
            let mut slots: Vec<Option<_>> = vec![None; batch.len()];
            for (&(slot, _), column) in present.iter().zip(columns) {
                slots[slot] = Some(column);
            }
            batch
                .par_iter_mut()
                .zip(slots)
                .try_for_each(|(channel, column)| {
                    let Some(column) = column else { return Ok(()) };
                    let ChannelValues { values, duplicates, not_numbers } = channel;
                    match map {
                        RowMap::Contiguous { file, first } => {
                            let start = first + slice.start - file.start;
                            let out = &mut values[start..start + slice.len()];
                            to_numbers(&column, out, not_numbers)
                        }
                        RowMap::Scattered(rows) => {
                            let mut read = vec![f64::NAN; slice.len()];
                            to_numbers(&column, &mut read, not_numbers)?;
                            for (&value, &row) in read.iter().zip(&rows[slice.clone()]) {
                                if row != LEFT_OUT {
                                    values[row as usize] = value;
                                }
                            }
                            self.place_duplicates(file, slice.start, &read, duplicates);
                            Ok(())
                        }
                    }
                })
                .map_err(|error| log_file.damaged(&error))?;
        }
        Ok(())
    }

    fn place_duplicates(&self, file: usize, start: usize, read: &[f64], duplicates: &mut [f64]) {
        let all = &self.rows.duplicates;
        let before = |row: usize| {
            all.partition_point(|duplicate| {
                (duplicate.file as usize, duplicate.file_row as usize) < (file, row)
            })
        };
        for position in before(start)..before(start + read.len()) {
            duplicates[position] = read[all[position].file_row as usize - start];
        }
    }
}

/// The values of a channel as labels.
pub(crate) struct Codes {
    /// One per row of the log: a position in `labels`, NaN where missing.
    pub(crate) codes: Vec<f64>,
    pub(crate) labels: Vec<String>,
}

impl Log {
    /// Read one channel of numbers or text, whose values are names of something.
    pub(crate) fn read_codes(
        &self,
        channel: usize,
        monitor: &dyn Monitor,
    ) -> Result<Codes, DataError> {
        let mut codes = vec![f64::NAN; self.rows.timestamps.len()];
        let mut known: HashMap<String, usize> = HashMap::new();
        for (file, log_file) in self.files.iter().enumerate() {
            let Some(&field) = self.channels[channel].positions.get(&file) else {
                continue;
            };
            let map = &self.rows.maps[file];
            for slice in log_file.slices(&map.needed()) {
                if monitor.interrupted() {
                    return Err(DataError::Interrupted);
                }
                let column = log_file.read(&[field], &slice)?.swap_remove(0);
                let labels = to_labels(&column).map_err(|error| log_file.damaged(&error))?;
                for (label, file_row) in labels.into_iter().zip(slice) {
                    let (Some(label), Some(row)) = (label, map.row(file_row)) else {
                        continue;
                    };
                    let code = known.len();
                    codes[row] = *known.entry(label).or_insert(code) as f64;
                }
            }
        }
        let mut labels = vec![String::new(); known.len()];
        for (label, code) in known {
            labels[code] = label;
        }
        Ok(Codes { codes, labels })
    }
}
