//! The measured errors of a sensor, for the choice and for its resamples.

use calib_stats::{Drawn, Nested, StatsError};

use super::{
    Judging,
    errors::Errors,
    rule::{Evidence, Rule},
};
use crate::{Candidate, EnvironmentId, SweepError, UnitResult};

/// The measured errors by environment.
pub(super) struct MeasuredErrors {
    pub(super) members: Vec<Errors>,
    pub(super) log: Option<Errors>,
    pub(super) online: Option<Errors>,
}

impl MeasuredErrors {
    /// Returns the environments in which settings are compared: the members, or the log where there is no model.
    pub(super) fn compared(&self) -> impl Iterator<Item = &Errors> {
        let log = self.log.iter().filter(|_| self.members.is_empty());
        self.members.iter().chain(log)
    }

    pub(super) fn new(
        results: &[&UnitResult],
        candidates: &[Candidate],
        judging: &Judging<'_>,
    ) -> Result<Self, SweepError> {
        let mut ids: Vec<EnvironmentId> =
            results.iter().map(|result| result.unit.environment).collect();
        ids.sort_unstable();
        ids.dedup();
        let [log, online] = [EnvironmentId::LogReplay, EnvironmentId::Online].map(|id| {
            let errors = ids.contains(&id).then(|| Errors::new(id, results, judging, candidates));
            errors.transpose()
        });
        Ok(Self {
            members: ids
                .iter()
                .filter(|id| matches!(id, EnvironmentId::Member(_)))
                .map(|&id| Errors::new(id, results, judging, candidates))
                .collect::<Result<_, _>>()?,
            log: log?,
            online: online?,
        })
    }
}

/// The same errors for resampling: members with their rollouts, windows with their runs.
pub(super) struct NestedRuns {
    /// `None` without a model. In that case there is a log.
    pub(super) members: Option<Nested>,
    pub(super) log: Option<Nested>,
    pub(super) online: Option<Nested>,
}

impl NestedRuns {
    /// # Errors
    /// Returns an error if there are neither members nor a replayed log.
    pub(super) fn new(all: &MeasuredErrors) -> Result<Self, StatsError> {
        let is_without = all.members.is_empty() && all.log.is_some();
        Ok(Self {
            members: (!is_without)
                .then(|| Nested::new(all.members.iter().flat_map(Errors::units).collect()))
                .transpose()?,
            log: all.log.as_ref().map(Errors::nested).transpose()?,
            online: all.online.as_ref().map(Errors::nested).transpose()?,
        })
    }

    /// Returns all runs, each once.
    pub(super) fn whole(&self) -> AllRuns<'_> {
        AllRuns {
            members: self.members.as_ref().map(Nested::whole),
            log: self.log.as_ref().map(Nested::whole),
        }
    }

    /// Returns the rules that can choose from these runs.
    pub(super) fn rules(&self) -> impl Iterator<Item = Rule> {
        let is_without = self.members.is_none();
        Rule::ALL.into_iter().filter(move |rule| !is_without || rule.works_without_model())
    }
}

/// All runs that a choice is made from.
pub(super) struct AllRuns<'a> {
    pub(super) members: Option<Drawn<'a>>,
    pub(super) log: Option<Drawn<'a>>,
}

impl<'a> AllRuns<'a> {
    pub(super) fn evidence(&self) -> Evidence<'_, 'a> {
        Evidence { members: self.members.as_ref(), log: self.log.as_ref() }
    }
}
