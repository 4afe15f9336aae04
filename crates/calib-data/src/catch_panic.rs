//! Reading files that may be damaged.

use std::{
    panic::{AssertUnwindSafe, catch_unwind},
    sync::atomic::{AtomicUsize, Ordering},
};

use polars::prelude as pl;

/// Longest reason that is passed on.
const REASON: usize = 240;

/// Readers at work on all threads. A reader has threads of its own, so it cannot be told whose panic one is.
static READING: AtomicUsize = AtomicUsize::new(0);

/// Whether a panic may be that of a reader on a damaged file, which becomes an error: nobody need be told of it.
pub fn is_reading_parquet() -> bool {
    READING.load(Ordering::Relaxed) > 0
}

/// Do what reads a file; the error is what was wrong with it, in one line.
///
/// The Parquet reader panics on some damaged files. That is an error of the file like any other.
pub(crate) fn catch_panic<T>(read: impl FnOnce() -> pl::PolarsResult<T>) -> Result<T, String> {
    // Whatever the reader leaves half-done is dropped with it: nothing of it is used after a panic.
    READING.fetch_add(1, Ordering::Relaxed);
    let read = catch_unwind(AssertUnwindSafe(read));
    READING.fetch_sub(1, Ordering::Relaxed);
    match read {
        Ok(result) => result.map_err(|error| one_line(&error.to_string())),
        Err(panic) => {
            let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
            let text = text.or_else(|| panic.downcast_ref::<String>().cloned());
            let text = text.unwrap_or_else(|| "unknown".to_owned());
            Err(one_line(&format!("the reader failed: {text}")))
        }
    }
}

/// The first line, cut to a readable length.
fn one_line(reason: &str) -> String {
    let line = reason.lines().next().unwrap_or_default();
    match line.char_indices().nth(REASON) {
        None => line.to_owned(),
        Some((end, _)) => format!("{}…", &line[..end]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn panics_and_errors_become_one_line() {
        let error = catch_panic::<()>(|| Err(pl::polars_err!(ComputeError: "first\nsecond")));
        assert_eq!(error, Err("first".to_owned()));
        let panic = catch_panic::<()>(|| {
            assert!(is_reading_parquet());
            panic!("bad {}", "thrift")
        });
        assert_eq!(panic, Err("the reader failed: bad thrift".to_owned()));
        assert_eq!(catch_panic(|| Ok(7)), Ok(7));
        assert_eq!(one_line(&"é".repeat(500)).chars().count(), REASON + 1);
    }
}
