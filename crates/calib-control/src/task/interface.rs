use calib_core::Rng;

use crate::Outcome;

/// A fixed rule: returns the action for an observation, in the task's own units.
pub type Rule = fn(&[f64]) -> usize;

/// A simulated task: a state that actions change, and its observation.
pub trait Task: Clone + Send + Sync {
    /// Returns the name, the lowest and the highest value of each observed column. Observations may lie a little outside.
    fn columns() -> &'static [(&'static str, f64, f64)];

    /// Returns the names of the actions.
    fn actions() -> &'static [&'static str];

    /// Returns the columns of the actions in a log, and the value of each action in them.
    fn settings() -> Vec<(&'static str, Vec<f64>)> {
        vec![("action", (0..Self::actions().len()).map(|action| action as f64).collect())]
    }

    /// Returns the column of a continuous action, if there is one. [`log`](Self::log) adds the value that was really set, which is
    /// near that of the action.
    fn continuous() -> Option<&'static str> {
        None
    }

    /// Returns the columns that are logged beside the state, from which the reward is computed. Empty if the reward itself is logged.
    fn logged() -> &'static [&'static str] {
        &[]
    }

    /// Appends the logged values of the last step beside the state.
    fn log(&self, _logged: &mut Vec<f64>) {}

    /// Returns the operators' rule, if there is one.
    fn rule() -> Option<Rule> {
        None
    }

    /// Begins an episode in a start state of the task.
    fn start(&mut self, rng: &mut Rng);

    /// Begins an episode anywhere: in a state drawn from most possible ones, as in the log of a plant that saw many conditions.
    fn start_anywhere(&mut self, rng: &mut Rng);

    /// Writes the observation, in the task's own units.
    fn observe(&self, observed: &mut Vec<f64>);

    /// Takes `action`.
    fn step(&mut self, action: usize, rng: &mut Rng) -> Outcome;
}
