//! Rows of the log in time order, each instant once, and their positions in the files.

use std::ops::Range;

use calib_core::Timestamp;
use rayon::prelude::*;

use super::clock_resets::Passes;

pub(crate) use calib_text::NO_TIME;

/// Number of examples that are kept per irregularity.
pub(crate) const EXAMPLES: usize = 10;

/// Rows in time order.
#[derive(Debug, Default)]
pub(crate) struct Rows {
    pub(crate) timestamps: Vec<Timestamp>,
    /// Targets of the rows of each file.
    pub(crate) maps: Vec<RowMap>,
    /// Duplicates in order of the files' first times, and of their rows: the last of several is at the
    /// end.
    pub(crate) duplicates: Vec<Duplicate>,
    /// The range of each file in `duplicates`.
    pub(crate) repeats: Vec<Range<usize>>,
    /// Rows that were not recorded directly after the row before them, in order. A clock that went
    /// back recorded the same time span twice, and the two passes alternate here.
    pub(crate) breaks: Vec<u32>,
    pub(crate) irregularities: Irregularities,
}

/// The targets of the rows of a file.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum RowMap {
    /// Row `file.start + i` of the file is row `first + i` of the log; other rows are excluded.
    Contiguous { file: Range<usize>, first: usize },
    /// Row `i` of the file is this row of the log, or [`LEFT_OUT`].
    Scattered(Vec<u32>),
}

/// Marks a row of a file that is not a row of the log.
pub(crate) const LEFT_OUT: u32 = u32::MAX;

impl RowMap {
    /// Returns the rows of the file that must be read.
    pub(crate) fn needed(&self) -> Range<usize> {
        match self {
            Self::Contiguous { file, .. } => file.clone(),
            Self::Scattered(rows) => 0..rows.len(),
        }
    }

    /// Returns the row of the log for row `file_row` of the file.
    pub(crate) fn row(&self, file_row: usize) -> Option<usize> {
        match self {
            Self::Contiguous { file, first } => {
                file.contains(&file_row).then(|| first + file_row - file.start)
            }
            Self::Scattered(rows) => {
                rows.get(file_row).filter(|&&row| row != LEFT_OUT).map(|&row| row as usize)
            }
        }
    }
}

/// A row with the timestamp of an earlier row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Duplicate {
    pub(crate) file: u32,
    pub(crate) file_row: u32,
    /// The row of the log that has this time.
    pub(crate) row: u32,
}

/// Irregularities of the timestamps.
#[derive(Debug, Default, PartialEq, Eq)]
pub(crate) struct Irregularities {
    pub(crate) null_timestamps: u64,
    pub(crate) backward_steps: u64,
    /// File, time before the step, time after it.
    pub(crate) first_backward_steps: Vec<(usize, Timestamp, Timestamp)>,
    /// Pairs of a file and an earlier one that had not ended when the first began.
    pub(crate) overlaps: Vec<(usize, usize)>,
    /// Number of rows outside the window.
    pub(crate) outside: u64,
}

impl Rows {
    /// Creates rows that do not come from rows of a file.
    pub(crate) fn of(timestamps: Vec<Timestamp>, irregularities: Irregularities) -> Self {
        Self { timestamps, irregularities, ..Self::default() }
    }

    /// Sorts the rows of all files by time. If times are equal, it keeps the row of the file that
    /// starts first, and within a file the first row. Rows outside `window` are excluded.
    pub(crate) fn plan(files: &[Vec<i64>], window: &Range<i64>) -> Self {
        let mut irregularities = Irregularities::default();
        for (file, times) in files.iter().enumerate() {
            note_steps(file, times, &mut irregularities);
        }
        let order = file_order(files);
        note_overlaps(files, &order, &mut irregularities);
        let mut rows = Self {
            maps: files.iter().map(|_| RowMap::Contiguous { file: 0..0, first: 0 }).collect(),
            repeats: vec![0..0; files.len()],
            irregularities,
            ..Self::default()
        };
        if increasing(files, &order) {
            rows.append(files, &order, window);
        } else {
            rows.merge(files, &order, window);
        }
        rows
    }

    /// Appends files that follow each other and whose times increase.
    fn append(&mut self, files: &[Vec<i64>], order: &[usize], window: &Range<i64>) {
        for &file in order {
            let times = &files[file];
            let start = times.partition_point(|&time| time < window.start);
            let end = times.partition_point(|&time| time < window.end).max(start);
            self.maps[file] = RowMap::Contiguous { file: start..end, first: self.timestamps.len() };
            self.irregularities.outside += (times.len() - (end - start)) as u64;
            let inside = times[start..end].iter().copied();
            self.timestamps.extend(inside.map(Timestamp::from_micros));
        }
    }

