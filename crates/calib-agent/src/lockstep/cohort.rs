use std::ops::Range;

use calib_nn::Mlp;
use rayon::prelude::*;

use super::batch_slot::{BatchSlot, StepRecord};
use crate::{
    Accelerator, AgentError, Learner, Lockstep, LockstepResults, Networks, ReplayKind, Run,
    RunOutcome, Steps, layer_sizes, values::parameter_seed,
};

/// Updates that an accelerator makes before their results are inspected.
const UPDATES: usize = 32;

/// Runs of the same learners, which can share a population. They pass through their streams in lockstep.
pub(super) struct Cohort<'a> {
    learners: &'a [Learner<'a>],
    seats: Vec<BatchSlot<'a>>,
    /// Number of updates per step.
    updates: usize,
    /// Number of transitions per update.
    batch: usize,
}

impl<'a> Cohort<'a> {
    pub(super) fn new(runs: &[Run<'a>], learners: &'a [Learner<'a>]) -> Result<Self, AgentError> {
        let shared = learners[0].config;
        let seats = runs.par_iter().map(|run| BatchSlot::new(run, learners));
        let seats = seats.collect::<Result<_, _>>()?;
        let updates = shared.updates_per_step;
        let batch = shared.transitions_per_update();
        Ok(Self { learners, seats, updates, batch })
    }

    /// Trains to the end of the longest run. `look` receives the completed share, and may end the training.
    pub(super) fn train(
        &mut self,
        accelerator: &dyn Accelerator,
        mut look: impl FnMut(f64) -> Result<(), AgentError>,
    ) -> Result<(), AgentError> {
        let longest = self.seats.iter().map(BatchSlot::len).max().unwrap_or(0);
        if longest == 0 {
            return Ok(());
        }
        let mut networks = self.networks(accelerator)?;
        let mut at = 0;
        while at < longest {
            look(at as f64 / longest as f64)?;
            let chunk = at..self.end_of_chunk(at);
            at = chunk.end;
            let updates = if self.learns_at(chunk.start) { self.updates } else { 0 };
            let made = networks.make(&self.steps(chunk.clone(), updates))?;
            self.settle(chunk, updates, &made);
            if self.seats.iter().any(|seat| seat.len() == at) {
                let finite = networks.finite()?;
                let seats = self.seats.iter_mut().zip(finite.chunks(self.learners.len()));
                seats
                    .filter(|(seat, _)| seat.len() == at)
                    .for_each(|(seat, is_finite)| seat.end(is_finite));
            }
        }
        Ok(())
    }

    pub(super) fn outcomes(self) -> impl Iterator<Item = Vec<RunOutcome>> {
        self.seats.into_iter().map(BatchSlot::outcomes)
    }

    /// Creates the networks in their initial state.
    fn networks(&self, accelerator: &dyn Accelerator) -> Result<Box<dyn Lockstep>, AgentError> {
        let width = self.seats[0].stream().width();
        let sizes = layer_sizes(self.learners[0].config, width);
        let rows = self.seats.iter().map(BatchSlot::states).max().unwrap_or(0);
        let mut states = vec![0.0; self.seats.len() * rows * width];
        let parts = states.par_chunks_exact_mut((rows * width).max(1));
        parts.zip(&self.seats).for_each(|(to, seat)| {
            for (t, to) in to.chunks_exact_mut(width).enumerate().take(seat.states()) {
                to.copy_from_slice(seat.stream().state(t));
            }
        });
        let parameters = self
            .seats
            .iter()
            .map(|seat| Mlp::new(&sizes, parameter_seed(seat.seed)).parameters().to_vec())
            .collect();
        let learners = self.learners;
        let batch = self.batch;
        accelerator.networks(&Networks { sizes, learners, parameters, states, batch })
    }

    /// Whether the `at`-th step of a run learns: from then on there are enough transitions.
    fn learns_at(&self, at: usize) -> bool {
        self.learners[0].config.replay == ReplayKind::None || at + 1 >= self.batch
    }

    /// Returns the end of the steps that are made together. Either all of them learn or none does, and no run ends
    /// among them.
    fn end_of_chunk(&self, at: usize) -> usize {
        let ends = self.seats.iter().map(BatchSlot::len).filter(|&end| end > at);
        let enough = at + (UPDATES / self.updates).max(1);
        let end = ends.min().unwrap_or(enough).min(enough);
        if self.learns_at(at) { end } else { end.min(self.batch - 1) }
    }

    /// Returns the inputs of the networks for these steps, with `updates` updates per step.
    fn steps(&mut self, chunk: Range<usize>, updates: usize) -> Steps {
        let batch = self.batch;
        let of_seats: Vec<(Vec<u32>, Vec<u32>)> = self
            .seats
            .par_iter_mut()
            .map(|seat| {
                let mut starts = Vec::with_capacity(chunk.len() * updates * batch);
                let present = chunk.clone().map(|at| seat.next(at, updates, batch, &mut starts));
                (present.collect(), starts)
            })
            .collect();
        let mut steps = Steps::default();
        let made = updates.max(1);
        for number in 0..chunk.len() * made {
            for (present, starts) in &of_seats {
                steps.present.push(present[number / made]);
                if updates > 0 {
                    steps.starts.extend_from_slice(&starts[number * batch..][..batch]);
                }
            }
        }
        steps
    }

    /// Records the results of these steps.
    fn settle(&mut self, chunk: Range<usize>, updates: usize, made: &LockstepResults) {
        let of_step = updates.max(1);
        let learners = self.learners.len();
        let runs = self.seats.len();
        for number in 0..chunk.len() * of_step {
            let did = StepRecord {
                at: chunk.start + number / of_step,
                update: number % of_step,
                learnt: updates > 0,
            };
            for (run, seat) in self.seats.iter_mut().enumerate() {
                let own = (number * runs + run) * learners;
                let own = own..own + learners;
                seat.settle(did, &made.predictions[own.clone()], &made.finite[own]);
            }
        }
    }
}
