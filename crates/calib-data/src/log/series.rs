//! A log in which every channel has its own times: long tables, and files of one tag each.
//!
//! Samples are sorted into their tags while they are streamed, and are stored outside of memory. Channels are
//! read one at a time and put on a common clock. Memory holds this clock and the channels of a batch.

use std::{
    collections::{BTreeMap, HashMap},
    ops::Range,
};

use calib_core::Timestamp;

use super::{
    dedup::{Deduplicated, deduplicate},
    rows::NO_TIME,
    side_labels::{SideLabels, mixed},
    store::Store,
    union::Union,
};
use crate::{AngleOf, Contradictions, DataError, text::Cell};

/// Maximum number of samples that wait in memory, for all tags together: 64 MB.
const WAITING: usize = 4 << 20;

/// Collects samples for a [`Series`].
pub(crate) struct Sink {
    pub(crate) store: Store,
    pub(super) tags: Vec<Tag>,
    positions: HashMap<String, usize>,
    waiting: usize,
    /// Labels beside each tag, in columns that may name devices.
    sides: BTreeMap<usize, BTreeMap<String, SideLabels>>,
    pub(crate) null_times: u64,
    /// Number of these whose time names no instant, or two that no other row can tell apart.
    pub(crate) undecided: u64,
    pub(crate) bad_quality: u64,
    pub(crate) rows: u64,
}

/// The samples of a tag.
#[derive(Debug)]
pub(crate) struct Tag {
    pub(crate) name: String,
    /// Position and number of samples of each piece: first the times, then the cells.
    pieces: Vec<(u64, usize)>,
    times: Vec<i64>,
    cells: Vec<u64>,
    pub(crate) has_numbers: bool,
    has_words: bool,
    pub(super) first: i64,
    pub(super) last: i64,
}

impl Sink {
    pub(crate) fn new(store: Store) -> Self {
        Self {
            store,
            tags: Vec::new(),
            positions: HashMap::new(),
            waiting: 0,
            sides: BTreeMap::new(),
            null_times: 0,
            undecided: 0,
            bad_quality: 0,
            rows: 0,
        }
    }

    /// Returns the position of the tag called `name`, and adds it if it is new.
    pub(crate) fn tag(&mut self, name: &str) -> Result<usize, DataError> {
        if let Some(&position) = self.positions.get(name) {
            return Ok(position);
        }
        let position = self.add_tag()?;
        name.clone_into(&mut self.tags[position].name);
        self.positions.insert(name.to_owned(), position);
        Ok(position)
    }

    /// Adds a tag that gets its name later, and returns its position.
    pub(crate) fn add_tag(&mut self) -> Result<usize, DataError> {
        self.store.memory.require_channels(self.tags.len())?;
        self.tags.push(Tag {
            name: String::new(),
            pieces: Vec::new(),
            times: Vec::new(),
            cells: Vec::new(),
            has_numbers: false,
            has_words: false,
            first: i64::MAX,
            last: i64::MIN,
        });
        Ok(self.tags.len() - 1)
    }

    /// Adds a sample of a tag. A sample without a value still shows that the tag was recorded.
    pub(crate) fn push(&mut self, tag: usize, time: i64, cell: u64) -> Result<(), DataError> {
        self.rows += 1;
        if time == NO_TIME {
            self.null_times += 1;
            return Ok(());
        }
        let tag = &mut self.tags[tag];
        match Cell::decode(cell) {
            Cell::Number(_) | Cell::NonFinite => tag.has_numbers = true,
            Cell::Word(_) => tag.has_words = true,
            Cell::Missing => {}
        }
        tag.first = tag.first.min(time);
        tag.last = tag.last.max(time);
        tag.times.push(time);
        tag.cells.push(cell);
        self.waiting += 1;
        if self.waiting >= WAITING { self.flush() } else { Ok(()) }
    }

    /// Adds labels beside some samples of a tag, from a column that may name devices.
    pub(super) fn add_side(&mut self, tag: usize, column: &str, labels: &SideLabels) {
        let sides = self.sides.entry(tag).or_default();
        sides.entry(column.to_owned()).or_default().merge(labels);
    }

    /// Returns warnings about tags that may be of several devices.
    pub(super) fn mixed_tags(&self) -> Vec<String> {
        mixed(self.sides.iter().map(|(tag, sides)| (self.tags[*tag].name.as_str(), sides)))
    }

    /// Moves all waiting samples out of memory.
    pub(super) fn flush(&mut self) -> Result<(), DataError> {
        for tag in self.tags.iter_mut().filter(|tag| !tag.times.is_empty()) {
            let at = self.store.spill.append(bytemuck::cast_slice(&tag.times))?;
            self.store.append(&tag.cells)?;
            tag.pieces.push((at, tag.times.len()));
            let samples = tag.pieces.iter().map(|(_, count)| *count as u64).sum();
            self.store.memory.require_samples(samples, &tag.name)?;
            tag.times.clear();
            tag.cells.clear();
        }
        self.waiting = 0;
        Ok(())
    }

    /// Renames the tags, in the order of their first appearance.
    pub(crate) fn rename(&mut self, names: Vec<String>) {
        for (tag, name) in self.tags.iter_mut().zip(names) {
            tag.name = name;
        }
    }

    /// Returns the series of all tags that have a sample, in order of their names.
    pub(crate) fn finish(mut self) -> Result<Series, DataError> {
        self.flush()?;
        let mut tags = self.tags;
        tags.retain(|tag| !tag.is_empty());
        tags.sort_by(|left, right| left.name.cmp(&right.name));
        Ok(Series { store: self.store, tags })
    }
}

