//! Many rollouts through a model. One call takes a step of all of them.

use std::sync::Arc;

use calib_core::{Bounds, Normalised, Rng, Seed, TransitionIndex};
use pyo3::{prelude::*, types::PyTuple};
use serde::{Deserialize, Serialize};

use crate::{
    array::{copied, owned},
    errors,
    shared_model::SharedModel,
};

/// An observed column, in normalised units or in its own.
#[derive(Clone, Copy)]
pub(crate) struct SeenColumn {
    /// Its position in a state.
    pub(crate) position: usize,
    pub(crate) bounds: Bounds,
}

impl SeenColumn {
    /// Returns the column in its own units if `physical`, and normalised otherwise.
    pub(crate) fn new(position: usize, bounds: Bounds, physical: bool) -> Self {
        Self { position, bounds: if physical { bounds } else { Bounds::IDENTITY } }
    }

    /// Returns the observed value of a normalised state.
    pub(crate) fn value(self, state: &[f32]) -> f64 {
        self.bounds.physical(Normalised(state[self.position])).0
    }
}

/// A rollout: where it is, and its random numbers.
#[derive(Serialize, Deserialize)]
struct RolloutState {
    member: usize,
    at: TransitionIndex,
    rng: Rng,
    steps: u64,
    /// Whether the rollout is over. The next step then begins it again.
    over: bool,
    /// Distance from the state before to the recorded one that replaces it.
    distance: f32,
}

/// Rollouts through ensemble members of a model. They observe recorded rows, and no action changes them.
#[pyclass(module = "calib_rl._calib", name = "Walkers")]
pub(crate) struct PyRollouts {
    shared: Arc<SharedModel>,
    rollouts: Vec<RolloutState>,
    columns: Vec<SeenColumn>,
    reward: SeenColumn,
    /// Steps after which a rollout is over; 0 for no limit.
    most: u64,
}

impl PyRollouts {
    pub(crate) fn new(
        shared: Arc<SharedModel>,
        members: Vec<usize>,
        columns: Vec<SeenColumn>,
        reward: SeenColumn,
        most: u64,
    ) -> Self {
        let rollouts = members
            .into_iter()
            .enumerate()
            .map(|(number, member)| RolloutState {
                member,
                at: TransitionIndex(0),
                rng: rng(0, number),
                steps: 0,
                over: true,
                distance: 0.0,
            })
            .collect();
        Self { shared, rollouts, columns, reward, most }
    }

    /// Appends the observation of rollout `number` to `seen`. Returns its reward, row and time.
    fn look(&self, number: usize, seen: &mut Vec<f32>) -> (f64, i64, i64) {
        let row = self.shared.knn().transitions().next(self.rollouts[number].at).get();
        let state = self.shared.states().row(row);
        seen.extend(self.columns.iter().map(|column| column.value(state) as f32));
        (self.reward.value(state), row as i64, self.shared.time(row))
    }

    /// Returns the observations of all rollouts, in the order of [`step`](Self::step). A rollout that has just begun has no reward.
    fn arrays<'py>(&self, py: Python<'py>, begun: &[bool]) -> PyResult<Bound<'py, PyTuple>> {
        let count = self.rollouts.len();
        let mut seen = Vec::with_capacity(count * self.columns.len());
        let mut rewards = Vec::with_capacity(count);
        let mut rows = Vec::with_capacity(count);
        let mut times = Vec::with_capacity(count);
        for (number, begun) in begun.iter().enumerate() {
            let (reward, row, time) = self.look(number, &mut seen);
            rewards.push(if *begun { 0.0 } else { reward });
            rows.push(row);
            times.push(time);
        }
        self.shared.check(py)?;
        let over: Vec<bool> = self.rollouts.iter().map(|rollout| rollout.over).collect();
        let distances: Vec<f32> = self.rollouts.iter().map(|rollout| rollout.distance).collect();
        let arrays = [
            owned(py, seen, &[count, self.columns.len()])?,
            owned(py, rewards, &[count])?,
            owned(py, over, &[count])?,
            owned(py, rows, &[count])?,
            owned(py, times, &[count])?,
            owned(py, distances, &[count])?,
        ];
        PyTuple::new(py, arrays)
    }
}

/// Returns which of `count` rollouts are marked: all of them without `which`.
pub(crate) fn marked(which: Option<&Bound<'_, PyAny>>, count: usize) -> PyResult<Vec<bool>> {
    let which = match which {
        Some(which) => copied::<bool>(which, "which", &[1])?.0,
        None => vec![true; count],
    };
    require_each(which.len(), "marks", count)?;
    Ok(which)
}

