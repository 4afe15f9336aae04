use calib_core::{Seed, Stream};

use crate::{
    AgentError, Learner, Run, RunOutcome,
    outcome::Tracker,
    population::{Task, Truth},
    replay::Replay,
    traces::with_traces,
};

/// One run of a cohort: its input, and its results so far.
pub(super) struct BatchSlot<'a> {
    /// The run's stream, with traces if the learners have them.
    seen: Box<dyn Stream + 'a>,
    pub(super) seed: Seed,
    truth: Truth<'a>,
    /// The steps of the run, and whether their returns are known.
    course: Vec<(usize, bool)>,
    replay: Option<Replay>,
    trackers: Vec<Tracker>,
    /// The last step of the run.
    last: usize,
}

/// The position of one update of a network in its run.
#[derive(Clone, Copy)]
pub(super) struct StepRecord {
    /// The step of the run.
    pub(super) at: usize,
    /// The number of the update in its step.
    pub(super) update: usize,
    pub(super) learnt: bool,
}

impl<'a> BatchSlot<'a> {
    /// Returns the run of learners that can share a population.
    pub(super) fn new(run: &Run<'a>, learners: &[Learner<'a>]) -> Result<Self, AgentError> {
        let Run { stream, steps, curve, seed } = *run;
        let shared = learners[0].config;
        let seen = with_traces(stream, &shared.traces);
        let task = Task { stream: &*seen, steps, seed };
        let truth = Truth::new(task, learners)?;
        let course = task.course(shared.gamma).collect();
        let replay = Replay::of_agent(shared, seed, steps);
        let trackers = vec![Tracker::new(curve, steps); learners.len()];
        let last = steps.saturating_sub(1);
        Ok(Self { seen, seed, truth, course, replay, trackers, last })
    }

    pub(super) fn stream(&self) -> &dyn Stream {
        &*self.seen
    }

    pub(super) fn len(&self) -> usize {
        self.course.len()
    }

    /// Returns the number of states that its steps see, from the first one on.
    pub(super) fn states(&self) -> usize {
        // The state after the last step is also learned from.
        self.course.last().map_or(0, |&(t, _)| t + 2)
    }

    /// Returns the present state of its next step, `at`. Appends the starts of the `batch` transitions of each of its
    /// updates to `to`, one update after the other. A finished run repeats its first state, and the results are
    /// ignored.
    pub(super) fn next(
        &mut self,
        at: usize,
        updates: usize,
        batch: usize,
        to: &mut Vec<u32>,
    ) -> u32 {
        let Some(&(t, _)) = self.course.get(at) else {
            to.resize(to.len() + updates * batch, 0);
            return 0;
        };
        let mut starts = vec![t; batch];
        if let Some(replay) = &mut self.replay {
            replay.push(t);
        }
        for update in 0..updates {
            if let Some(replay) = &self.replay {
                replay.draw(t, update, &mut starts);
            }
            to.extend(starts.iter().map(|&start| start as u32));
        }
        t as u32
    }

    /// Records the prediction of each learner, and whether it diverged.
    pub(super) fn settle(&mut self, did: StepRecord, predictions: &[f32], finite: &[bool]) {
        let Some(&(t, known)) = self.course.get(did.at) else { return };
        for (learner, tracker) in self.trackers.iter_mut().enumerate() {
            if tracker.diverged.is_some() {
                continue;
            }
            tracker.updates += u64::from(did.learnt);
            let prediction = (did.update == 0).then_some(predictions[learner]);
            if let Some(prediction) = prediction.filter(|value| known && value.is_finite()) {
                tracker.record(t, prediction, self.truth.of(learner, t));
            }
            if !finite[learner] || prediction.is_some_and(|value| !value.is_finite()) {
                tracker.diverged = Some(t);
            }
        }
    }

    /// Marks learners with a parameter that is not finite at the end as diverged.
    pub(super) fn end(&mut self, finite: &[bool]) {
        for (tracker, _) in self.trackers.iter_mut().zip(finite).filter(|(_, finite)| !**finite) {
            tracker.diverged.get_or_insert(self.last);
        }
    }

    pub(super) fn outcomes(self) -> Vec<RunOutcome> {
        let Self { trackers, truth, .. } = self;
        trackers
            .into_iter()
            .enumerate()
            .map(|(learner, tracker)| tracker.outcome(|part| truth.scored(learner, part)))
            .collect()
    }
}