/// Channels with their own times.
#[derive(Debug)]
pub(crate) struct Series {
    pub(crate) store: Store,
    pub(crate) tags: Vec<Tag>,
}

/// All samples of a tag in order of time; samples with equal times are in order of arrival.
#[derive(Debug)]
pub(super) struct Sorted {
    times: Vec<i64>,
    cells: Vec<u64>,
}

impl Sorted {
    /// Returns the times and the cells inside `window`.
    pub(super) fn inside(&self, window: &Range<i64>) -> (&[i64], &[u64]) {
        let from = self.times.partition_point(|&time| time < window.start);
        let to = self.times.partition_point(|&time| time < window.end).max(from);
        (&self.times[from..to], &self.cells[from..to])
    }
}

impl Tag {
    /// Whether the tag has no sample outside of memory.
    pub(super) fn is_empty(&self) -> bool {
        self.pieces.is_empty()
    }

    /// Reads the samples of the tag that lie outside of memory.
    pub(super) fn sorted(&self, store: &Store) -> Result<Sorted, DataError> {
        let count = self.pieces.iter().map(|(_, count)| count).sum();
        let mut times: Vec<i64> = Vec::with_capacity(count);
        let mut cells: Vec<u64> = Vec::with_capacity(count);
        for &(at, count) in &self.pieces {
            times.extend(bytemuck::cast_slice::<u64, i64>(&store.read(at, count)?));
            cells.extend(store.read(at + (count * size_of::<i64>()) as u64, count)?);
        }
        if !times.is_sorted() {
            let mut order: Vec<usize> = (0..times.len()).collect();
            order.sort_by_key(|&sample| times[sample]);
            times = order.iter().map(|&sample| times[sample]).collect();
            cells = order.into_iter().map(|sample| cells[sample]).collect();
        }
        Ok(Sorted { times, cells })
    }

    pub(crate) fn type_name(&self) -> &'static str {
        if self.has_words && !self.has_numbers { "text" } else { "numbers" }
    }
}

impl Series {
    /// Returns the number of samples of all tags.
    pub(crate) fn count(&self) -> u64 {
        self.tags.iter().flat_map(|tag| &tag.pieces).map(|(_, count)| *count as u64).sum()
    }

    /// Returns the first and the last time of all tags.
    pub(crate) fn span(&self) -> Option<(i64, i64)> {
        let first = self.tags.iter().map(|tag| tag.first).min()?;
        let last = self.tags.iter().map(|tag| tag.last).max()?;
        Some((first, last))
    }

    /// Returns the samples of a tag inside `window` in order of time; samples with equal times are in order of
    /// arrival.
    pub(crate) fn samples(
        &self,
        tag: usize,
        window: &Range<i64>,
    ) -> Result<(Vec<i64>, Vec<u64>), DataError> {
        let sorted = self.tags[tag].sorted(&self.store)?;
        let (times, cells) = sorted.inside(window);
        Ok((times.to_vec(), cells.to_vec()))
    }

    /// Returns every instant inside `window` at which any tag has a sample, once and in order.
    pub(crate) fn clock(&self, window: &Range<i64>) -> Result<Vec<Timestamp>, DataError> {
        let mut clock = Union::new(|next, last| next == last);
        for tag in 0..self.tags.len() {
            let (times, _) = self.samples(tag, window)?;
            clock.extend(times.into_iter());
        }
        Ok(clock.into_settled().into_iter().map(Timestamp::from_micros).collect())
    }

    /// Returns the samples of a tag, each instant once. `angle` is set if they are of an angle.
    pub(crate) fn deduplicated(
        &self,
        tag: usize,
        window: &Range<i64>,
        angle: Option<&AngleOf>,
        keep: Contradictions,
    ) -> Result<Deduplicated, DataError> {
        let (times, cells) = self.samples(tag, window)?;
        Ok(deduplicate(&times, &cells, angle, keep))
    }
}

#[cfg(test)]
mod tests {

    use super::*;
    use crate::DataConfig;

    fn number(value: f64) -> u64 {
        Cell::Number(value).encode()
    }

    #[test]
    fn samples_come_back_by_tag_and_time() {
        let store = Store::new(&DataConfig::default()).expect("memory");
        let mut sink = Sink::new(store);
        let [b, a] = ["b", "a"].map(|name| sink.tag(name).expect("memory"));
        assert_eq!(sink.tag("b").expect("memory"), b);
        for (tag, time, value) in [(b, 2, 1.0), (a, 5, 2.0), (b, 1, 3.0)] {
            sink.push(tag, time, number(value)).expect("memory");
        }
        sink.flush().expect("memory");
        sink.push(b, 9, number(4.0)).expect("memory");
        sink.push(a, NO_TIME, number(5.0)).expect("memory");
        assert_eq!((sink.null_times, sink.rows), (1, 5));
        let series = sink.finish().expect("memory");
        let names: Vec<&str> = series.tags.iter().map(|tag| tag.name.as_str()).collect();
        assert_eq!(names, ["a", "b"]);
        let (times, cells) = series.samples(1, &(0..10)).expect("memory");
        assert_eq!(times, [1, 2, 9]);
        assert_eq!(cells, [3.0, 1.0, 4.0].map(number));
        assert_eq!(series.samples(1, &(2..9)).expect("memory").0, [2]);
        assert_eq!(series.span(), Some((1, 9)));
        let clock = series.clock(&(0..10)).expect("memory");
        assert_eq!(clock, [1, 2, 5, 9].map(Timestamp::from_micros));
    }
}
