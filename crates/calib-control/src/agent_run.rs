//! An agent's time in an environment.

use calib_core::{Rng, Seed};

use crate::{Agent, Ending, Environment, Outcome};

/// How long an agent lives, and when an episode is cut.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RunLength {
    /// Steps in all.
    pub steps: usize,
    /// Steps after which an episode is cut.
    pub timeout: usize,
}

/// What an agent got.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AgentRun {
    /// Return of each episode that ended or was cut at its timeout, in order.
    pub returns: Vec<f64>,
    /// How many of them ended in a terminal.
    pub terminals: usize,
    /// Reward of the episode that was not over.
    pub rest: f64,
    /// Steps of it, as a share of the timeout.
    pub rest_share: f64,
    /// Whether the agent's values stopped being numbers.
    pub diverged: bool,
}

impl AgentRun {
    /// Mean return an episode, Σ of all rewards / (episodes + the part of the last one), which counts one episode at least;
    /// −∞ if the agent diverged.
    pub fn mean_return(&self) -> f64 {
        if self.diverged {
            return f64::NEG_INFINITY;
        }
        let episodes = (self.returns.len() as f64 + self.rest_share).max(1.0);
        (self.returns.iter().sum::<f64>() + self.rest) / episodes
    }
}

/// Whoever acts in an environment.
pub trait Actor {
    /// Look at `state`, the first of an episode.
    fn look(&mut self, state: &[f32]);

    /// Draw an action in the state that it is in. `None` if it has diverged.
    fn act(&mut self, rng: &mut Rng) -> Option<usize>;

    /// Learn from what `action` led to, and be in `next`.
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

/// Let `agent` act and learn in `environment` for `span`. Its draws come from `seed`, those of the environment from another.
pub fn live(
    agent: &mut impl Actor,
    environment: &mut dyn Environment,
    span: RunLength,
    seed: Seed,
) -> AgentRun {
    let mut episodes = Episodes::new(environment, span, seed);
    while episodes.step(agent, environment) {}
    episodes.life
}

/// What an agent lives through, step by step.
pub(crate) struct Episodes {
    pub(crate) life: AgentRun,
    span: RunLength,
    acts: Rng,
    world: Rng,
    state: Vec<f32>,
    done: usize,
    /// Steps and reward of the episode.
    length: usize,
    reward: f64,
    /// Whether the last step ended an episode, in a terminal or at its timeout.
    pub(crate) over: bool,
}

impl Episodes {
    pub(crate) fn new(environment: &dyn Environment, span: RunLength, seed: Seed) -> Self {
        Self {
            life: AgentRun::default(),
            span,
            acts: seed.child("actions").rng(),
            world: seed.child("world").rng(),
            state: vec![0.0; environment.columns()],
            done: 0,
            length: 0,
            reward: 0.0,
            over: false,
        }
    }

    /// Begin an episode if none goes on.
    pub(crate) fn begin(&mut self, agent: &mut impl Actor, environment: &mut dyn Environment) {
        if self.length == 0 {
            environment.start(&mut self.world, &mut self.state);
            agent.look(&self.state);
        }
    }

    /// Take a step; whether there was one left to take.
    pub(crate) fn step(
        &mut self,
        agent: &mut impl Actor,
        environment: &mut dyn Environment,
    ) -> bool {
        if self.done >= self.span.steps || self.life.diverged {
            return false;
        }
        self.begin(agent, environment);
        let Some(action) = agent.act(&mut self.acts) else {
            self.life.diverged = true;
            return false;
        };
        let outcome = environment.step(action, &mut self.world, &mut self.state);
        self.done += 1;
        self.length += 1;
        self.reward += outcome.reward;
        agent.learn(action, outcome, &self.state);
        let terminal = outcome.ending == Ending::Terminal;
        self.over = terminal || self.length >= self.span.timeout;
        if self.over {
            self.life.returns.push(self.reward);
            self.life.terminals += usize::from(terminal);
            (self.length, self.reward) = (0, 0.0);
        }
        self.life.rest = self.reward;
        self.life.rest_share = self.length as f64 / self.span.timeout as f64;
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{AgentConfig, Begin, CartPole, Simulated};

    fn lived(seed: u64, span: RunLength) -> AgentRun {
        let mut world = Simulated::new(CartPole::default(), Begin::AsTheTask);
        let mut agent = Agent::new(AgentConfig::default(), 4, 2);
        live(&mut agent, &mut world, span, Seed::new(seed))
    }

    #[test]
    fn every_step_counts_once() {
        let span = RunLength { steps: 3000, timeout: 50 };
        let life = lived(1, span);
        // A reward of 1 a step.
        assert_eq!(life.returns.iter().sum::<f64>() + life.rest, 3000.0);
        assert!(life.returns.iter().all(|&value| value <= 50.0) && life.returns.len() > 50);
        assert!(life.terminals < life.returns.len(), "some are cut at their timeout");
        let episodes = life.returns.len() as f64 + life.rest / 50.0;
        assert!((life.mean_return() - 3000.0 / episodes).abs() < 1e-9);
        assert_eq!(life, lived(1, span));
        assert_ne!(life, lived(2, span));
    }

    #[test]
    fn a_diverged_life_is_the_worst() {
        let mut life = lived(1, RunLength { steps: 100, timeout: 50 });
        assert!(life.mean_return().is_finite());
        life.diverged = true;
        assert_eq!(life.mean_return(), f64::NEG_INFINITY);
    }

    #[test]
    fn less_than_an_episode_counts_as_one() {
        let life = lived(1, RunLength { steps: 5, timeout: 500 });
        assert_eq!(life.mean_return(), 5.0);
    }
}
