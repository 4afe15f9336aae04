//! Environments in which agents act.

use calib_core::Rng;

/// The outcome of an action, without the next state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outcome {
    /// The reward of the step.
    pub reward: f64,
    /// Whether the episode ends here.
    pub ending: Ending,
}

/// Whether an episode continues.
///
/// The end of a log, or the cut of a run after so many steps, is not an ending: the state there still has a value, which agents
/// estimate. After a terminal nothing follows, and the value is zero.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Ending {
    /// The episode continues.
    #[default]
    Continues,
    /// The episode ends: nothing follows.
    Terminal,
}

impl Ending {
    /// Returns `Terminal` if `is_terminal`, and `Continues` otherwise.
    pub(crate) fn terminal_if(is_terminal: bool) -> Self {
        if is_terminal { Self::Terminal } else { Self::Continues }
    }

    /// Returns how the step to each of `rows` rows ends, by the column of terminals. Without that column every step continues.
    pub(crate) fn of_rows(terminal: Option<&[f64]>, rows: usize) -> Vec<Self> {
        let Some(terminal) = terminal else { return vec![Self::Continues; rows] };
        let values = terminal.iter();
        values.map(|&value| Self::terminal_if(value != 0.0 && !value.is_nan())).collect()
    }
}

/// An environment in which an agent acts: a simulator, or a model of a log. States are `f32 [columns]`, each column
/// scaled to about 0 to 1.
pub trait Environment {
    /// Returns the number of actions.
    fn actions(&self) -> usize;

    /// Returns the number of columns of a state.
    fn columns(&self) -> usize;

    /// Begins an episode, and writes its first state to `state`.
    fn start(&mut self, rng: &mut Rng, state: &mut [f32]);

    /// Takes `action`, and writes the next state to `state`.
    fn step(&mut self, action: usize, rng: &mut Rng, state: &mut [f32]) -> Outcome;

    /// Appends the logged values of the last step, beside state and reward.
    fn log(&self, _logged: &mut Vec<f64>) {}
}
