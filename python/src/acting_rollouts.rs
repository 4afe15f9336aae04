//! Many rollouts through a model with actions. One call takes a step of all of them.

use std::sync::Arc;

use calib_control::{ActionRollouts, At, Coverage, Drift, RolloutStep, Rules, Target};
use pyo3::{prelude::*, types::PyTuple};
use serde::{Deserialize, Serialize};

use crate::{
    array::{copied, owned},
    errors,
    rollouts::{SeenColumn, marked, require_each},
    shared_action_model::SharedActionModel,
};

/// Rollouts through ensemble members of a model, controlled by actions.
#[pyclass(module = "calib_rl._calib", name = "ActionWalkers")]
pub(crate) struct PyActionRollouts {
    pub(crate) shared: Arc<SharedActionModel>,
    pub(crate) rollouts: ActionRollouts,
    pub(crate) columns: Vec<SeenColumn>,
    pub(crate) rules: Rules,
    /// Steps after which an episode is cut; 0 for no limit.
    pub(crate) timeout: u64,
    /// Whether each step searches for the neighbours of the settings.
    pub(crate) live: bool,
}

/// Coverage and drift of all rollouts' steps, as JSON.
#[derive(Serialize, Deserialize)]
struct Lived {
    coverage: Coverage,
    drift: Drift,
}

/// The actions of all rollouts in a step.
enum Done {
    Levels(Vec<i64>),
    /// Settings `[rollouts, columns]`, each as a share of its recorded range, and the number of columns.
    Set(Vec<f32>, usize),
}

impl Done {
    /// Returns the action of rollout `number`.
    fn target(&self, number: usize) -> Target<'_> {
        match self {
            Self::Levels(levels) => Target::Level(levels[number] as usize),
            Self::Set(set, columns) => Target::Set(&set[number * columns..][..*columns]),
        }
    }
}

impl PyActionRollouts {
    /// Returns the row that rollout `number` observes.
    fn row(&self, number: usize) -> i64 {
        let opened = &self.shared.opened;
        match self.rollouts.all()[number].at {
            At::Start(start) => i64::from(opened.start_rows[start as usize]),
            At::After(transition) => i64::from(opened.model.led_to(transition).0),
        }
    }

    fn look(&self, number: usize, seen: &mut Vec<f32>, displaced: &mut Vec<f32>) {
        let state = self.rollouts.observed(&self.shared.opened.model, number);
        let width = state.len();
        let moved = &self.rollouts.displacements()[number * width..][..width];
        for column in &self.columns {
            seen.push(column.value(state) as f32);
            displaced.push((f64::from(moved[column.position]) * column.bounds.scale) as f32);
        }
    }

    /// Returns the observations of all rollouts after their steps, in the order of [`step`](Self::step).
    fn arrays<'py>(&self, py: Python<'py>, steps: &[RolloutStep]) -> PyResult<Bound<'py, PyTuple>> {
        let count = steps.len();
        let width = self.columns.len();
        let mut seen = Vec::with_capacity(count * width);
        let mut displaced = Vec::with_capacity(count * width);
        let mut rows = Vec::with_capacity(count);
        let mut times = Vec::with_capacity(count);
        for number in 0..count {
            self.look(number, &mut seen, &mut displaced);
            let row = self.row(number);
            rows.push(row);
            times.push(self.shared.opened.times[row as usize]);
        }
        self.shared.lost_pages.check(py)?;
        let arrays = [
            owned(py, seen, &[count, width])?,
            owned(py, steps.iter().map(|step| step.reward).collect::<Vec<f64>>(), &[count])?,
            owned(py, steps.iter().map(|step| step.terminated).collect::<Vec<bool>>(), &[count])?,
            owned(py, steps.iter().map(|step| step.truncated).collect::<Vec<bool>>(), &[count])?,
            owned(py, rows, &[count])?,
            owned(py, times, &[count])?,
            owned(py, steps.iter().map(|step| step.distance).collect::<Vec<f32>>(), &[count])?,
            owned(py, steps.iter().map(|step| step.covered).collect::<Vec<bool>>(), &[count])?,
            owned(py, displaced, &[count, width])?,
        ];
        PyTuple::new(py, arrays)
    }

    /// Converts `actions` for `count` rollouts.
    fn done(&self, actions: &Bound<'_, PyAny>, count: usize) -> PyResult<Done> {
        if self.live {
            return self.set(actions, count);
        }
        let (levels, _) = copied::<i64>(actions, "actions", &[1])?;
        require_each(levels.len(), "actions", count)?;
        levels.iter().enumerate().try_for_each(|(number, &level)| self.check(number, level))?;
        Ok(Done::Levels(levels))
    }

    fn check(&self, number: usize, level: i64) -> PyResult<()> {
        let known = self.shared.opened.model.log().levels();
        if (0..known as i64).contains(&level) {
            return Ok(());
        }
        Err(errors::value(format!(
            "rollout {number} takes action {level}; the model has {known}, from 0 to {}",
            known - 1
        )))
    }

    fn set(&self, actions: &Bound<'_, PyAny>, count: usize) -> PyResult<Done> {
        let ranges = &self.shared.opened.names.ranges;
        let (values, shape) = copied::<f64>(actions, "actions", &[2])?;
        if shape != [count, ranges.len()] {
            return Err(errors::value(format!(
                "actions have the shape {shape:?}, expected [{count}, {}]",
                ranges.len()
            )));
        }
        let shares = values
            .iter()
            .enumerate()
            .map(|(place, &value)| {
                let [low, high] = ranges[place % ranges.len()];
                if !value.is_finite() {
                    let number = place / ranges.len();
                    return Err(errors::value(format!(
                        "rollout {number} sets {value}, which is no number"
                    )));
                }
                let range = if high > low { high - low } else { 1.0 };
                Ok(((value.clamp(low, high) - low) / range) as f32)
            })
            .collect::<PyResult<_>>()?;
        Ok(Done::Set(shares, ranges.len()))
    }
}

