//! Estimates the time of a sweep before it runs.

use std::path::Path;

use calib_base::{
    StepError,
    cost::StepCost,
    disk_room,
    output::{bytes, count, counted, duration_of_secs},
};
use calib_study::{Job, Study};
use calib_sweep::RaceKind;
use schemars::JsonSchema;
use serde::Serialize;

/// Bytes of one setting's result in the file of a unit, and of each point of its learning curve.
const ROW_BYTES: u64 = 750;
const POINT_BYTES: u64 = 82;

/// Expected cost of the rest of a sweep, from measurements of some steps on this machine.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Expected {
    /// Number of passes over streams. One pass trains all settings for the sensors with one discount factor.
    pub(crate) passes: usize,
    /// Number of threads that share the passes.
    pub(crate) threads: usize,
    /// Seconds until the last pass ends, if nothing else runs.
    pub(crate) secs: f64,
    /// Processor seconds of all threads together.
    pub(crate) processor_secs: f64,
    /// Bytes of results on disk.
    pub(crate) disk: u64,
}

impl Expected {
    /// Returns the total of several sweeps that run one after the other.
    pub(crate) fn in_all<'a>(sweeps: impl Iterator<Item = &'a Self>) -> Option<Self> {
        sweeps.cloned().reduce(|all, sweep| Self {
            passes: all.passes + sweep.passes,
            threads: all.threads.max(sweep.threads),
            secs: all.secs + sweep.secs,
            processor_secs: all.processor_secs + sweep.processor_secs,
            disk: all.disk + sweep.disk,
        })
    }

    /// Estimates `passes` passes of `pass_secs` seconds each, which give this many results.
    pub(crate) fn new(
        pass_secs: f64,
        passes: usize,
        threads: usize,
        results: u64,
        study: &Study,
    ) -> Self {
        let rounds = passes.div_ceil(threads.max(1));
        Self {
            passes,
            threads: threads.min(passes.max(1)),
            secs: pass_secs * rounds as f64,
            processor_secs: pass_secs * passes as f64,
            disk: result_bytes(study, results),
        }
    }

    /// Returns the cost of the step, given its memory in bytes.
    pub(crate) fn of_step(&self, memory: u64) -> StepCost {
        StepCost { processor_secs: self.processor_secs, memory, disk: self.disk }
    }

    pub(crate) fn line(&self) -> String {
        format!(
            "expecting about {} on {} ({} passes over the data, {} of processor time); up to {} on disk",
            duration_of_secs(self.secs),
            counted(self.threads, "thread"),
            count(self.passes),
            duration_of_secs(self.processor_secs),
            bytes(self.disk)
        )
    }
}

/// Returns the bytes of this many results.
fn result_bytes(study: &Study, results: u64) -> u64 {
    results.saturating_mul(ROW_BYTES + POINT_BYTES * study.sweep.curve_points as u64)
}

/// Returns the bytes of this many runs, as far as they are certain. For a race it is not known how many are left out.
pub fn certain_bytes(study: &Study, runs: usize) -> u64 {
    match study.sweep.race {
        RaceKind::None => result_bytes(study, runs as u64),
        RaceKind::Halving => 0,
    }
}

/// Refuses runs if the disk has no room for their results in the `directory` of the sweep.
///
/// # Errors
/// Returns an error if there is clearly less room.
pub(crate) fn require_room(job: &Job, runs: usize, directory: &Path) -> Result<(), StepError> {
    let needed = certain_bytes(job.study(), runs);
    // With --force the existing results are removed first.
    let needed = if job.policy().redoes() { disk_room::left(needed, directory) } else { needed };
    disk_room::require(
        needed,
        "the sweep",
        directory,
        "choose a folder on another disk with --output, sweep fewer settings, or lower sweep.curve_points",
    )
}
