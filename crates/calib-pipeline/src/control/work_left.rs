//! The runs of a sweep of agents that act that are left to make.

use std::collections::BTreeSet;

use calib_base::{
    StepError, bail,
    output::{Printer, count},
};
use calib_control::{ActionModelKind, ControlConfig, RunId, runs_here};
use calib_study::Job;

use super::units::RunFiles;

/// Largest number of runs per kind of model that are checked one by one.
const MOST_RUNS: usize = 1_000_000;
/// Largest number of runs per kind of model in which those of a share are searched.
const MOST_NUMBERS: usize = 100_000_000;

/// Whether all runs are made, or only a share.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum WorkScope {
    Share,
    All,
}

/// The remaining work.
pub(super) struct WorkLeft {
    pub(super) scope: WorkScope,
    /// All runs, including those that exist.
    pub(super) runs: usize,
    /// The work per kind of model, in the order of the study.
    pub(super) kinds: Vec<KindLeft>,
}

/// The remaining work in one kind of model.
pub(super) struct KindLeft {
    pub(super) kind: ActionModelKind,
    /// Runs left for each setting.
    pub(super) of_settings: Vec<usize>,
    /// The ensemble members that are needed.
    pub(super) members: Vec<usize>,
}

impl KindLeft {
    fn of(kind: ActionModelKind, left: &[RunId], settings: usize, members: Vec<usize>) -> Self {
        let mut of_settings = vec![0; settings];
        for run in left {
            of_settings[run.candidate] += 1;
        }
        Self { kind, of_settings, members }
    }

    fn runs(&self) -> usize {
        self.of_settings.iter().sum()
    }
}

impl WorkLeft {
    /// Returns the work that `units` lack.
    ///
    /// # Errors
    /// Returns an error if there are too many runs to number, or too many in a share.
    pub(super) fn of(
        job: &Job,
        config: &ControlConfig,
        settings: usize,
        units: &RunFiles,
        printer: &Printer,
    ) -> Result<Self, StepError> {
        let members = config.model.members;
        let of_kind = runs_of_kind(config, settings)?;
        let scope = if units.are_all() { WorkScope::All } else { WorkScope::Share };
        if scope == WorkScope::All && !is_listed(job, of_kind, units, printer) {
            return Self::of_new(config, settings);
        }
        let mut work = Self { scope, runs: 0, kinds: Vec::new() };
        for &kind in &config.models {
            if of_kind > MOST_NUMBERS || units.own_runs(kind, of_kind) > MOST_RUNS {
                bail!(
                    "a share of {} runs in a kind of models is not counted; take smaller shares (--share), \
                     lower control.runs, or sweep fewer settings",
                    count(of_kind)
                );
            }
            let ids = runs_here(kind, members, config.runs, settings, units);
            work.runs += ids.len();
            let left = if job.policy().redoes() { ids } else { units.split(ids).1 };
            let members = match scope {
                // Constant actions are taken in every member, even if all runs are stored.
                WorkScope::All => (0..members).collect(),
                WorkScope::Share => members_of(&left),
            };
            work.kinds.push(KindLeft::of(kind, &left, settings, members));
        }
        Ok(work)
    }

    /// Returns the work of a whole sweep of which no run is stored.
    ///
    /// # Errors
    /// Returns an error if there are too many runs to number.
    pub(super) fn of_new(config: &ControlConfig, settings: usize) -> Result<Self, StepError> {
        let members = config.model.members;
        let runs = runs_of_kind(config, settings)? * config.models.len();
        let kinds = config.models.iter().map(|&kind| KindLeft {
            kind,
            of_settings: vec![members * config.runs; settings],
            members: (0..members).collect(),
        });
        Ok(Self { scope: WorkScope::All, runs, kinds: kinds.collect() })
    }

    pub(super) fn left(&self) -> usize {
        self.kinds.iter().map(KindLeft::runs).sum()
    }

    /// Returns the ensemble members of this kind of model in which agents or constant actions run.
    pub(super) fn members(&self, kind: ActionModelKind) -> &[usize] {
        self.kinds.iter().find(|left| left.kind == kind).map_or(&[][..], |left| &left.members[..])
    }
}

/// Returns the ensemble members of these runs, in ascending order.
pub(super) fn members_of(ids: &[RunId]) -> Vec<usize> {
    let members: BTreeSet<usize> = ids.iter().map(|id| id.member).collect();
    members.into_iter().collect()
}

/// Returns the number of runs in one kind of model.
///
/// # Errors
/// Returns an error if the runs of all kinds are too many to number.
pub(super) fn runs_of_kind(config: &ControlConfig, settings: usize) -> Result<usize, StepError> {
    let kinds = ActionModelKind::ALL.len();
    let of_kind = [config.runs, settings]
        .into_iter()
        .try_fold(config.model.members, usize::checked_mul)
        .filter(|of_kind| of_kind.checked_mul(kinds).is_some());
    of_kind.ok_or_else(|| {
        StepError::message(format!(
            "{} ensemble members, {} runs and {} settings make more runs than can be numbered; lower control.model.members",
            count(config.model.members),
            count(config.runs),
            count(settings)
        ))
    })
}

/// Whether the runs of a whole sweep are checked one by one, which finds the stored ones.
fn is_listed(job: &Job, of_kind: usize, units: &RunFiles, printer: &Printer) -> bool {
    if job.policy().redoes() || !units.has_kept() {
        return false;
    }
    if of_kind > MOST_RUNS {
        printer.say(&format!(
            "runs that were kept are not looked at: there are more than {} in a kind of models",
            count(MOST_RUNS)
        ));
    }
    of_kind <= MOST_RUNS
}
