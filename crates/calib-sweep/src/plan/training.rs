//! Training of the runs that a plan lacks.

use std::collections::{BTreeMap, BTreeSet};

use calib_core::Monitor;
use rayon::prelude::*;

use super::{Plan, StoredUnits, Survivors, UnitJob};
use crate::{
    EnvironmentId, SweepError, Unit, UnitResult, UnitRuns, UnitStore, cohorts, pass::Pass,
};

/// A completed sweep.
#[derive(Clone, Debug, PartialEq)]
pub struct CompletedSweep {
    /// Every result, in the order of the units.
    pub results: Vec<UnitResult>,
    /// Number of units that lacked at least one run.
    pub ran: usize,
    /// Number of new runs, counting one per setting of a unit.
    pub runs: usize,
}

impl<'a> Plan<'a> {
    /// Makes the runs that `store` lacks, as [`complete`](Self::complete) does.
    ///
    /// # Errors
    /// Fails as [`complete`](Self::complete) does.
    pub fn run(
        &self,
        store: &UnitStore,
        monitor: &dyn Monitor,
    ) -> Result<Vec<UnitResult>, SweepError> {
        Ok(self.complete(self.stored(store), store, monitor)?.results)
    }

    /// Makes the runs that `stored` lacks in parallel, puts them into `store`, and returns all results in the order of
    /// [`units`](Self::units). Results do not depend on the number of threads.
    ///
    /// The units of one run in one environment share a pass over its stream, for all sensors of a group. Long passes
    /// save their state in the store, so that a killed pass resumes in the middle.
    ///
    /// # Errors
    /// Returns the first failure, or [`SweepError::Cancelled`]. Finished units stay stored.
    pub fn complete(
        &self,
        stored: StoredUnits,
        store: &UnitStore,
        monitor: &dyn Monitor,
    ) -> Result<CompletedSweep, SweepError> {
        let mut found = stored;
        let mut ran = 0;
        let mut runs = 0;
        let kept = store.states_kept();
        let mut left = self.passes(&found);
        monitor.begin("training", (left * self.options.span.steps) as u64);
        let mut survivors = Survivors::default();
        loop {
            let jobs = self.jobs(&survivors);
            // The settings of later rounds are known only now. Stored runs of these units are not repeated, and some
            // units are not needed.
            found.read(&jobs, &|unit, key| store.get(unit, key));
            let now = self.passes(&found);
            // Some sensors may have been further ahead before, so one pass can train units of several rounds.
            let done = left.saturating_sub(now);
            monitor.advance((done * self.options.span.steps) as u64);
            let rest: Vec<UnitJob<'_>> = jobs.iter().filter_map(|job| found.rest(job)).collect();
            let trained = self.train(&rest, store, monitor)?;
            ran += trained.len();
            runs += trained.iter().map(|made| made.runs.len()).sum::<usize>();
            let made = self.passes_over(trained.iter().map(|made| &made.unit));
            left = now.saturating_sub(made);
            let mut trained: BTreeMap<Unit, UnitRuns> =
                trained.into_iter().map(|made| (made.unit.clone(), made)).collect();
            for job in &jobs {
                if let Some(made) = trained.remove(&job.unit) {
                    found.add(job, made);
                }
            }
            if !self.decide(&mut survivors, &found.whole) {
                store.forget_stale(&kept);
                let results = jobs.iter().filter_map(|job| found.whole.remove(&job.unit)).collect();
                return Ok(CompletedSweep { results, ran, runs });
            }
        }
    }

    /// Returns the number of passes over streams that `found` lacks. Sensors share the pass of a run. In a race it is
    /// an upper bound.
    pub fn passes(&self, found: &StoredUnits) -> usize {
        self.passes_over(self.missing(&found.whole).iter())
    }

    fn passes_over<'u>(&self, units: impl Iterator<Item = &'u Unit>) -> usize {
        let passes = units.map(|unit| (self.group_of(&unit.sensor), unit.environment, unit.run));
        passes.collect::<BTreeSet<_>>().len()
    }

    /// Trains these jobs in parallel.
    fn train(
        &self,
        jobs: &[UnitJob<'_>],
        store: &UnitStore,
        monitor: &dyn Monitor,
    ) -> Result<Vec<UnitRuns>, SweepError> {
        let mut missing: BTreeMap<(usize, EnvironmentId, usize), Vec<&UnitJob<'_>>> =
            BTreeMap::new();
        for job in jobs {
            let pass = (job.group, job.unit.environment, job.unit.run);
            missing.entry(pass).or_default().push(job);
        }
        let missing: Vec<Pass<'_, '_>> =
            missing.into_values().map(|jobs| self.pass(jobs)).collect();
        if let Some(accelerator) = self.accelerator {
            return cohorts::run(&missing, accelerator, store, monitor);
        }
        let trained = missing
            .into_par_iter()
            .with_max_len(1)
            .map(|pass| {
                monitor.check()?;
                pass.run(store, monitor)
            })
            .collect::<Result<Vec<_>, _>>()?;
        Ok(trained.into_iter().flatten().collect())
    }

    /// Creates the pass of these jobs.
    pub(super) fn pass<'p>(&'p self, jobs: Vec<&'p UnitJob<'a>>) -> Pass<'p, 'a> {
        Pass {
            jobs,
            program: self.program,
            baselines: self.baselines,
            options: &self.options,
            work_between: self.work_between,
        }
    }
}
