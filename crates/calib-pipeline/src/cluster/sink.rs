//! Where a shard puts its results.

use std::{
    path::PathBuf,
    sync::{Mutex, MutexGuard, PoisonError},
    time::Duration,
};

use calib_base::clock::Stopwatch;
use calib_sweep::{SweepError, Unit, UnitRuns, UnitSink};

use crate::cluster::results::{self, Extent, Header, ShardResults, UnitsInOrder};

/// The file of a shard, which is rewritten as a whole: after each pass, or, where passes are so short that the shard would do
/// nothing else, when a twentieth of the time goes into it.
pub(crate) struct ShardSink {
    path: PathBuf,
    states: PathBuf,
    header: Header,
    kept: Mutex<KeptResults>,
}

/// What there is, and what of it is on the disk.
struct KeptResults {
    units: UnitsInOrder,
    is_written: bool,
    /// When the file was last written, and how long that took.
    last: Option<(Stopwatch, Duration)>,
}

/// Of the time between two writes, this part at most goes into writing.
const WRITING: u32 = 20;

impl ShardSink {
    /// The file at `path`, which holds `units` already; unfinished passes keep their state in `states`.
    pub(crate) fn new(path: PathBuf, states: PathBuf, header: Header, units: UnitsInOrder) -> Self {
        let kept = Mutex::new(KeptResults { units, is_written: true, last: None });
        Self { path, states, header, kept }
    }

    pub(crate) fn get(&self, unit: &Unit, key: &str) -> Option<UnitRuns> {
        self.locked().units.get(&(unit.clone(), key.to_owned())).cloned()
    }

    pub(crate) fn len(&self) -> usize {
        self.locked().units.len()
    }

    /// Nothing more comes in this attempt.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub(crate) fn flush(&self) -> Result<(), SweepError> {
        let mut kept = self.locked();
        if kept.is_written { Ok(()) } else { self.write(&mut kept, Extent::Partial) }
    }

    /// All results are there.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub(crate) fn complete(&self) -> Result<(), SweepError> {
        self.write(&mut self.locked(), Extent::Whole)
    }

    fn locked(&self) -> MutexGuard<'_, KeptResults> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Write what there is, and what another attempt at the same shard has written meanwhile: it is the same as far as both have it.
    fn write(&self, kept: &mut KeptResults, mut extent: Extent) -> Result<(), SweepError> {
        let clock = Stopwatch::start();
        let other = ShardResults::read(&self.path).ok().filter(|other| other.header == self.header);
        if let Some(other) = other {
            results::add(&mut kept.units, other.units.into_values());
            if other.extent == Extent::Whole {
                extent = Extent::Whole;
            }
        }
        let results =
            ShardResults { header: self.header.clone(), units: kept.units.clone(), extent };
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
            _ => self.write(&mut kept, Extent::Partial),
        }
    }

    fn state(&self, name: &str) -> PathBuf {
        self.states.join(name)
    }
}
