use std::{
    fs,
    path::Path,
    thread,
    time::{Duration, SystemTime, UNIX_EPOCH},
};

use serde::{Deserialize, Serialize};

use crate::FileError;

/// What the file system says of a file without reading it. As long as nothing of it differs, the content is the same:
/// every write changes at least `changed_ns`, which programs cannot set. Two writes within one tick of the clock of the
/// file system have the same.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Stamp {
    /// Size.
    pub bytes: u64,
    /// Time of the last change of its content, in nanoseconds since 1970.
    pub modified_ns: i64,
    /// Time of the last change of its content, name or rights, in nanoseconds since 1970.
    pub changed_ns: i64,
    /// Number of the file on its file system.
    pub inode: u64,
}

impl Stamp {
    /// The stamp of a file; none where the system does not tell when a file was changed, or tells of a year beyond 2262.
    ///
    /// # Errors
    /// If there is no such file.
    pub fn of(path: &Path) -> Result<Option<Self>, FileError> {
        let found = fs::metadata(path).map_err(|source| FileError::io("read", path, source))?;
        Ok(known(&found))
    }

    /// The shortest time between two writes that surely have two stamps, in nanoseconds: some file systems count seconds.
    pub fn tick_ns(&self) -> i64 {
        let counts_seconds =
            self.modified_ns % 1_000_000_000 == 0 && self.changed_ns % 1_000_000_000 == 0;
        if counts_seconds { 2_000_000_000 } else { 20_000_000 }
    }

    /// Wait until every later change, and every file written from now on, has a stamp later by more than a tick: for a file
    /// that was not written just now, not at all.
    pub fn settle(&self) {
        let since_1970 = |now: Duration| i64::try_from(now.as_nanos()).ok();
        let now = SystemTime::now().duration_since(UNIX_EPOCH).ok().and_then(since_1970);
        // Two: stamps are of a clock that itself moves by ticks.
        let longest = 2 * self.tick_ns();
        let settled = self.changed_ns.saturating_add(longest);
        // The clock of a file system elsewhere may be ahead of ours.
        let left = now.map_or(longest, |now| settled.saturating_sub(now).clamp(0, longest));
        thread::sleep(Duration::from_nanos(left.unsigned_abs()));
    }
}

fn known(found: &fs::Metadata) -> Option<Stamp> {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt as _;
        let since_1970 = |secs: i64, ns: i64| secs.checked_mul(1_000_000_000)?.checked_add(ns);
        Some(Stamp {
            bytes: found.len(),
            modified_ns: since_1970(found.mtime(), found.mtime_nsec())?,
            changed_ns: since_1970(found.ctime(), found.ctime_nsec())?,
            inode: found.ino(),
        })
    }
    #[cfg(not(unix))]
    None
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn a_write_of_as_many_bytes_changes_the_stamp_even_if_the_time_is_set_back() {
        let directory = tempfile::tempdir().expect("a directory");
        let path = directory.path().join("a");
        fs::write(&path, b"content").expect("written");
        let before = Stamp::of(&path).expect("there").expect("known");
        assert_eq!(Stamp::of(&path).expect("there"), Some(before));
        before.settle();
        fs::write(&path, b"Content").expect("written");
        let time = fs::File::options().write(true).open(&path).expect("there");
        let earlier = UNIX_EPOCH + Duration::from_nanos(before.modified_ns as u64);
        time.set_modified(earlier).expect("ours");
        let after = Stamp::of(&path).expect("there").expect("known");
        assert_eq!((after.bytes, after.modified_ns), (before.bytes, before.modified_ns));
        assert!(after.changed_ns > before.changed_ns + before.tick_ns());
        assert!(Stamp::of(&directory.path().join("b")).is_err());
    }
}
