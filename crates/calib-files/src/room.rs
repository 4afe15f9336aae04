//! Free and used disk space.

use std::{fs, path::Path};

use crate::faults;

/// Size of a block, bytes. On most disks a file takes whole blocks of this size.
const BLOCK_BYTES: u64 = 4_096;

/// Returns the bytes that this user may still write to the file system of `path`, which need not exist yet. `None`
/// where the system does not report it: some network file systems report 0.
pub fn free_bytes(path: &Path) -> Option<u64> {
    let folder = path.ancestors().find(|folder| folder.exists()).unwrap_or(Path::new("."));
    faults::free().or_else(|| told_of(folder)).filter(|free| *free > 0)
}

#[cfg(unix)]
fn told_of(folder: &Path) -> Option<u64> {
    let told = rustix::fs::statvfs(folder).ok()?;
    told.f_bavail.checked_mul(told.f_frsize)
}

#[cfg(not(unix))]
fn told_of(_folder: &Path) -> Option<u64> {
    None
}

/// Returns the bytes that the files in `folder` and below it take, in whole blocks; 0 if the folder does not exist.
/// Links are not followed.
pub fn taken_bytes(folder: &Path) -> u64 {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let taken = entries.map(|entry| match entry.metadata() {
        Ok(found) if found.is_dir() => taken_bytes(&entry.path()),
        Ok(found) if found.is_file() => found.len().next_multiple_of(BLOCK_BYTES),
        _ => 0,
    });
    taken.sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(unix)]
    #[test]
    fn a_folder_that_is_not_there_yet_has_the_room_of_the_one_above() {
        let directory = tempfile::tempdir().expect("a directory");
        let free = free_bytes(&directory.path().join("new").join("newer")).expect("told");
        // Other processes may write meanwhile, but not to another disk.
        let above = free_bytes(directory.path()).expect("told");
        assert!(free > 0 && free.abs_diff(above) < above / 2 + 1, "{free} and {above}");
        assert!(free_bytes(Path::new("nowhere/at/all")).is_some(), "of the working directory");
    }

    #[test]
    fn files_take_whole_blocks() {
        let directory = tempfile::tempdir().expect("a directory");
        let below = directory.path().join("below");
        fs::create_dir(&below).expect("writable");
        fs::write(directory.path().join("a"), [0_u8; 4_097]).expect("writable");
        fs::write(below.join("b"), [0_u8; 10]).expect("writable");
        assert_eq!(taken_bytes(directory.path()), 3 * 4_096);
        assert_eq!(taken_bytes(&directory.path().join("none")), 0);
    }
}
