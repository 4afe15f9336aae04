//! Groups of sensors whose returns have the same discount factor.

use crate::{Candidate, Environment, EnvironmentId, Span, race::RacedStreams};

/// The agents and environments of the sensors with one discount factor.
pub struct SensorGroup<'a> {
    /// The settings of the plan, with this discount factor.
    pub candidates: &'a [Candidate],
    /// The environments that they are trained in.
    pub environments: Vec<&'a dyn Environment>,
    /// Length of their streams. All groups have the same number of steps.
    pub span: Span,
}

/// A predicted sensor.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PlannedSensor {
    /// The name.
    pub name: String,
    /// The state column.
    pub column: usize,
    /// Position of its group.
    pub group: usize,
}

impl SensorGroup<'_> {
    /// Returns the number of runs in all its environments.
    pub(super) fn runs(&self) -> usize {
        self.environments.iter().map(|environment| environment.runs()).sum()
    }

    /// Returns the streams that a race orders.
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
