use std::{fs, path::Path};

use serde::{Deserialize, Serialize};

use crate::FileError;

/// The metadata of a file, which identify its content without reading it. As long as they are equal, the content is the
/// same: every write changes at least `changed_ns`, which programs cannot set. The exception is two writes within one
/// tick of the file system's clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct FileStat {
    /// Size, bytes.
    pub bytes: u64,
    /// Time of the last change of its content, in nanoseconds since 1970.
    pub modified_ns: i64,
    /// Time of the last change of content, name or permissions, in nanoseconds since 1970.
    pub changed_ns: i64,
    /// Inode number on its file system.
    pub inode: u64,
}

impl FileStat {
    /// Reads the metadata of a file. `None` where the system does not report the time of a change, or reports a year
    /// beyond 2262.
    ///
    /// # Errors
    /// If there is no such file.
    pub fn of(path: &Path) -> Result<Option<Self>, FileError> {
        let found = fs::metadata(path).map_err(|source| FileError::io("read", path, source))?;
        Ok(known(&found))
    }

    /// Returns the shortest time between two writes with certainly different stamps, in nanoseconds. Some file systems
    /// count seconds.
    pub fn tick_ns(&self) -> i64 {
        let counts_seconds =
            self.modified_ns % 1_000_000_000 == 0 && self.changed_ns % 1_000_000_000 == 0;
        if counts_seconds { 2_000_000_000 } else { 20_000_000 }
    }

    /// Returns the nanoseconds until every change, and every new file, has a stamp that is later by more than a tick.
    /// `now_ns` is since 1970. The result is 0 for a file that was not written just now.
    pub fn unsettled_ns(&self, now_ns: i64) -> u64 {
        // Two ticks, because stamps come from a clock that itself advances in ticks.
        let longest = 2 * self.tick_ns();
        let left = self.changed_ns.saturating_add(longest).saturating_sub(now_ns);
        // The clock of a remote file system may be ahead.
        left.clamp(0, longest).unsigned_abs()
    }
}

fn known(found: &fs::Metadata) -> Option<FileStat> {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt as _;
        Some(FileStat {
            bytes: found.len(),
            modified_ns: nanoseconds(found.mtime(), found.mtime_nsec())?,
            changed_ns: nanoseconds(found.ctime(), found.ctime_nsec())?,
            inode: found.ino(),
        })
    }
    #[cfg(not(unix))]
    None
}

/// Returns seconds and nanoseconds as nanoseconds, if they do not overflow.
#[cfg(unix)]
fn nanoseconds(secs: i64, ns: i64) -> Option<i64> {
    secs.checked_mul(1_000_000_000)?.checked_add(ns)
}

#[cfg(all(test, unix))]
mod tests {
    use std::{
        thread,
        time::{Duration, UNIX_EPOCH},
    };

    use super::*;

    #[test]
    fn a_write_of_as_many_bytes_changes_the_stamp_even_if_the_time_is_set_back() {
        let directory = tempfile::tempdir().expect("a directory");
        let path = directory.path().join("a");
        fs::write(&path, b"content").expect("written");
        let before = FileStat::of(&path).expect("there").expect("known");
        assert_eq!(FileStat::of(&path).expect("there"), Some(before));
        thread::sleep(Duration::from_nanos(before.unsettled_ns(before.changed_ns)));
        fs::write(&path, b"Content").expect("written");
        let time = fs::File::options().write(true).open(&path).expect("there");
        let earlier = UNIX_EPOCH + Duration::from_nanos(before.modified_ns as u64);
        time.set_modified(earlier).expect("ours");
        let after = FileStat::of(&path).expect("there").expect("known");
        assert_eq!((after.bytes, after.modified_ns), (before.bytes, before.modified_ns));
        assert!(after.changed_ns > before.changed_ns + before.tick_ns());
        assert!(FileStat::of(&directory.path().join("b")).is_err());
    }

    fn changed_at(changed_ns: i64) -> FileStat {
        FileStat { bytes: 1, modified_ns: changed_ns, changed_ns, inode: 1 }
    }

    #[test]
    fn what_was_written_long_ago_is_settled() {
        let stamp = changed_at(7_000_000_001);
        let tick = stamp.tick_ns();
        assert_eq!(stamp.unsettled_ns(stamp.changed_ns + 2 * tick), 0);
        assert_eq!(stamp.unsettled_ns(stamp.changed_ns + 2 * tick - 5), 5);
        assert_eq!(stamp.unsettled_ns(0), 2 * tick.unsigned_abs(), "a clock that is behind");
        assert_eq!(
            changed_at(7_000_000_000).unsettled_ns(7_000_000_000),
            4_000_000_000,
            "whole seconds"
        );
        assert_eq!(changed_at(i64::MAX).unsettled_ns(i64::MIN), 2 * tick.unsigned_abs());
    }
}
