//! Reads the values of some channels over all rows of the log.

use std::{collections::HashMap, iter};

use calib_core::{Monitor, Timestamp};
use rayon::prelude::*;

use super::{
    dedup::{Contradicting, agree},
    file::LogFile,
    plant_log::{Log, Origin},
    resample::Grid,
    rows::{LEFT_OUT, RowMap, Rows},
    series::Series,
    sparse::SparseValues,
    values::{NotNumbers, RawColumn, cells_to_numbers, each_label, to_numbers, with_label},
};
use crate::{
    AngleOf, BridgedStops, Contradictions, DataError, format_time,
    sentinels::{Extremes, make_missing, stands_for_missing},
};

/// Maximum memory of a batch of channels, in bytes.
const BATCH_BYTES: usize = 256 << 20;
/// Minimum number of channels per batch, and the maximum unless there are very many channels.
const BATCH_CHANNELS: (usize, usize) = (2, 64);
/// Maximum number of batches, if memory allows: each one begins with a scan of all columns of the files.
const BATCHES: usize = 64;

/// Channels that are read together; the next batch reuses its memory.
#[derive(Default)]
pub(crate) struct Batch(Vec<ChannelValues>);

/// The values of one channel in time order.
#[derive(Default)]
pub(crate) struct ChannelValues {
    /// One value per row of the log, NaN for missing; empty if `sparse` holds the values.
    pub(crate) values: Vec<f64>,
    /// The values of a channel with few values, if the caller asked for this form.
    pub(crate) sparse: Option<SparseValues>,
    /// One value per duplicate of the recorded rows.
    duplicates: Vec<f64>,
    pub(crate) not_numbers: NotNumbers,
    /// Smallest and largest recorded values.
    pub(crate) extremes: Extremes,
    /// Number of values that are missing because of `data.missing_values`.
    pub(crate) stood_for_missing: u64,
    /// Number of samples that were merged with another one of the same tag and time.
    pub(crate) repeated: u64,
    /// Recording stops that the last value bridged.
    pub(crate) bridged: BridgedStops,
    pub(crate) contradictions: Contradicting,
    /// Duplicates of the recorded rows that contradict the kept row.
    pub(crate) conflicts: Vec<u32>,
}

impl ChannelValues {
    /// Removes all values and makes room for `rows` and `duplicates`.
    fn clear(&mut self, rows: usize, duplicates: usize) {
        let mut cleared = std::mem::take(self);
        cleared.values.clear();
        cleared.values.resize(rows, f64::NAN);
        cleared.duplicates.clear();
        cleared.duplicates.resize(duplicates, f64::NAN);
        self.values = cleared.values;
        self.duplicates = cleared.duplicates;
    }

    /// Merges rows of the same time: the first one with a value counts. `angle` is set if the values are of an angle.
    fn settle(&mut self, rows: &Rows, angle: Option<&AngleOf>, keep: Contradictions) {
        for (position, (duplicate, &value)) in
            rows.duplicates.iter().zip(&self.duplicates).enumerate()
        {
            let kept = &mut self.values[duplicate.row as usize];
            if value.is_nan() || agree(value, *kept, angle) {
                continue;
            }
            if kept.is_nan() {
                *kept = value;
                continue;
            }
            self.conflicts.push(position as u32);
            let time = rows.timestamps[duplicate.row as usize].as_micros();
            self.contradictions.add(time, [*kept, value]);
            if keep == Contradictions::Last {
                *kept = value;
            }
        }
    }
}

impl Log {
    /// Returns the number of channels that are read together, so that memory stays bounded.
    pub(crate) fn batch_size(&self) -> usize {
        let (least, most) = BATCH_CHANNELS;
        let most = most.max(self.channels.len().div_ceil(BATCHES));
        let rows = self.rows.timestamps.len().max(self.recorded().timestamps.len()).max(1);
        let copies = if self.recorded.is_some() { 3 } else { 1 };
        (BATCH_BYTES / (rows * size_of::<f64>() * copies)).clamp(least, most)
    }

