//! The plan of a sweep, and what a dry run counts over several.

use std::{cell::RefCell, collections::BTreeSet};

use calib_base::{
    StepError,
    output::{Printer, count, counted},
};
use calib_study::{Job, Study};
use calib_sweep::Candidate;
use schemars::JsonSchema;
use serde::Serialize;

use crate::sweep::{
    cost::{Cost, MeasuredPasses},
    expected::Expected,
    memory::Memory,
};

/// Units that a dry run over several models and deployments has counted. Equal units run only once.
#[derive(Debug, Default)]
pub struct DryRunTally {
    units: RefCell<BTreeSet<String>>,
    expected: RefCell<Vec<PartPlan>>,
    measured: MeasuredPasses,
}

/// The estimate for the sweep of one model in one deployment.
#[derive(Clone, Debug)]
pub struct PartPlan {
    /// The model, if there are several.
    pub model: Option<String>,
    /// The deployment, if there are several.
    pub deployment: Option<String>,
    /// Time and disk space.
    pub expected: Expected,
}

impl DryRunTally {
    /// Counts these units, and returns how many were counted before.
    pub(crate) fn count_repeated(&self, keys: impl Iterator<Item = String>) -> usize {
        let mut counted = self.units.borrow_mut();
        keys.filter(|key| !counted.insert(key.clone())).count()
    }

    /// Records the estimate for the sweep of a job.
    pub(crate) fn expect(&self, job: &Job, expected: Expected) {
        let model = job.model();
        let deployment = job.deployment();
        let model = model.map(str::to_owned);
        let deployment = deployment.map(str::to_owned);
        self.expected.borrow_mut().push(PartPlan { model, deployment, expected });
    }

    /// Returns the timings of earlier models and deployments.
    pub(crate) fn measured(&self) -> &MeasuredPasses {
        &self.measured
    }

    /// Returns a line on all sweeps together. `None` if there is only one.
    pub fn in_all(&self) -> Option<String> {
        let expected = self.expected.borrow();
        let all = Expected::in_all(expected.iter().map(|part| &part.expected))?;
        (expected.len() > 1).then(|| format!("all sweeps together: {}", all.line()))
    }

    /// Returns the recorded estimates.
    pub fn expected(&self) -> Vec<PartPlan> {
        self.expected.borrow().clone()
    }
}

/// The plan of a sweep: the result of a dry run.
#[derive(Debug, Serialize, JsonSchema)]
pub struct SweepPlan {
    /// Every setting, in the order of the results.
    pub(crate) candidates: Vec<Candidate>,
    /// Number of units (sensor, environment, run).
    pub(crate) units: usize,
    /// Number of units without a result.
    pub(crate) left: usize,
    /// Number of runs without a result: in each of these units, one for each setting that was not trained on it.
    pub(crate) runs_left: usize,
    /// Number of these units that an earlier model or deployment of the same command already runs.
    pub(crate) shared: usize,
    /// Number of steps of every stream.
    pub(crate) steps: usize,
    /// Number of threads.
    pub(crate) threads: usize,
    /// Memory that the sweep needs.
    pub(crate) memory: Memory,
    /// Expected time, if units are left.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) expected: Option<Expected>,
}

impl SweepPlan {
    /// Estimates the sweep with `passes` left.
    pub(crate) fn expect(
        &self,
        cost: Cost,
        passes: usize,
        sensors: usize,
        study: &Study,
    ) -> Expected {
        // Passes only train settings that have no run yet.
        let share = self.runs_left as f64 / (self.left * self.candidates.len()).max(1) as f64;
        let pass_secs = cost.of_share(sensors, share);
        Expected::new(pass_secs, passes, self.threads, self.runs_left as u64, study)
    }

    /// Prints the plan, and refuses a sweep that does not fit.
    pub(crate) fn announce(&self, study: &Study, printer: &Printer) -> Result<(), StepError> {
        let shared = match self.shared {
            0 => String::new(),
            shared => format!(
                "; an earlier model or deployment makes {} of each setting",
                counted(shared, "run")
            ),
        };
        let all = self.units * self.candidates.len();
        let left = if self.runs_left == all {
            format!("all {}", count(all))
        } else {
            format!("{} of {}", count(self.runs_left), count(all))
        };
        printer.say(&format!(
            "{} settings x {} runs (sensor, environment, run) of {} steps, for {}; {left} training runs are left ({}){shared}",
            self.candidates.len(),
            count(self.units),
            count(self.steps),
            study.sweep.sensors.join(", "),
            counted(self.threads, "thread"),
        ));
        if self.left == 0 {
            return Ok(());
        }
        let memory = &self.memory;
        printer.say(&memory.text());
        memory.check()?;
        if let Some(expected) = &self.expected {
            printer.say(&expected.line());
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_units_are_counted_once() {
        let tally = DryRunTally::default();
        let keys = ["a", "b", "c"].map(str::to_owned);
        assert_eq!(tally.count_repeated(keys[..2].iter().cloned()), 0);
        assert_eq!(tally.count_repeated(keys.iter().cloned()), 2);
        assert_eq!(tally.count_repeated(keys.iter().cloned()), 3);
    }
}
