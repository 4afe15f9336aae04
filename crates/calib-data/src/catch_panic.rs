//! Turns panics of the Parquet reader on damaged files into errors.

use std::{
    panic::{AssertUnwindSafe, catch_unwind},
    sync::atomic::{AtomicUsize, Ordering},
};

use polars::prelude as pl;

/// Maximum length of a reason, in characters.
const REASON: usize = 240;

/// Number of active readers on all threads. A reader has threads of its own, so a panic cannot be assigned to
/// one reader.
static READING: AtomicUsize = AtomicUsize::new(0);

/// Whether a panic may come from a reader of a damaged file. Such a panic becomes an error and need not be
/// reported.
pub fn is_reading_parquet() -> bool {
    READING.load(Ordering::Relaxed) > 0
}

/// Runs `read` on a file; the error is the reason in one line.
///
/// The Parquet reader panics on some damaged files. This is an error of the file like any other.
pub(crate) fn catch_panic<T>(read: impl FnOnce() -> pl::PolarsResult<T>) -> Result<T, String> {
    // A panic drops the whole reader, so its half-finished state is never used.
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

/// Returns the first line, cut to a readable length.
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
