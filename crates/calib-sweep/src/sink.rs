use std::path::PathBuf;

use crate::{SweepError, UnitRuns};

/// Where the results of a pass go, and the state of one that is not finished.
pub trait UnitSink: Sync {
    /// Store the runs of a pass, all of them or none. Runs of other settings that are there stay.
    ///
    /// # Errors
    /// If they cannot be written.
    fn put(&self, runs: &[UnitRuns]) -> Result<(), SweepError>;

    /// Where the state of an unfinished pass that is called `name` is kept.
    fn state(&self, name: &str) -> PathBuf;
}
