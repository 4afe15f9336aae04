//! Runs an agent in an environment.

use calib_core::{Rng, Seed};

use crate::{Agent, Ending, Environment, Outcome};

/// The length of a run, and the timeout of its episodes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RunLength {
    /// Number of steps in the run.
    pub steps: usize,
    /// Steps after which an episode is cut.
    pub timeout: usize,
}

/// The result of an agent's run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AgentRun {
    /// Return of each episode that ended or was cut at its timeout, in order.
    pub returns: Vec<f64>,
    /// Number of them that ended in a terminal.
    pub terminals: usize,
    /// Total reward of the unfinished last episode.
    pub rest: f64,
    /// Steps of that episode, as a share of the timeout.
    pub rest_share: f64,
    /// Whether the agent's values became infinite or NaN.
    pub diverged: bool,
}

impl AgentRun {
    /// Returns the mean return per episode: Σ of all rewards / (episodes + the share of the last one), with a denominator
    /// of at least 1. It is −∞ if the agent diverged.
    pub fn mean_return(&self) -> f64 {
        if self.diverged {
            return f64::NEG_INFINITY;
        }
        let episodes = (self.returns.len() as f64 + self.rest_share).max(1.0);
        (self.returns.iter().sum::<f64>() + self.rest) / episodes
    }
}

/// An agent or a policy that acts in an environment.
pub trait Actor {
    /// Starts an episode in `state`.
    fn look(&mut self, state: &[f32]);

    /// Draws an action in the present state. Returns `None` if the agent has diverged.
    fn act(&mut self, rng: &mut Rng) -> Option<usize>;

    /// Learns from the outcome of `action`, and moves to `next`.
    fn learn(&mut self, action: usize, outcome: Outcome, next: &[f32]);
}

impl Actor for Agent {
    fn look(&mut self, state: &[f32]) {
        Self::look(self, state);
    }

    fn act(&mut self, rng: &mut Rng) -> Option<usize> {
        Self::act(self, rng)
    }

    fn learn(&mut self, action: usize, outcome: Outcome, next: &[f32]) {
        Self::learn(self, action, outcome, next);
    }
}

/// Lets `agent` act and learn in `environment` for `span`. The agent and the environment have separate random numbers, both
/// from `seed`.
pub fn run_agent(
    agent: &mut impl Actor,
    environment: &mut dyn Environment,
    span: RunLength,
    seed: Seed,
) -> AgentRun {
    let mut episodes = Episodes::new(environment, span, seed);
    while episodes.step(agent, environment) {}
    episodes.run
}

/// A run of an agent, one step at a time.
pub(crate) struct Episodes {
    /// The run so far.
    pub(crate) run: AgentRun,
    span: RunLength,
    action_rng: Rng,
    environment_rng: Rng,
    state: Vec<f32>,
    done: usize,
    /// Steps and reward of the present episode.
    length: usize,
    reward: f64,
    /// Whether the last step ended an episode, in a terminal or at its timeout.
    pub(crate) over: bool,
}

impl Episodes {
    pub(crate) fn new(environment: &dyn Environment, span: RunLength, seed: Seed) -> Self {
        Self {
            run: AgentRun::default(),
            span,
            action_rng: seed.child("actions").rng(),
            environment_rng: seed.child("world").rng(),
            state: vec![0.0; environment.columns()],
            done: 0,
            length: 0,
            reward: 0.0,
            over: false,
        }
    }

    /// Begins an episode if there is no unfinished one.
    pub(crate) fn begin(&mut self, agent: &mut impl Actor, environment: &mut dyn Environment) {
        if self.length == 0 {
            environment.start(&mut self.environment_rng, &mut self.state);
            agent.look(&self.state);
        }
    }

    /// Takes a step. Returns whether there was one left to take.
    pub(crate) fn step(
        &mut self,
        agent: &mut impl Actor,
        environment: &mut dyn Environment,
    ) -> bool {
        if self.done >= self.span.steps || self.run.diverged {
            return false;
        }
        self.begin(agent, environment);
        let Some(action) = agent.act(&mut self.action_rng) else {
            self.run.diverged = true;
            return false;
        };
        let outcome = environment.step(action, &mut self.environment_rng, &mut self.state);
        self.done += 1;
        self.length += 1;
        self.reward += outcome.reward;
        agent.learn(action, outcome, &self.state);
        let terminal = outcome.ending == Ending::Terminal;
        self.over = terminal || self.length >= self.span.timeout;
        if self.over {
            self.run.returns.push(self.reward);
            self.run.terminals += usize::from(terminal);
            (self.length, self.reward) = (0, 0.0);
        }
        self.run.rest = self.reward;
        self.run.rest_share = self.length as f64 / self.span.timeout as f64;
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{AgentConfig, Begin, CartPole, Simulated};

    fn cart_pole_run(seed: u64, span: RunLength) -> AgentRun {
        let mut world = Simulated::new(CartPole::default(), Begin::AsTheTask);
        let mut agent = Agent::new(AgentConfig::default(), 4, 2);
        run_agent(&mut agent, &mut world, span, Seed::new(seed))
    }

    #[test]
    fn every_step_counts_once() {
        let span = RunLength { steps: 3000, timeout: 50 };
        let run = cart_pole_run(1, span);
        // The reward is 1 per step.
        assert_eq!(run.returns.iter().sum::<f64>() + run.rest, 3000.0);
        assert!(run.returns.iter().all(|&value| value <= 50.0) && run.returns.len() > 50);
        assert!(run.terminals < run.returns.len(), "some are cut at their timeout");
        let episodes = run.returns.len() as f64 + run.rest / 50.0;
        assert!((run.mean_return() - 3000.0 / episodes).abs() < 1e-9);
        assert_eq!(run, cart_pole_run(1, span));
        assert_ne!(run, cart_pole_run(2, span));
    }

    #[test]
    fn a_diverged_run_is_the_worst() {
        let mut run = cart_pole_run(1, RunLength { steps: 100, timeout: 50 });
        assert!(run.mean_return().is_finite());
        run.diverged = true;
        assert_eq!(run.mean_return(), f64::NEG_INFINITY);
    }

    #[test]
    fn less_than_an_episode_counts_as_one() {
        let run = cart_pole_run(1, RunLength { steps: 5, timeout: 500 });
        assert_eq!(run.mean_return(), 5.0);
    }
}
