//! Records the last steps of an agent's run.

use calib_core::{Monitor, Rng, Seed};

use crate::{
    ActingAgents, AgentRun, At, ControlError, Ensemble, Environment, ModelEnvironment, Outcome,
    RunLength, sweep::run_seed,
};

/// The last steps of an agent's run, in order.
#[derive(Clone, Debug, PartialEq)]
pub struct Trajectory {
    /// The whole run.
    pub run: AgentRun,
    /// Columns of a state.
    pub columns: usize,
    /// States in which actions were taken, `[steps, columns]`.
    pub states: Vec<f32>,
    /// The recorded places of these states; empty if the model makes states that were not recorded.
    pub places: Vec<At>,
    /// The action of each step.
    pub actions: Vec<usize>,
    /// The reward of each step.
    pub rewards: Vec<f64>,
    /// Whether an episode begins with each step.
    pub begins: Vec<bool>,
}

/// Repeats the first run of `candidate` in the first ensemble member of `model`, as [`sweep`](crate::sweep) made it, and keeps its last
/// `kept` steps.
///
/// # Errors
/// If the monitor interrupts, or the agent cannot continue.
pub fn trajectory<M: Ensemble, A: ActingAgents + ?Sized>(
    model: &M,
    agents: &A,
    candidate: usize,
    span: RunLength,
    kept: usize,
    seed: Seed,
    monitor: &dyn Monitor,
) -> Result<Trajectory, ControlError> {
    let mut rollout = model.rollout(0);
    let mut recorded = Recorded {
        left_out: span.steps.saturating_sub(kept),
        state: vec![0.0; rollout.columns()],
        is_first: true,
        environment: &mut rollout,
        states: Vec::new(),
        places: Vec::new(),
        actions: Vec::new(),
        rewards: Vec::new(),
        begins: Vec::new(),
    };
    let seed = run_seed(seed, 0, 0);
    let run = agents.run(candidate, &mut recorded, span, seed, monitor)?;
    let Recorded { states, places, actions, rewards, begins, environment, .. } = recorded;
    Ok(Trajectory { run, columns: environment.columns(), states, places, actions, rewards, begins })
}

/// An environment that records its steps.
struct Recorded<'e, E> {
    environment: &'e mut E,
    /// Number of steps before the first one that is kept.
    left_out: usize,
    /// The present state, and whether an episode begins with it.
    state: Vec<f32>,
    is_first: bool,
    states: Vec<f32>,
    places: Vec<At>,
    actions: Vec<usize>,
    rewards: Vec<f64>,
    begins: Vec<bool>,
}

impl<E: ModelEnvironment> Environment for Recorded<'_, E> {
    fn actions(&self) -> usize {
        self.environment.actions()
    }

    fn columns(&self) -> usize {
        self.environment.columns()
    }

    fn start(&mut self, rng: &mut Rng, state: &mut [f32]) {
        self.environment.start(rng, state);
        self.state.copy_from_slice(state);
        self.is_first = true;
    }

    fn step(&mut self, action: usize, rng: &mut Rng, state: &mut [f32]) -> Outcome {
        let place = self.environment.place();
        let outcome = self.environment.step(action, rng, state);
        if self.left_out == 0 {
            self.states.extend_from_slice(&self.state);
            self.places.extend(place);
            self.actions.push(action);
            self.rewards.push(outcome.reward);
            self.begins.push(self.is_first);
        } else {
            self.left_out -= 1;
        }
        self.state.copy_from_slice(state);
        self.is_first = false;
        outcome
    }
}
