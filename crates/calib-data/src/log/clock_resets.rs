//! Finds clocks that go back and record the same time span twice.

use std::collections::BTreeSet;

use super::rows::NO_TIME;

/// The passes of a file: maximal runs of its rows in time order. A clock that goes back begins a new pass.
pub(super) struct Passes {
    /// The pass of each row, per file.
    of_row: Vec<Vec<u32>>,
    /// File and pass of each row of the log.
    kept: Vec<(usize, u32)>,
    /// Pairs of passes of a file that recorded the same instant, the earlier one first.
    repeated: BTreeSet<(usize, u32, u32)>,
}

impl Passes {
    pub(super) fn new(files: &[Vec<i64>]) -> Self {
        Self {
            of_row: files.iter().map(|times| passes(times)).collect(),
            kept: Vec::new(),
            repeated: BTreeSet::new(),
        }
    }

    /// Adds the next row in time order; a repeat has the time of the row that was kept last.
    pub(super) fn note(&mut self, file: usize, file_row: usize, is_repeat: bool) {
        let pass = self.of_row[file][file_row];
        match self.kept.last() {
            Some(&(kept_file, kept)) if is_repeat => {
                if kept_file == file && kept != pass {
                    self.repeated.insert((file, kept.min(pass), kept.max(pass)));
                }
            }
            _ => self.kept.push((file, pass)),
        }
    }

    /// Returns the rows of the log that follow a row of another pass over the same instants.
    pub(super) fn breaks(&self) -> Vec<u32> {
        let rows = self.kept.windows(2).enumerate().filter(|(_, pair)| self.is_break(pair));
        rows.map(|(row, _)| row as u32 + 1).collect()
    }

    fn is_break(&self, pair: &[(usize, u32)]) -> bool {
        let [(before, earlier), (file, later)] = *pair else { return false };
        let passes = (file, earlier.min(later), earlier.max(later));
        before == file && self.repeated.contains(&passes)
    }
}

/// Returns the pass of each row of a file.
fn passes(times: &[i64]) -> Vec<u32> {
    let mut pass = 0;
    let mut before = NO_TIME;
    times
        .iter()
        .map(|&time| {
            if time != NO_TIME {
                pass += u32::from(time < before);
                before = time;
            }
            pass
        })
        .collect()
}