/// Refuses a number of `what` that differs from the number of rollouts.
pub(crate) fn require_each(given: usize, what: &str, count: usize) -> PyResult<()> {
    if given == count {
        return Ok(());
    }
    Err(errors::value(format!("{given} {what} for {count} rollouts")))
}

/// Returns the random numbers of rollout `number`.
fn rng(seed: u64, number: usize) -> Rng {
    Seed::new(seed).child("environment").number(number as u64).rng()
}

impl RolloutState {
    fn begin(&mut self, shared: &SharedModel) {
        let member = shared.knn().member(self.member);
        self.at = member.nth(self.rng.below(member.len()));
        (self.steps, self.over, self.distance) = (0, false, 0.0);
    }

    fn step(&mut self, shared: &SharedModel, most: u64) {
        let (neighbors, distances) = shared.knn().member(self.member).neighbors(self.at);
        let drawn = shared.weights().draw(distances, &mut self.rng);
        self.at = TransitionIndex(neighbors[drawn]);
        self.distance = distances[drawn];
        self.steps += 1;
        self.over = most > 0 && self.steps >= most;
    }
}

#[pymethods]
impl PyRollouts {
    /// Returns the place of every rollout and its random numbers, as text.
    fn state(&self) -> PyResult<String> {
        serde_json::to_string(&self.rollouts).map_err(errors::unusable)
    }

    /// Restores the state of other rollouts through the same ensemble members.
    fn restore(&mut self, state: &str) -> PyResult<()> {
        let rollouts: Vec<RolloutState> = serde_json::from_str(state).map_err(errors::unusable)?;
        let transitions = self.shared.knn().transitions().len();
        let members = rollouts.iter().map(|rollout| rollout.member);
        if members.ne(self.rollouts.iter().map(|rollout| rollout.member))
            || rollouts.iter().any(|rollout| rollout.at.get() >= transitions)
        {
            return Err(errors::value("the state is of rollouts through another model"));
        }
        self.rollouts = rollouts;
        Ok(())
    }

    /// Seeds rollout i with `seeds[i]`, unless that is `None`.
    fn seed(&mut self, seeds: Vec<Option<u64>>) -> PyResult<()> {
        require_each(seeds.len(), "seeds", self.rollouts.len())?;
        for (rollout, seed) in self.rollouts.iter_mut().zip(seeds) {
            if let Some(seed) = seed {
                rollout.rng = rng(seed, 0);
            }
        }
        Ok(())
    }

    /// Begins all rollouts, or those where `which` is true. Returns their observations.
    #[pyo3(signature = (which=None))]
    fn reset<'py>(
        &mut self,
        py: Python<'py>,
        which: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyTuple>> {
        let which = marked(which, self.rollouts.len())?;
        for (rollout, _) in self.rollouts.iter_mut().zip(&which).filter(|(_, begins)| **begins) {
            rollout.begin(&self.shared);
        }
        self.arrays(py, &which)
    }

    /// Takes a step of every rollout. Returns observations `float32 [n, c]`, rewards `float64 [n]`, whether rollouts are over
    /// `bool [n]`, rows and times `int64 [n]`, and distances `float32 [n]`. A rollout that was over begins again, and has no
    /// reward for that step.
    fn step<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        let begun: Vec<bool> = self.rollouts.iter().map(|rollout| rollout.over).collect();
        let shared = Arc::clone(&self.shared);
        let most = self.most;
        for rollout in &mut self.rollouts {
            if rollout.over {
                rollout.begin(&shared);
            } else {
                rollout.step(&shared, most);
            }
        }
        self.arrays(py, &begun)
    }

    /// Takes a step of the first rollout alone. Returns its observation `float32 [c]`, reward, whether it is over,
    /// row, time and distance.
    fn step_one<'py>(
        &mut self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyAny>, f64, bool, i64, i64, f32)> {
        let shared = Arc::clone(&self.shared);
        let most = self.most;
        let Some(rollout) = self.rollouts.first_mut() else {
            return Err(errors::value("there is no rollout"));
        };
        rollout.step(&shared, most);
        let over = rollout.over;
        let distance = rollout.distance;
        let mut seen = Vec::with_capacity(self.columns.len());
        let (reward, row, time) = self.look(0, &mut seen);
        self.shared.check(py)?;
        let width = seen.len();
        Ok((owned(py, seen, &[width])?, reward, over, row, time, distance))
    }
}
