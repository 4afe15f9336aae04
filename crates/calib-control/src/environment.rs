//! What an agent acts in.

use calib_core::Rng;

/// What an action led to, beside the next state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outcome {
    /// The reward of the step.
    pub reward: f64,
    /// Whether the episode ends here.
    pub ending: Ending,
}

/// Whether an episode goes on.
///
/// The end of a log, and of a run that was cut after so many steps, is not an ending: what would have followed has a value, which
/// agents take from their estimate. After a terminal nothing follows, and the value is zero.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Ending {
    /// It does.
    #[default]
    Continues,
    /// Nothing follows.
    Terminal,
}

impl Ending {
    /// A terminal, or none.
    pub(crate) fn terminal_if(is_terminal: bool) -> Self {
        if is_terminal { Self::Terminal } else { Self::Continues }
    }
}

/// What an agent acts in: a simulator, or a model of a log. States are `f32 [columns]`, scaled to about 0 to 1 a column.
pub trait Environment {
    /// Number of actions.
    fn actions(&self) -> usize;

    /// Number of columns of a state.
    fn columns(&self) -> usize;

    /// Begin an episode: its first state is put in `state`.
    fn start(&mut self, rng: &mut Rng, state: &mut [f32]);

    /// Take `action`: the next state is put in `state`.
    fn step(&mut self, action: usize, rng: &mut Rng, state: &mut [f32]) -> Outcome;

    /// Add what a log has of the last step beside state and reward.
    fn log(&self, _logged: &mut Vec<f64>) {}
}
