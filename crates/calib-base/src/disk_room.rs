//! Free disk space. It is used to refuse work that would not fit, never for results.

use std::path::Path;

use calib_files::{free_bytes, taken_bytes};

use crate::{StepError, ensure, output::bytes};

/// Refuses work that would write more than the free disk space. `what` would write up to `needed` bytes into
/// `directory`, which need not exist yet; `remedy` names a way to need less. Where the system does not report free
/// space, work continues.
///
/// # Errors
/// If there is too little space.
pub fn require(needed: u64, what: &str, directory: &Path, remedy: &str) -> Result<(), StepError> {
    let Some(free) = free_bytes(directory) else { return Ok(()) };
    ensure!(
        fits(needed, free),
        "{what} may take {} on disk, and {} are free where {} lies; {remedy}",
        bytes(needed),
        bytes(free),
        directory.display()
    );
    Ok(())
}

/// Returns how many of `needed` bytes remain to be written into a folder, whose present files are kept or replaced.
pub fn left(needed: u64, directory: &Path) -> u64 {
    needed.saturating_sub(taken_bytes(directory))
}

/// Whether work that needs at most `needed` bytes may start with `free` bytes. Estimates are upper bounds, so `needed`
/// may be up to half as much again as `free`. That share is our choice.
fn fits(needed: u64, free: u64) -> bool {
    needed - needed / 3 <= free
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_clearly_too_much_is_refused() {
        for (needed, free, expected) in [
            (0, 1, true),
            (100, 100, true),
            (150, 100, true),
            (153, 100, false),
            (u64::MAX, u64::MAX, true),
            (u64::MAX, u64::MAX / 2, false),
        ] {
            assert_eq!(fits(needed, free), expected, "{needed} of {free}");
        }
    }

    #[test]
    fn a_refusal_says_what_where_and_what_to_do() {
        let directory = tempfile::tempdir().expect("a directory");
        let place = directory.path().join("new");
        require(1, "a byte", &place, "").expect("room for a byte");
        if free_bytes(&place).is_none() {
            return;
        }
        let told = require(u64::MAX, "the sweep", &place, "sweep less").expect_err("too much");
        let (told, shown) = (told.to_string(), place.display().to_string());
        assert!(
            told.starts_with("the sweep may take ") && told.ends_with("; sweep less"),
            "{told}"
        );
        assert!(told.contains(" are free where ") && told.contains(&shown), "{told}");
    }

    #[test]
    fn what_is_there_needs_no_room() {
        let directory = tempfile::tempdir().expect("a directory");
        std::fs::write(directory.path().join("a"), [0_u8; 5_000]).expect("writable");
        assert_eq!(left(10_000, directory.path()), 10_000 - 8_192);
        assert_eq!(left(5_000, directory.path()), 0);
    }
}
