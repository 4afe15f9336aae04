//! Where files are mapped: for a handler of the signal that comes when pages of one are gone.

use std::sync::atomic::{AtomicUsize, Ordering};

/// Files that are known at a time; a model has a few for each member.
const MOST: usize = 4096;

/// Addresses of one file; nothing where both are 0.
struct Range {
    start: AtomicUsize,
    end: AtomicUsize,
}

static RANGES: [Range; MOST] =
    [const { Range { start: AtomicUsize::new(0), end: AtomicUsize::new(0) } }; MOST];

/// Whether a file that calib maps lies at `address`. A handler of signals may ask: nothing is locked or allocated.
pub fn is_mapped(address: usize) -> bool {
    RANGES.iter().any(|range| {
        let start = range.start.load(Ordering::Acquire);
        let end = range.end.load(Ordering::Acquire);
        (start..end).contains(&address)
    })
}

/// A mapped file that is known as long as this lives. Of more than can be known the others are not.
#[derive(Debug)]
pub(crate) struct Known(Option<usize>);

impl Known {
    /// The file that was mapped to these bytes.
    pub(crate) fn of(bytes: &[u8]) -> Self {
        let start = bytes.as_ptr() as usize;
        let end = bytes.as_ptr() as usize + bytes.len();
        let free = RANGES.iter().position(|range| {
            let taken = range.start.compare_exchange(0, start, Ordering::AcqRel, Ordering::Relaxed);
            taken.is_ok()
        });
        if let Some(place) = free {
            RANGES[place].end.store(end, Ordering::Release);
        }
        Self(free)
    }
}

impl Drop for Known {
    fn drop(&mut self) {
        if let Some(place) = self.0 {
            RANGES[place].end.store(0, Ordering::Release);
            RANGES[place].start.store(0, Ordering::Release);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_known_as_long_as_the_file_is_mapped() {
        let bytes = vec![0_u8; 4096];
        let address = bytes.as_ptr() as usize;
        assert!(!is_mapped(address) && !is_mapped(0));
        let known = Known::of(&bytes);
        assert!(is_mapped(address) && is_mapped(address + 4095) && !is_mapped(address + 4096));
        drop(known);
        assert!(!is_mapped(address));
        let many: Vec<Known> = (0..2 * MOST).map(|_| Known::of(&bytes)).collect();
        assert_eq!(many.iter().filter(|known| known.0.is_none()).count(), MOST);
    }
}
