//! Sensors whose returns have one discount factor.

use crate::{Candidate, Environment, EnvironmentId, Span, race::RacedStreams};

/// What the agents of some sensors are and are trained in: those whose return has one discount factor.
pub struct SensorGroup<'a> {
    /// The candidates of the plan, with this discount factor.
    pub candidates: &'a [Candidate],
    /// Where they are trained.
    pub environments: Vec<&'a dyn Environment>,
    /// How long their streams are. All groups have as many steps.
    pub span: Span,
}

/// A sensor that is predicted.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PlannedSensor {
    /// Its name.
    pub name: String,
    /// Its column of the states.
    pub column: usize,
    /// Position of its group.
    pub group: usize,
}

impl SensorGroup<'_> {
    /// Runs in all of its environments.
    pub(super) fn runs(&self) -> usize {
        self.environments.iter().map(|environment| environment.runs()).sum()
    }

    /// The streams that a race orders.
    pub(super) fn raced_streams(&self) -> RacedStreams {
        let mut members = Vec::new();
        let mut runs = usize::MAX;
        let mut windows = 0;
        for environment in &self.environments {
            match environment.id() {
                EnvironmentId::Member(member) => {
                    members.push(member);
                    runs = runs.min(environment.runs());
                }
                EnvironmentId::LogReplay => windows += environment.runs(),
                EnvironmentId::Online => {}
            }
        }
        let runs = if members.is_empty() { 0 } else { runs };
        RacedStreams { members, runs, windows }
    }
}
