use std::path::PathBuf;

use crate::{SweepError, UnitResult};

/// Where the results of a pass go, and the state of one that is not finished.
pub trait UnitSink: Sync {
    /// Store the results of a pass, all of them or none.
    ///
    /// # Errors
    /// If they cannot be written.
    fn put(&self, results: &[UnitResult]) -> Result<(), SweepError>;

    /// Where the state of an unfinished pass that is called `name` is kept.
    fn state(&self, name: &str) -> PathBuf;
}
