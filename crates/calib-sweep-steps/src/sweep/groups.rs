//! Groups of sensors whose returns have the same discount factor. They are predicted on the same streams.

use std::mem;

use calib_base::{
    StepError,
    artefact::MANIFEST,
    log::{
        context::RunContext,
        partition::{self, Parts},
    },
    output::Printer,
};
use calib_data::Dataset;
use calib_study::{Job, Study};
use calib_sweep::{Candidate, PlannedSensor, Span};

use crate::sweep::{candidates::candidates_of, streams::Streams};

/// The predicted sensors of one discount factor.
pub struct StudyGroup {
    /// Their names, in the order of the study.
    pub sensors: Vec<String>,
    /// Every setting, with this discount factor.
    pub candidates: Vec<Candidate>,
    /// Length of their streams, and the windows of the log.
    pub streams: Streams,
}

impl StudyGroup {
    /// Returns the groups of a study (at least one), in the order of their first sensors.
    ///
    /// # Errors
    /// Fails as [`Streams::of`] does.
    pub(crate) fn all(
        study: &Study,
        dataset: &Dataset,
        candidates: &[Candidate],
        printer: &Printer,
    ) -> Result<Vec<Self>, StepError> {
        let mut groups: Vec<Self> = Vec::new();
        for gamma in study.gammas() {
            let streams = Streams::of(study, dataset, gamma)?;
            let sensors: Vec<String> = study.sensors_of(gamma).cloned().collect();
            let candidates = match sensors.first() {
                Some(sensor) => {
                    candidates.iter().map(|candidate| candidate.for_sensor(sensor)).collect()
                }
                None => candidates.to_vec(),
            };
            groups.push(Self { sensors, candidates, streams });
        }
        tell_once(&mut groups);
        for note in groups.iter().flat_map(|group| &group.streams.notes) {
            printer.warn(note);
        }
        Ok(groups)
    }

    /// Returns the span of the longest streams of these groups.
    pub(crate) fn longest(groups: &[Self]) -> Span {
        let spans = groups.iter().map(|group| group.streams.demand.span);
        spans.max_by_key(|span| span.states()).unwrap_or_else(|| unreachable!("at least one group"))
    }

    /// Returns those of `sensors` (name and column) that belong to the group.
    pub(crate) fn own(&self, sensors: &[(String, usize)]) -> Vec<(String, usize)> {
        sensors.iter().filter(|(sensor, _)| self.sensors.contains(sensor)).cloned().collect()
    }
}

/// Keeps a note that all groups share only in the first group. Other notes get their sensors as a prefix.
fn tell_once(groups: &mut [StudyGroup]) {
    let all: Vec<Vec<String>> = groups.iter().map(|group| group.streams.notes.clone()).collect();
    for (number, StudyGroup { sensors, streams, .. }) in groups.iter_mut().enumerate() {
        let own = mem::take(&mut streams.notes).into_iter().filter_map(|note| {
            if all.iter().all(|notes| notes.contains(&note)) {
                return (number == 0).then_some(note);
            }
            Some(format!("{}: {note}", sensors.join(", ")))
        });
        streams.notes = own.collect();
    }
}

/// Returns the `sensors` (name and column) as planned sensors, with the group that lists each name.
pub fn planned_sensors(sensors: &[(String, usize)], groups: &[&[String]]) -> Vec<PlannedSensor> {
    let planned = sensors.iter().map(|(name, column): &(String, usize)| {
        let group = groups.iter().position(|own| own.contains(name));
        PlannedSensor { name: name.clone(), column: *column, group: group.unwrap_or(0) }
    });
    planned.collect()
}

/// Refuses a study whose only held-out range cannot be scored, before a model is built. With several deployments, each
/// is checked later and left out by itself.
///
/// # Errors
/// Returns [`StepError::Unscorable`], or an error if the log cannot be read.
pub fn check(job: &Job, context: &RunContext) -> Result<(), StepError> {
    let study = job.study();
    if !study.deployments.is_empty() || job.layout().model().join(MANIFEST).exists() {
        return Ok(());
    }
    // Later steps repeat these messages.
    let silent = &context.silent();
    let Parts { dataset, .. } = partition::load(job, silent)?;
    let candidates = candidates_of(study)?;
    StudyGroup::all(study, &dataset, &candidates, silent).map(|_| ())
}
