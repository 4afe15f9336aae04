//! The sink for the results of a shard.

use std::{
    path::PathBuf,
    sync::{Mutex, MutexGuard},
    time::Duration,
};

use calib_base::clock::Stopwatch;
use calib_core::locked;
use calib_sweep::{SweepError, Unit, UnitRuns, UnitSink};

use crate::cluster::results::{self, Completeness, Header, ShardResults, UnitsInOrder};

/// The results file of a shard. It is rewritten after each pass. If passes are very short, it is only rewritten once
/// writing takes at most a twentieth of the time.
pub(crate) struct ShardSink {
    path: PathBuf,
    states: PathBuf,
    header: Header,
    kept: Mutex<KeptResults>,
}

/// The results, and which of them are on the disk.
struct KeptResults {
    units: UnitsInOrder,
    is_written: bool,
    /// Time since the last write, and its duration.
    last: Option<(Stopwatch, Duration)>,
}

/// At most one part in this many of the time between two writes goes into writing.
const WRITING: u32 = 20;

impl ShardSink {
    /// Creates the sink for the file at `path`, which already holds `units`. Unfinished passes keep their state in
    /// `states`.
    pub(crate) fn new(path: PathBuf, states: PathBuf, header: Header, units: UnitsInOrder) -> Self {
        let kept = Mutex::new(KeptResults { units, is_written: true, last: None });
        Self { path, states, header, kept }
    }

    pub(crate) fn get(&self, unit: &Unit, key: &str) -> Option<UnitRuns> {
        self.locked().units.get(&(unit.clone(), key.to_owned())).cloned()
    }

    /// Returns the number of training runs in the file.
    pub(crate) fn training_runs(&self) -> usize {
        results::training_runs(&self.locked().units)
    }

    /// Writes the results at the end of an attempt.
    ///
    /// # Errors
    /// Returns an error if the file cannot be written.
    pub(crate) fn flush(&self) -> Result<(), SweepError> {
        let mut kept = self.locked();
        if kept.is_written { Ok(()) } else { self.write(&mut kept, Completeness::Partial) }
    }

    /// Marks the results as complete, and writes them.
    ///
    /// # Errors
    /// Returns an error if the file cannot be written.
    pub(crate) fn complete(&self) -> Result<(), SweepError> {
        self.write(&mut self.locked(), Completeness::Whole)
    }

    fn locked(&self) -> MutexGuard<'_, KeptResults> {
        locked(&self.kept)
    }

    /// Writes the results. Adds results that another attempt at the same shard has written since. Results that both
    /// have are equal.
    fn write(
        &self,
        kept: &mut KeptResults,
        mut completeness: Completeness,
    ) -> Result<(), SweepError> {
        let clock = Stopwatch::start();
        let other = ShardResults::read(&self.path).ok().filter(|other| other.header == self.header);
        if let Some(other) = other {
            results::add(&mut kept.units, other.units.into_values());
            if other.completeness == Completeness::Whole {
                completeness = Completeness::Whole;
            }
        }
        let results =
            ShardResults { header: self.header.clone(), units: kept.units.clone(), completeness };
        results.write(&self.path)?;
        kept.is_written = true;
        kept.last = Some((Stopwatch::start(), clock.elapsed()));
        Ok(())
    }
}

impl UnitSink for ShardSink {
    fn put(&self, runs: &[UnitRuns]) -> Result<(), SweepError> {
        let mut kept = self.locked();
        results::add(&mut kept.units, runs.iter().cloned());
        kept.is_written = false;
        match kept.last {
            Some((since, took)) if since.elapsed() < WRITING * took => Ok(()),
            _ => self.write(&mut kept, Completeness::Partial),
        }
    }

    fn state(&self, name: &str) -> PathBuf {
        self.states.join(name)
    }
}
