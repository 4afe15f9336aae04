//! The address ranges of mapped files, for a signal handler that runs when pages of a file are lost.

use std::sync::atomic::{AtomicUsize, Ordering};

/// Maximum number of known files at a time. A model has a few per ensemble member.
const MOST: usize = 4096;

/// Addresses of one file; unused where both are 0.
struct Range {
    start: AtomicUsize,
    end: AtomicUsize,
}

static RANGES: [Range; MOST] =
    [const { Range { start: AtomicUsize::new(0), end: AtomicUsize::new(0) } }; MOST];

/// Whether `address` is in a file that calib maps. Signal handlers may call it: it neither locks nor allocates.
pub fn is_mapped(address: usize) -> bool {
    RANGES.iter().any(|range| {
        let start = range.start.load(Ordering::Acquire);
        let end = range.end.load(Ordering::Acquire);
        (start..end).contains(&address)
    })
}

/// The registration of a mapped file, which ends when it is dropped. `None` if too many files are registered.
#[derive(Debug)]
pub(crate) struct Known(Option<usize>);

impl Known {
    /// Registers the file that is mapped to these bytes.
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