#[pymethods]
impl PyActionRollouts {
    /// Returns the place of every rollout and its random numbers, as text.
    fn state(&self) -> PyResult<String> {
        serde_json::to_string(&self.rollouts).map_err(errors::unusable)
    }

    /// Restores the state of other rollouts through the same ensemble members.
    fn restore(&mut self, state: &str) -> PyResult<()> {
        let rollouts: ActionRollouts = serde_json::from_str(state).map_err(errors::unusable)?;
        let restored = rollouts.restored(&self.shared.opened.model, &self.rollouts);
        self.rollouts = restored
            .ok_or_else(|| errors::value("the state is of rollouts through another model"))?;
        Ok(())
    }

    /// Seeds rollout i with `seeds[i]`, unless that is `None`.
    fn seed(&mut self, seeds: Vec<Option<u64>>) -> PyResult<()> {
        require_each(seeds.len(), "seeds", self.rollouts.all().len())?;
        for (number, seed) in seeds.into_iter().enumerate() {
            if let Some(seed) = seed {
                self.rollouts.seed(number, seed);
            }
        }
        Ok(())
    }

    /// Returns coverage and drift of all steps so far, as JSON.
    fn lived(&self) -> PyResult<String> {
        let coverage = self.rollouts.coverage();
        let drift = self.rollouts.drift();
        let lived = Lived { coverage, drift };
        serde_json::to_string(&lived).map_err(errors::unusable)
    }

    /// Begins episodes of all rollouts, or of those where `which` is true. Returns the arrays of `step`.
    #[pyo3(signature = (which=None))]
    fn reset<'py>(
        &mut self,
        py: Python<'py>,
        which: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyTuple>> {
        let count = self.rollouts.all().len();
        let which = marked(which, count)?;
        let model = Arc::clone(&self.shared.opened.model);
        let mut steps = vec![RolloutStep::BEGAN; count];
        for (number, _) in which.iter().enumerate().filter(|(_, begins)| **begins) {
            steps[number] = self.rollouts.begin(&model, number);
        }
        self.arrays(py, &steps)
    }

    /// Takes a step of every rollout. Returns observations `float32 [n, c]`, rewards `float64 [n]`, whether episodes ended in a terminal and
    /// whether they were cut `bool [n]`, rows and times `int64 [n]`, distances `float32 [n]`, whether the step was covered `bool [n]`, and
    /// displacements `float32 [n, c]`. A rollout whose episode was over begins another one, and has no reward for that step.
    fn step<'py>(
        &mut self,
        py: Python<'py>,
        actions: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyTuple>> {
        let count = self.rollouts.all().len();
        let done = self.done(actions, count)?;
        let model = Arc::clone(&self.shared.opened.model);
        let rules = self.rules;
        let timeout = self.timeout;
        let rollouts = &mut self.rollouts;
        let steps: Vec<RolloutStep> = (0..count)
            .map(|number: usize| rollouts.step(&model, number, done.target(number), rules, timeout))
            .collect();
        self.arrays(py, &steps)
    }

    /// Takes a step of the only rollout, with a level. Returns observation, reward, terminated, truncated, row, time, distance, covered
    /// and displacement.
    #[expect(clippy::type_complexity, reason = "what a step has")]
    fn step_one<'py>(
        &mut self,
        py: Python<'py>,
        level: i64,
    ) -> PyResult<(Bound<'py, PyAny>, f64, bool, bool, i64, i64, f32, bool, Bound<'py, PyAny>)>
    {
        self.check(0, level)?;
        let model = Arc::clone(&self.shared.opened.model);
        let target = Target::Level(level as usize);
        let step = self.rollouts.step(&model, 0, target, self.rules, self.timeout);
        let width = self.columns.len();
        let mut seen = Vec::with_capacity(width);
        let mut displaced = Vec::with_capacity(width);
        self.look(0, &mut seen, &mut displaced);
        let row = self.row(0);
        self.shared.lost_pages.check(py)?;
        let RolloutStep { reward, terminated, truncated, distance, covered } = step;
        let time = self.shared.opened.times[row as usize];
        let seen = owned(py, seen, &[width])?;
        let displaced = owned(py, displaced, &[width])?;
        Ok((seen, reward, terminated, truncated, row, time, distance, covered, displaced))
    }
}