    fn merge(&mut self, files: &[Vec<i64>], order: &[usize], window: &Range<i64>) {
        let mut all: Vec<(i64, u32, u32)> = Vec::new();
        for (position, &file) in order.iter().enumerate() {
            let left_out = vec![LEFT_OUT; files[file].len()];
            self.maps[file] = RowMap::Scattered(left_out);
            for (row, &time) in files[file].iter().enumerate() {
                if window.contains(&time) {
                    all.push((time, position as u32, row as u32));
                } else if time != NO_TIME {
                    self.irregularities.outside += 1;
                }
            }
        }
        all.par_sort_unstable();
        let mut passes = Passes::new(files);
        for (time, position, file_row) in all {
            let file = order[position as usize];
            passes.note(
                file,
                file_row as usize,
                self.timestamps.last() == Some(&Timestamp::from_micros(time)),
            );
            let time = Timestamp::from_micros(time);
            if self.timestamps.last() == Some(&time) {
                self.duplicates.push(Duplicate {
                    file: file as u32,
                    file_row,
                    row: (self.timestamps.len() - 1) as u32,
                });
                continue;
            }
            if let RowMap::Scattered(map) = &mut self.maps[file] {
                map[file_row as usize] = self.timestamps.len() as u32;
            }
            self.timestamps.push(time);
        }
        self.breaks = passes.breaks();
        let mut place = vec![0; files.len()];
        for (position, &file) in order.iter().enumerate() {
            place[file] = position;
        }
        self.duplicates
            .sort_unstable_by_key(|duplicate| (place[duplicate.file as usize], duplicate.file_row));
        let mut start = 0;
        for repeats in self.duplicates.chunk_by(|one, next| one.file == next.file) {
            self.repeats[repeats[0].file as usize] = start..start + repeats.len();
            start += repeats.len();
        }
        // Contiguous rows are copied as one piece; duplicates need a lookup row by row.
        for (map, repeats) in self.maps.iter_mut().zip(&self.repeats) {
            if let RowMap::Scattered(rows) = map
                && repeats.is_empty()
                && let Some(piece) = one_piece(rows)
            {
                *map = piece;
            }
        }
    }
}

fn one_piece(rows: &[u32]) -> Option<RowMap> {
    let start = rows.iter().position(|&row| row != LEFT_OUT)?;
    let end = rows.iter().rposition(|&row| row != LEFT_OUT)? + 1;
    let first = rows[start];
    rows[start..end]
        .iter()
        .zip(first..)
        .all(|(&row, expected)| row == expected)
        .then_some(RowMap::Contiguous { file: start..end, first: first as usize })
}

fn note_steps(file: usize, times: &[i64], irregularities: &mut Irregularities) {
    let mut before = None;
    for &time in times {
        if time == NO_TIME {
            irregularities.null_timestamps += 1;
            continue;
        }
        if let Some(before) = before
            && time < before
        {
            irregularities.backward_steps += 1;
            if irregularities.first_backward_steps.len() < EXAMPLES {
                let at = Timestamp::from_micros;
                let step = (file, at(before), at(time));
                irregularities.first_backward_steps.push(step);
            }
        }
        before = Some(time);
    }
}

fn note_overlaps(files: &[Vec<i64>], order: &[usize], irregularities: &mut Irregularities) {
    let mut latest: Option<(i64, usize)> = None;
    for &file in order {
        let times = files[file].iter().copied().filter(|&time| time != NO_TIME);
        let (Some(first), Some(last)) = (times.clone().min(), times.max()) else {
            continue;
        };
        if let Some((end, earlier)) = latest
            && first <= end
        {
            irregularities.overlaps.push((earlier, file));
        }
        if latest.is_none_or(|(end, _)| last > end) {
            latest = Some((last, file));
        }
    }
}

/// Returns the files in order of their first timestamp, then of their position in the list.
fn file_order(files: &[Vec<i64>]) -> Vec<usize> {
    let mut order: Vec<usize> =
        (0..files.len()).filter(|&file| first_time(&files[file]).is_some()).collect();
    order.sort_by_key(|&file| first_time(&files[file]));
    order
}

fn first_time(times: &[i64]) -> Option<i64> {
    times.iter().copied().find(|&time| time != NO_TIME)
}

