use calib_core::Rng;

use super::Task;
use crate::{Environment, Outcome};

/// A task as an environment. Its states are observations, with each column scaled from its range to 0
/// to 1.
#[derive(Clone, Debug)]
pub struct Simulated<T> {
    /// The task.
    pub task: T,
    begin: Begin,
    observed: Vec<f64>,
}

/// The choice of start states.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Begin {
    /// The start states of the task.
    AsTheTask,
    /// Any state, as in a log that saw many conditions.
    Anywhere,
}

impl<T: Task> Simulated<T> {
    /// Returns the task with this choice of start states.
    pub fn new(task: T, begin: Begin) -> Self {
        Self { task, begin, observed: Vec::new() }
    }

    /// Writes the scaled observation to `state`.
    fn observe(&mut self, state: &mut [f32]) {
        self.task.observe(&mut self.observed);
        for ((scaled, value), (_, low, high)) in
            state.iter_mut().zip(&self.observed).zip(T::columns())
        {
            *scaled = ((value - low) / (high - low)) as f32;
        }
    }
}

impl<T: Task> Environment for Simulated<T> {
    fn actions(&self) -> usize {
        T::actions().len()
    }

    fn columns(&self) -> usize {
        T::columns().len()
    }

    fn start(&mut self, rng: &mut Rng, state: &mut [f32]) {
        match self.begin {
            Begin::AsTheTask => self.task.start(rng),
            Begin::Anywhere => self.task.start_anywhere(rng),
        }
        self.observe(state);
    }

    fn step(&mut self, action: usize, rng: &mut Rng, state: &mut [f32]) -> Outcome {
        let outcome = self.task.step(action, rng);
        self.observe(state);
        outcome
    }

    fn log(&self, logged: &mut Vec<f64>) {
        self.task.log(logged);
    }
}
