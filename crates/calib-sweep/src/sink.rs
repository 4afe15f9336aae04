use std::path::PathBuf;

use crate::{SweepError, UnitRuns};

/// Storage for the results of a pass and the state of an unfinished pass.
pub trait UnitSink: Sync {
    /// Stores the runs of a pass, either all or none. Runs of other settings that are already
    /// stored stay.
    ///
    /// # Errors
    /// Returns an error if the runs cannot be written.
    fn put(&self, runs: &[UnitRuns]) -> Result<(), SweepError>;

    /// Returns the path for the state of the unfinished pass `name`.
    fn state(&self, name: &str) -> PathBuf;
}