    /// Reads `channels` into `batch`: file by file, slice by slice, channels in parallel.
    pub(crate) fn read<'a>(
        &self,
        channels: &[usize],
        batch: &'a mut Batch,
        monitor: &dyn Monitor,
    ) -> Result<&'a mut [ChannelValues], DataError> {
        let read = self.read_sparse(channels, batch, monitor)?;
        let rows = self.rows.timestamps.len();
        read.par_iter_mut().for_each(|channel| {
            if let Some(sparse) = channel.sparse.take() {
                channel.values = sparse.into_all(rows);
            }
        });
        Ok(read)
    }

    /// Does the same as [`Self::read`], but keeps the values of channels with few values in `sparse`.
    pub(crate) fn read_sparse<'a>(
        &self,
        channels: &[usize],
        batch: &'a mut Batch,
        monitor: &dyn Monitor,
    ) -> Result<&'a mut [ChannelValues], DataError> {
        batch.0.resize_with(batch.0.len().max(channels.len()), ChannelValues::default);
        let batch = &mut batch.0[..channels.len()];
        match &self.origin {
            Origin::Tables(files) => {
                let rows = self.recorded();
                let all = rows.timestamps.len();
                let duplicates = rows.duplicates.len();
                batch.par_iter_mut().for_each(|channel| channel.clear(all, duplicates));
                for (position, file) in files.iter().enumerate() {
                    self.read_file(file, position, channels, batch, monitor)?;
                }
                self.read_switches(files, channels, batch, monitor)?;
                batch.par_iter_mut().zip(channels).try_for_each(|(channel, &number)| {
                    let angle = self.channels[number].angle.as_ref();
                    channel.settle(rows, angle, self.contradictions);
                    channel.extremes = Extremes::of(&channel.values);
                    if let Some(angle) = angle {
                        take_part(angle, &mut channel.values, &channel.not_numbers)?;
                    }
                    if let Some(grid) = self.grid_of(number) {
                        let times = rows.timestamps.iter().map(|time| time.as_micros());
                        let (times, values) = present(times, &channel.values);
                        channel.bridged = grid.bridged(&times);
                        channel.values = grid.values(&times, &values, &self.rows.timestamps);
                    }
                    Ok::<(), DataError>(())
                })?;
            }
            Origin::Series(series, window) => {
                monitor.check()?;
                batch.par_iter_mut().zip(channels).try_for_each(|(values, &channel)| {
                    self.read_tag(series, channel, window, values)
                })?;
            }
        }
        monitor.advance(channels.len() as u64);
        Ok(batch)
    }

    /// Reads channels again that hold a pair of words such as ON and OFF and no numbers, as 1 and 0.
    fn read_switches(
        &self,
        files: &[LogFile],
        channels: &[usize],
        batch: &mut [ChannelValues],
        monitor: &dyn Monitor,
    ) -> Result<(), DataError> {
        let rows = self.recorded();
        let (mut places, mut numbers) = (Vec::new(), Vec::new());
        let mut switches: Vec<ChannelValues> = Vec::new();
        for (place, (channel, &number)) in batch.iter_mut().zip(channels).enumerate() {
            let Some(switch) = channel.not_numbers.pair(iter::empty()) else { continue };
            let mut values = channel.values.iter().chain(&channel.duplicates);
            if channel.stood_for_missing > 0
                || self.channels[number].angle.is_some()
                || values.any(|value| !value.is_nan())
            {
                continue;
            }
            channel.clear(rows.timestamps.len(), rows.duplicates.len());
            channel.not_numbers = NotNumbers::with(switch);
            places.push(place);
            numbers.push(number);
            switches.push(std::mem::take(channel));
        }
        if switches.is_empty() {
            return Ok(());
        }
        for (position, file) in files.iter().enumerate() {
            self.read_file(file, position, &numbers, &mut switches, monitor)?;
        }
        for (place, channel) in places.into_iter().zip(switches) {
            batch[place] = channel;
        }
        Ok(())
    }

    /// Returns the clock of a channel, if the log has one.
    fn grid_of(&self, channel: usize) -> Option<Grid> {
        self.grid.as_ref().map(|grid| grid.with_max_age(self.max_ages[channel]))
    }

    fn read_tag(
        &self,
        series: &Series,
        number: usize,
        window: &std::ops::Range<i64>,
        channel: &mut ChannelValues,
    ) -> Result<(), DataError> {
        channel.clear(0, 0);
        let source = &self.channels[number];
        let angle = source.angle.as_ref();
        let placed = series.deduplicated(source.column, window, angle, self.contradictions)?;
        channel.repeated = placed.repeated + placed.contradictions.count + placed.words.count;
        channel.contradictions = placed.contradictions;
        let mut values = vec![f64::NAN; placed.cells.len()];
        let words = &series.store.words;
        cells_to_numbers(&placed.cells, words, &mut values, &mut channel.not_numbers);
        if angle.is_none()
            && values.iter().all(|value| value.is_nan())
            && let Some(switch) = channel.not_numbers.pair(placed.words.replaced(words))
        {
            channel.contradictions = placed.words.of_switch(&switch, words);
            channel.not_numbers = NotNumbers::with(switch);
            cells_to_numbers(&placed.cells, words, &mut values, &mut channel.not_numbers);
        }
        channel.stood_for_missing = make_missing(&mut values, &self.missing_values);
        channel.extremes = Extremes::of(&values);
        if let Some(angle) = angle {
            take_part(angle, &mut values, &channel.not_numbers)?;
        }
        if let Some(grid) = self.grid_of(number) {
            let (times, values) = present(placed.times, &values);
            channel.bridged = grid.bridged(&times);
            channel.values = grid.values(&times, &values, &self.rows.timestamps);
            return Ok(());
        }
        let rows = &self.rows.timestamps;
        channel.sparse = SparseValues::of(&placed.times, &values, rows);
        if channel.sparse.is_none() {
            channel.values.resize(rows.len(), f64::NAN);
            self.put(&placed.times, &values, &mut channel.values);
        }
        Ok(())
    }

    /// Puts samples, in order of time, on the rows of the log, which include all their times.
    fn put(&self, times: &[i64], values: &[f64], out: &mut [f64]) {
        let rows = &self.rows.timestamps;
        let mut row = 0;
        for (&time, &value) in times.iter().zip(values) {
            while rows[row].as_micros() < time {
                row += 1;
            }
            out[row] = value;
        }
    }

    fn read_file(
        &self,
        log_file: &LogFile,
        file: usize,
        channels: &[usize],
        batch: &mut [ChannelValues],
        monitor: &dyn Monitor,
    ) -> Result<(), DataError> {
        // Columns to read, each once: the two channels of an angle share a column.
        let mut fields: Vec<usize> = Vec::with_capacity(channels.len());
        let mut places: HashMap<usize, usize> = HashMap::with_capacity(channels.len());
        let slots: Vec<Option<usize>> = channels
            .iter()
            .map(|&channel| {
                let field = *self.channels[channel].positions.get(&file)?;
                Some(*places.entry(field).or_insert_with(|| {
                    fields.push(field);
                    fields.len() - 1
                }))
            })
            .collect();
        let map = &self.recorded().maps[file];
        if fields.is_empty() {
            return Ok(());
        }
        for slice in log_file.slices(&map.needed()) {
            monitor.check()?;
            let columns = log_file.read(&fields, &slice)?;
            batch
                .par_iter_mut()
                .zip(&slots)
                .try_for_each(|(channel, slot)| {
                    let Some(column) = slot.map(|place| &columns[place]) else { return Ok(()) };
                    let ChannelValues {
                        values, duplicates, not_numbers, stood_for_missing, ..
                    } = channel;
                    match map {
                        RowMap::Contiguous { file, first } => {
                            let start = first + slice.start - file.start;
                            let out = &mut values[start..start + slice.len()];
                            to_numbers(column, out, not_numbers)?;
                            *stood_for_missing += make_missing(out, &self.missing_values);
                            Ok(())
                        }
                        RowMap::Scattered(rows) => {
                            let mut read = vec![f64::NAN; slice.len()];
                            to_numbers(column, &mut read, not_numbers)?;
                            *stood_for_missing += make_missing(&mut read, &self.missing_values);
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
        let rows = self.recorded();
        let repeats = rows.repeats[file].clone();
        let all = &rows.duplicates[repeats.clone()];
        let before =
            |row: usize| all.partition_point(|repeated| (repeated.file_row as usize) < row);
        for position in before(start)..before(start + read.len()) {
            duplicates[repeats.start + position] = read[all[position].file_row as usize - start];
        }
    }
}

/// Returns the samples with a value.
fn present(times: impl IntoIterator<Item = i64>, values: &[f64]) -> (Vec<i64>, Vec<f64>) {
    let samples = times.into_iter().zip(values.iter().copied());
    samples.filter(|(_, value)| !value.is_nan()).unzip()
}

/// Replaces each angle by its sine or cosine.
///
/// # Errors
/// If there are words and no angles.
fn take_part(
    angle: &AngleOf,
    values: &mut [f64],
    not_numbers: &NotNumbers,
) -> Result<(), DataError> {
    if let Some(word) = not_numbers.example()
        && values.iter().all(|value| value.is_nan())
    {
        let reason = format!(
            "it holds text, such as {word:?}, and no numbers; write its angles as numbers, or leave the entry out"
        );
        return Err(DataError::angle(&angle.channel, reason));
    }
    angle.replace(values);
    Ok(())
}

/// The values of a channel as labels.
pub(crate) struct Codes {
    /// One code per row of the log: a position in `labels`, NaN for missing.
    pub(crate) codes: Vec<f64>,
    pub(crate) labels: Vec<String>,
}

/// Distinct labels.
#[derive(Default)]
pub(super) struct Labels {
    codes: HashMap<String, usize>,
    /// Each label as a number, if it is one.
    numbers: Vec<Option<f64>>,
    /// Numbers that do not count as a label.
    missing_values: Vec<f64>,
}

impl Labels {
    /// Returns the code of a label; NaN for a missing one.
    fn code(&mut self, label: Option<&str>) -> f64 {
        let Some(label) = label else { return f64::NAN };
        if let Some(&code) = self.codes.get(label) {
            return code as f64;
        }
        let number: Option<f64> = label.parse().ok();
        if number.is_some_and(|number| stands_for_missing(number, &self.missing_values)) {
            return f64::NAN;
        }
        let code = self.numbers.len();
        self.numbers.push(number);
        self.codes.insert(label.to_owned(), code);
        code as f64
    }

    fn number(&self, code: f64) -> Option<f64> {
        self.numbers[code as usize]
    }

    pub(super) fn list(&self) -> Vec<String> {
        let mut labels = vec![String::new(); self.codes.len()];
        for (label, &code) in &self.codes {
            labels[code].clone_from(label);
        }
        labels
    }
}

impl Log {
    /// Reads one channel of numbers or text as labels.
    ///
    /// # Errors
    /// If values at the same time contradict each other, and the study does not select one of them.
    pub(crate) fn read_codes(
        &self,
        channel: usize,
        monitor: &dyn Monitor,
    ) -> Result<Codes, DataError> {
        let missing_values = self.missing_values.clone();
        let mut labels = Labels { missing_values, ..Labels::default() };
        let (times, codes) = match &self.origin {
            Origin::Tables(files) => {
                let recorded = self.codes_of_files(files, channel, &mut labels, monitor)?;
                let codes = self.settle_codes(channel, recorded, &labels)?;
                if self.grid.is_none() {
                    return Ok(Codes { codes, labels: labels.list() });
                }
                let times = self.recorded().timestamps.iter().map(|time| time.as_micros());
                (times.collect(), codes)
            }
            Origin::Series(series, window) => {
                let tag = self.channels[channel].column;
                let placed = series.deduplicated(tag, window, None, self.contradictions)?;
                let words = &series.store.words;
                self.refuse(channel, &placed.words, |word| words.word(word as u32).to_owned())?;
                self.refuse(channel, &placed.contradictions, |number| number.to_string())?;
                self.refuse_lost(channel, placed.cells.iter().any(|&cell| words.is_other(cell)))?;
                let codes = placed
                    .cells
                    .iter()
                    .map(|&cell| with_label(cell, words, |label| labels.code(label)))
                    .collect::<Vec<f64>>();
                (placed.times, codes)
            }
        };
        let mut placed = vec![f64::NAN; self.rows.timestamps.len()];
        // Modes cannot be interpolated: the last one stays valid.
        let last = self.grid_of(channel).map(|grid| grid.of_last_values());
        match last {
            None => self.put(&times, &codes, &mut placed),
            Some(grid) => {
                let (times, codes) = present(times, &codes);
                placed = grid.values(&times, &codes, &self.rows.timestamps);
            }
        }
        Ok(Codes { codes: placed, labels: labels.list() })
    }

    /// Returns the codes of a channel: one per recorded row, and one per duplicate of these rows.
    pub(super) fn codes_of_files(
        &self,
        files: &[LogFile],
        channel: usize,
        labels: &mut Labels,
        monitor: &dyn Monitor,
    ) -> Result<[Vec<f64>; 2], DataError> {
        let rows = self.recorded();
        let mut codes = vec![f64::NAN; rows.timestamps.len()];
        let mut duplicates = vec![f64::NAN; rows.duplicates.len()];
        for (file, log_file) in files.iter().enumerate() {
            let Some(&field) = self.channels[channel].positions.get(&file) else {
                continue;
            };
            let map = &rows.maps[file];
            for slice in log_file.slices(&map.needed()) {
                monitor.check()?;
                let column = log_file.read(&[field], &slice)?.swap_remove(0);
                if let RawColumn::Cells(cells, store) = &column {
                    let is_lost = cells.iter().any(|&cell| store.words.is_other(cell));
                    self.refuse_lost(channel, is_lost)?;
                }
                let mut read = Vec::with_capacity(slice.len());
                each_label(&column, |label| read.push(labels.code(label)))
                    .map_err(|error| log_file.damaged(&error))?;
                for (&code, file_row) in read.iter().zip(slice.clone()) {
                    if let Some(row) = map.row(file_row) {
                        codes[row] = code;
                    }
                }
                self.place_duplicates(file, slice.start, &read, &mut duplicates);
            }
        }
        Ok([codes, duplicates])
    }

    /// Merges codes of the same time. A number is preferred to a word. Between two of the same kind, the first or the
    /// last is kept.
    fn settle_codes(
        &self,
        channel: usize,
        [mut codes, duplicates]: [Vec<f64>; 2],
        labels: &Labels,
    ) -> Result<Vec<f64>, DataError> {
        let rows = self.recorded();
        let mut found = Contradicting::default();
        for (duplicate, code) in rows.duplicates.iter().zip(duplicates) {
            let kept = &mut codes[duplicate.row as usize];
            if code.is_nan() || code == *kept {
                continue;
            }
            if kept.is_nan() {
                *kept = code;
                continue;
            }
            match [*kept, code].map(|label| labels.number(label)) {
                [Some(_), None] => {}
                [None, Some(_)] => *kept = code,
                // The same number in two notations.
                [Some(before), Some(now)] if before == now => {}
                _ => {
                    let time = rows.timestamps[duplicate.row as usize].as_micros();
                    found.add(time, [*kept, code]);
                    if self.contradictions == Contradictions::Last {
                        *kept = code;
                    }
                }
            }
        }
        let labels = labels.list();
        self.refuse(channel, &found, |code| labels[code as usize].clone())?;
        Ok(codes)
    }

    /// Rejects a channel with more words than are kept: the other words could not be distinguished.
    fn refuse_lost(&self, channel: usize, is_lost: bool) -> Result<(), DataError> {
        if is_lost {
            return Err(DataError::TooManyWords { name: self.channels[channel].name.clone() });
        }
        Ok(())
    }

    /// Rejects values that contradict each other, unless the study selects one of them. `label` formats a value.
    fn refuse(
        &self,
        channel: usize,
        found: &Contradicting,
        label: impl Fn(f64) -> String,
    ) -> Result<(), DataError> {
        if found.count == 0 || !self.contradictions.refuses() {
            return Ok(());
        }
        let name = &self.channels[channel].name;
        let examples = found
            .first
            .iter()
            .map(|contradiction| {
                let at = format_time(Timestamp::from_micros(contradiction.time));
                let [before, now] = contradiction.values.map(&label);
                format!("at {at} {name} is {before:?} and {now:?}")
            })
            .collect();
        Err(DataError::Contradictions { count: found.count, examples, cause: None })
    }
}
