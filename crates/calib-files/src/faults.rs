//! Fault injection: the n-th disk operation fails, the disk is full from there on, or the process ends there.
//!
//! Every operation that changes a disk is announced here before it is done. Without an armed fault this costs one load.

use std::{
    fs::File,
    io::{self, Write as _},
    path::Path,
    sync::{
        OnceLock,
        atomic::{AtomicU64, Ordering},
    },
};

/// A disk operation.
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
    /// Whether it needs disk space.
    fn grows(self) -> bool {
        matches!(self, Self::MakeFolder | Self::Create | Self::Reserve | Self::Write)
    }
}

/// The fault to inject. Operations are counted from 1.
#[derive(Debug)]
pub enum Fault {
    /// This operation fails; the others do not.
    Fail(u64),
    /// From this operation on, everything that needs disk space fails.
    Full(u64),
    /// The process ends before this operation, or in the middle of it. No destructor runs.
    Kill(u64),
    /// No fault. The operations are written to this file, one per line.
    List(File),
    /// No lock is available, as on some file systems of clusters.
    Lockless,
    /// The reported free space, in bytes.
    Free(u64),
}

static ARMED: OnceLock<Fault> = OnceLock::new();
static REACHED: AtomicU64 = AtomicU64::new(0);

/// Arms this fault in this process. A second fault is ignored.
pub fn arm(fault: Fault) {
    let _ = ARMED.set(fault);
}

/// Whether locks must fail.
pub(crate) fn have_no_locks() -> bool {
    matches!(ARMED.get(), Some(Fault::Lockless))
}

/// Returns the free space to report, in bytes, if it is overridden.
pub(crate) fn free() -> Option<u64> {
    match ARMED.get() {
        Some(Fault::Free(bytes)) => Some(*bytes),
        _ => None,
    }
}

/// Announces an operation on `path`, and returns an error if it must fail.
pub(crate) fn reach(operation: Operation, path: &Path) -> io::Result<()> {
    reach_or_half(operation, path, || ())
}

/// Announces an operation as [`reach`] does, if it can be done by half. `half` is done before it fails, or before the
/// process ends.
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
        // In one piece, because several threads may write.
        Fault::List(list) => {
            let mut list: &File = list;
            list.write_all(format!("{operation:?} {}\n", path.display()).as_bytes())
        }
        _ => Ok(()),
    }
}
