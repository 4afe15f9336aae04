//! Failures on purpose: the n-th operation on the disk fails, the disk is full from there on, or the process ends there.
//!
//! Every operation that changes a disk is announced here before it is done. Unless a fault is armed this is one load.

use std::{
    fs::File,
    io::{self, Write as _},
    path::Path,
    sync::{
        OnceLock,
        atomic::{AtomicU64, Ordering},
    },
};

/// What is done to a disk.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Operation {
    MakeFolder,
    Create,
    Reserve,
    Write,
    Sync,
    Rename,
    Remove,
}

impl Operation {
    /// Whether it takes room.
    fn grows(self) -> bool {
        matches!(self, Self::MakeFolder | Self::Create | Self::Reserve | Self::Write)
    }
}

/// What is to go wrong. Operations are counted from 1.
#[derive(Debug)]
pub enum Fault {
    /// This operation fails, the others do not.
    Fail(u64),
    /// From this operation on nothing that takes room succeeds.
    Full(u64),
    /// The process ends before this operation, or half-way through it: no destructor runs.
    Kill(u64),
    /// Nothing; the operations are written to this file, a line each.
    List(File),
    /// No lock can be had, as on some file systems of clusters.
    Lockless,
    /// So many bytes are said to be free.
    Free(u64),
}

static ARMED: OnceLock<Fault> = OnceLock::new();
static REACHED: AtomicU64 = AtomicU64::new(0);

/// Let this go wrong in this process. A second fault is ignored.
pub fn arm(fault: Fault) {
    let _ = ARMED.set(fault);
}

/// Whether locks are to fail.
pub(crate) fn have_no_locks() -> bool {
    matches!(ARMED.get(), Some(Fault::Lockless))
}

/// The bytes that are to be said to be free, if any are.
pub(crate) fn free() -> Option<u64> {
    match ARMED.get() {
        Some(Fault::Free(bytes)) => Some(*bytes),
        _ => None,
    }
}

/// Announce an operation on `path`: an error if it is to fail.
pub(crate) fn reach(operation: Operation, path: &Path) -> io::Result<()> {
    reach_or_half(operation, path, || ())
}

/// As [`reach`], of an operation that can be done by half: `half` is done before it fails, or the process ends.
pub(crate) fn reach_or_half(
    operation: Operation,
    path: &Path,
    half: impl FnOnce(),
) -> io::Result<()> {
    let Some(armed) = ARMED.get() else { return Ok(()) };
    let number = REACHED.fetch_add(1, Ordering::Relaxed) + 1;
    match armed {
        Fault::Fail(at) if number == *at => {
            half();
            Err(io::Error::other("a failure on purpose"))
        }
        Fault::Full(at) if number >= *at && operation.grows() => {
            half();
            Err(io::ErrorKind::StorageFull.into())
        }
        Fault::Kill(at) if number == *at => {
            half();
            std::process::abort()
        }
        // In one piece: several threads may write theirs.
        Fault::List(list) => {
            let mut list: &File = list;
            list.write_all(format!("{operation:?} {}\n", path.display()).as_bytes())
        }
        _ => Ok(()),
    }
}