fn increasing(files: &[Vec<i64>], order: &[usize]) -> bool {
    let mut before = NO_TIME;
    order.iter().flat_map(|&file| &files[file]).all(|&time| {
        let increases = time > before;
        before = time;
        increases
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const ALL: Range<i64> = i64::MIN + 1..i64::MAX;

    fn micros(rows: &Rows) -> Vec<i64> {
        rows.timestamps.iter().map(|time| time.as_micros()).collect()
    }

    #[test]
    fn files_that_follow_each_other_are_contiguous() {
        let rows = Rows::plan(&[vec![4, 5, 6], vec![1, 2, 3], vec![]], &ALL);
        assert_eq!(micros(&rows), [1, 2, 3, 4, 5, 6]);
        assert_eq!(rows.maps[0], RowMap::Contiguous { file: 0..3, first: 3 });
        assert_eq!(rows.maps[1], RowMap::Contiguous { file: 0..3, first: 0 });
        assert_eq!(rows.maps[2].needed(), 0..0);
        assert_eq!(rows.irregularities, Irregularities::default());
    }

    fn repeat(file_row: u32, row: u32) -> Duplicate {
        Duplicate { file: 0, file_row, row }
    }

    #[test]
    fn a_step_back_is_sorted_and_repeats_are_dropped() {
        // The clock goes back after 3: 2 and 3 are logged twice.
        let rows = Rows::plan(&[vec![1, 2, 3, 2, 3, 4]], &ALL);
        assert_eq!(micros(&rows), [1, 2, 3, 4]);
        let irregular = &rows.irregularities;
        assert_eq!(irregular.backward_steps, 1);
        let at = Timestamp::from_micros;
        assert_eq!(irregular.first_backward_steps, [(0, at(3), at(2))]);
        assert_eq!(rows.maps[0], RowMap::Scattered(vec![0, 1, 2, LEFT_OUT, LEFT_OUT, 3]));
        assert_eq!(rows.duplicates, [repeat(3, 1), repeat(4, 2)]);
        assert_eq!(rows.breaks, [3], "4 was recorded after the second 3, not after the first");
    }

    #[test]
    fn two_passes_over_the_same_time_do_not_follow_each_other() {
        // The second pass repeats 20 and falls into the gaps of the first.
        let rows = Rows::plan(&[vec![10, 20, 40, 60, 20, 30, 50, 70]], &ALL);
        assert_eq!(micros(&rows), [10, 20, 30, 40, 50, 60, 70]);
        assert_eq!(rows.breaks, [2, 3, 4, 5, 6]);
        // Parts of a file in the wrong order, or swapped rows, repeat nothing.
        assert!(Rows::plan(&[vec![4, 5, 6, 1, 2, 3]], &ALL).breaks.is_empty());
        assert!(Rows::plan(&[vec![1, 3, 2, 4]], &ALL).breaks.is_empty());
        assert!(Rows::plan(&[vec![1, 2, 3], vec![2, 3, 4]], &ALL).breaks.is_empty());
    }

    #[test]
    fn overlapping_files_are_merged_and_named() {
        let rows = Rows::plan(&[vec![2, 4, 6], vec![1, 3, 5], vec![7, 8]], &ALL);
        assert_eq!(micros(&rows), [1, 2, 3, 4, 5, 6, 7, 8]);
        assert_eq!(rows.irregularities.overlaps, [(1, 0)]);
        assert_eq!(rows.maps[2], RowMap::Contiguous { file: 0..2, first: 6 });
    }

    proptest! {
        #[test]
        fn every_instant_comes_once_and_every_row_is_accounted_for(
            files in prop::collection::vec(prop::collection::vec(prop_oneof![4 => -20_i64..20, 1 => Just(NO_TIME)], 0..12), 0..5),
            start in -25_i64..25,
            length in 0_i64..50,
        ) {
            let window = start..start + length;
            let rows = Rows::plan(&files, &window);
            let mut expected: Vec<i64> = files.iter().flatten().copied().filter(|time| window.contains(time)).collect();
            expected.sort_unstable();
            expected.dedup();
            prop_assert_eq!(micros(&rows), expected);
            let total: usize = files.iter().map(Vec::len).sum();
            let accounted = rows.timestamps.len() + rows.duplicates.len();
            let left_out = rows.irregularities.null_timestamps + rows.irregularities.outside;
            prop_assert_eq!(total, accounted + left_out as usize);
            let mut filled = vec![0; rows.timestamps.len()];
            for (times, map) in files.iter().zip(&rows.maps) {
                for file_row in map.needed() {
                    if let Some(row) = map.row(file_row) {
                        filled[row] += 1;
                        prop_assert_eq!(rows.timestamps[row].as_micros(), times[file_row]);
                    }
                }
            }
            prop_assert!(filled.iter().all(|&count| count == 1));
        }
    }
}
