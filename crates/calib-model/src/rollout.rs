use calib_core::{Monitor, RowIndex, RowStream, Seed, States, TransitionIndex};
use calib_knn::{Member, Weights};
use rayon::prelude::*;

use crate::{RolloutError, Start, StartState};

/// Steps between two checks of the monitor.
const BATCH: usize = 1 << 14;

/// A trajectory of the model: recorded rows, in the order in which the model visits them.
///
/// From transition `i` a step draws `j` among its neighbours, emits `s'_j` and continues from `j` (the paper).
/// So `rows[0]` is the start state, `rows[t + 1]` is the next row of `transitions[t]`, and a rollout of `steps`
/// steps has `steps + 1` states. It cannot leave the data: it is a list of rows.
#[derive(Clone, Debug, PartialEq)]
pub struct Rollout {
    rows: Vec<RowIndex>,
    transitions: Vec<TransitionIndex>,
    start: StartState,
}

impl Rollout {
    /// Returns the rows of the trajectory, one more than there are steps.
    pub fn rows(&self) -> &[RowIndex] {
        &self.rows
    }

    /// Returns the transition drawn in each step.
    pub fn transitions(&self) -> &[TransitionIndex] {
        &self.transitions
    }

    /// Returns the number of steps.
    pub fn steps(&self) -> usize {
        self.transitions.len()
    }

    /// Returns the start state.
    pub fn start(&self) -> &StartState {
        &self.start
    }

    /// Returns the trajectory as a stream for an agent, in one unbroken piece.
    ///
    /// `states` are the normalised states of the data. Distances may have been measured in others.
    ///
    /// # Panics
    /// If `states` lacks a row of the trajectory.
    pub fn stream(&self, states: &States) -> RowStream {
        RowStream::unbroken(states.clone(), self.rows.clone())
    }
}

/// Makes a rollout of `member` for `steps` steps: a pure function of its arguments.
///
/// Weights other than [`Weights::Softmax`] use exactly rounded arithmetic only, so the trajectory is the same on
/// every machine.
///
/// # Panics
/// If the start is not one of the member's.
pub fn rollout(
    member: &Member<'_>,
    start: &StartState,
    steps: usize,
    weights: Weights,
    seed: Seed,
) -> Rollout {
    let mut rollout = RolloutInProgress::new(member, start, steps, seed);
    rollout.advance(steps, weights);
    rollout.made
}

/// Returns the seed of rollout `number` of member `member`, on any machine or thread.
pub fn rollout_seed(seed: Seed, member: usize, number: usize) -> Seed {
    seed.child("member").number(member as u64).child("rollout").number(number as u64)
}

/// Makes one rollout from each start state, in parallel; rollout `r` is seeded by [`rollout_seed`].
///
/// Progress counts steps.
///
/// # Errors
/// [`RolloutError::Cancelled`] if the monitor interrupts.
pub fn rollouts(
    member: &Member<'_>,
    starts: &[StartState],
    steps: usize,
    weights: Weights,
    seed: Seed,
    monitor: &dyn Monitor,
) -> Result<Vec<Rollout>, RolloutError> {
    monitor.begin("rollouts", starts.len() as u64 * steps as u64);
    starts
        .par_iter()
        .enumerate()
        .map(|(number, start)| {
            let seed = rollout_seed(seed, member.number(), number);
            let mut rollout = RolloutInProgress::new(member, start, steps, seed);
            for done in (0..steps).step_by(BATCH) {
                monitor.check()?;
                let batch = BATCH.min(steps - done);
                rollout.advance(batch, weights);
                monitor.advance(batch as u64);
            }
            Ok(rollout.made)
        })
        .collect()
}

/// A rollout in progress.
struct RolloutInProgress<'a> {
    member: &'a Member<'a>,
    rng: calib_core::Rng,
    /// The steps made so far.
    made: Rollout,
}

impl<'a> RolloutInProgress<'a> {
    fn new(member: &'a Member<'a>, start: &StartState, steps: usize, seed: Seed) -> Self {
        let mut rows = Vec::with_capacity(steps + 1);
        rows.push(match &start.start {
            Start::At(transition) => member.model().transitions().next(*transition),
            Start::External { row, .. } => *row,
        });
        let transitions = Vec::with_capacity(steps);
        Self { member, rng: seed.rng(), made: Rollout { rows, transitions, start: start.clone() } }
    }

    fn advance(&mut self, steps: usize, weights: Weights) {
        let Rollout { rows, transitions, start, .. } = &mut self.made;
        let recorded = self.member.model().transitions();
        for _ in 0..steps {
            let drawn = match (transitions.last(), &start.start) {
                (Some(&current), _) | (None, &Start::At(current)) => {
                    self.member.draw(current, weights, &mut self.rng)
                }
                (None, Start::External { neighbors, .. }) => {
                    let distances: Vec<f32> = neighbors.iter().map(|near| near.distance).collect();
                    neighbors[weights.draw(&distances, &mut self.rng)].transition
                }
            };
            transitions.push(drawn);
            rows.push(recorded.next(drawn));
        }
    }
}
