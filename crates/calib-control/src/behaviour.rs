//! Policies under which a log is recorded.

use calib_core::{Rng, Seed, Segments, States};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{
    Agent, ControlError, Decisions, Ending, Environment, Rule, RunLength, Task,
    agent_run::Episodes, log::Columns,
};

/// Quality of the policy under which a log is recorded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Quality {
    /// Trained until the mean return of ten episodes is near the best.
    #[default]
    NearOptimal,
    /// The near-optimal policy, with three of ten actions random.
    Medium,
    /// Every action has the same probability.
    Random,
    /// The fixed rule of the plant's operators, if the task has one.
    Rule,
    /// The fixed rule, with two of ten actions random.
    Perturbed,
}

impl Quality {
    /// The qualities in the published protocol.
    pub const PUBLISHED: [Self; 3] = [Self::NearOptimal, Self::Medium, Self::Random];

    /// Returns whether it needs a rule.
    pub const fn is_rule(self) -> bool {
        matches!(self, Self::Rule | Self::Perturbed)
    }

    /// Returns the share of random actions.
    pub const fn random_share(self) -> f64 {
        match self {
            Self::NearOptimal | Self::Rule => 0.0,
            Self::Medium => 0.3,
            Self::Perturbed => 0.2,
            Self::Random => 1.0,
        }
    }

    /// Returns the name in studies and on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::NearOptimal => "near_optimal",
            Self::Medium => "medium",
            Self::Random => "random",
            Self::Rule => "rule",
            Self::Perturbed => "perturbed",
        }
    }
}

/// A policy that does not change any more.
#[derive(Clone, Debug)]
pub enum Behaviour {
    /// Every action with the same probability.
    Random,
    /// The policy of an agent that stopped learning, with a share of random actions.
    Learned {
        /// The agent.
        agent: Box<Agent>,
        /// The share of random actions.
        random: f64,
    },
    /// A fixed rule, with a share of random actions.
    Fixed {
        /// The rule.
        rule: Rule,
        /// Name, lowest and highest value of each column. States are scaled by them.
        ranges: &'static [(&'static str, f64, f64)],
        /// The share of random actions.
        random: f64,
        /// The rule's action in the present state.
        says: usize,
    },
}

/// Number of successive episodes whose mean return decides whether an agent has learned enough.
const JUDGED_EPISODES: usize = 10;

impl Behaviour {
    /// Lets `agent` learn in `environment` until the mean return of ten successive episodes is at least `wanted`. Returns its policy then,
    /// or after `span` if it never gets there.
    pub fn learned(
        mut agent: Agent,
        environment: &mut dyn Environment,
        wanted: f64,
        span: RunLength,
        seed: Seed,
    ) -> Self {
        let mut episodes = Episodes::new(environment, span, seed);
        while episodes.step(&mut agent, environment) {
            let returns = &episodes.run.returns;
            if episodes.over && returns.len() >= JUDGED_EPISODES {
                let last = &returns[returns.len() - JUDGED_EPISODES..];
                if last.iter().sum::<f64>() / JUDGED_EPISODES as f64 >= wanted {
                    break;
                }
            }
        }
        Self::Learned { agent: Box::new(agent), random: 0.0 }
    }

    /// Returns the rule of the operators of `T`, if there is such a rule.
    pub fn rule_of<T: Task>() -> Option<Self> {
        let rule = T::rule()?;
        Some(Self::Fixed { rule, ranges: T::columns(), random: 0.0, says: 0 })
    }

    /// Returns the same policy with this share of random actions.
    #[must_use]
    pub fn perturbed(self, share: f64) -> Self {
        match self {
            Self::Random => Self::Random,
            Self::Learned { agent, .. } => Self::Learned { agent, random: share },
            Self::Fixed { rule, ranges, says, .. } => {
                Self::Fixed { rule, ranges, random: share, says }
            }
        }
    }

    fn act(&mut self, actions: usize, rng: &mut Rng) -> usize {
        match self {
            Self::Random => rng.below(actions),
            Self::Learned { random, .. } | Self::Fixed { random, .. }
                if *random > 0.0 && rng.unit() < *random =>
            {
                rng.below(actions)
            }
            Self::Fixed { says, .. } => *says,
            Self::Learned { agent, .. } => agent.act(rng).unwrap_or_else(|| rng.below(actions)),
        }
    }

    /// Returns the probability of `action` in the present state.
    fn probability(&mut self, action: usize, actions: usize) -> f64 {
        let alike = 1.0 / actions as f64;
        let (own, random) = match self {
            Self::Random => return alike,
            Self::Fixed { says, random, .. } => (f64::from(u8::from(*says == action)), *random),
            Self::Learned { agent, random } => {
                let own = agent.policy()[action];
                // An agent that diverged acts at random.
                (if own.is_nan() { alike } else { own }, *random)
            }
        };
        random * alike + (1.0 - random) * own
    }

    fn see(&mut self, state: &[f32], first: bool) {
        match self {
            Self::Random => {}
            Self::Fixed { rule, ranges, says, .. } => {
                let observed: Vec<f64> = state
                    .iter()
                    .zip(*ranges)
                    .map(|(&scaled, (_, low, high)): (&f32, &(_, f64, f64))| {
                        low + f64::from(scaled) * (high - low)
                    })
                    .collect();
                *says = rule(&observed);
            }
            Self::Learned { agent, .. } if first => agent.look(state),
            Self::Learned { agent, .. } => agent.go_on(state),
        }
    }

    /// Returns the mean return of the policy over `episodes` episodes, which are cut after `timeout` steps.
    pub fn mean_return(
        &mut self,
        environment: &mut dyn Environment,
        episodes: usize,
        timeout: usize,
        seed: Seed,
    ) -> f64 {
        let mut rng = seed.rng();
        let mut state = vec![0.0; environment.columns()];
        let mut total = 0.0;
        for _ in 0..episodes {
            environment.start(&mut rng, &mut state);
            self.see(&state, true);
            for _ in 0..timeout {
                let action = self.act(environment.actions(), &mut rng);
                let outcome = environment.step(action, &mut rng, &mut state);
                total += outcome.reward;
                if outcome.ending == Ending::Terminal {
                    break;
                }
                self.see(&state, false);
            }
        }
        total / episodes as f64
    }
}

/// A recorded log, row by row.
#[derive(Clone, Debug, Default)]
pub struct Recorded {
    /// States, row-major.
    pub states: Vec<f32>,
    /// The action in each row; `None` where an episode was cut or ended.
    pub actions: Vec<Option<u16>>,
    /// The probability of the action in each row; NaN where there is no action.
    pub probabilities: Vec<f64>,
    /// The reward that led to each row; NaN in the first row of an episode.
    pub rewards: Vec<f32>,
    /// Further logged values of the step that led to each row, beside state and reward, row-major; NaN in the first row of an episode.
    pub beside: Vec<f64>,
    /// Whether each row is terminal.
    pub endings: Vec<Ending>,
    /// Number of rows of each episode.
    pub lengths: Vec<usize>,
}

/// Records `transitions` transitions of `behaviour` in `environment`, in episodes that are cut after `timeout` steps.
pub fn record(
    behaviour: &mut Behaviour,
    environment: &mut dyn Environment,
    transitions: usize,
    timeout: usize,
    seed: Seed,
) -> Recorded {
    let mut rng = seed.rng();
    let mut state = vec![0.0; environment.columns()];
    let mut log = Recorded::default();
    let mut beside = Vec::new();
    environment.log(&mut beside);
    let unknown = vec![f64::NAN; beside.len()];
    let mut left = transitions;
    while left > 0 {
        environment.start(&mut rng, &mut state);
        log.row(&state, f32::NAN, Ending::Continues);
        log.beside.extend_from_slice(&unknown);
        behaviour.see(&state, true);
        let mut length = 1;
        while left > 0 && length <= timeout {
            let action = behaviour.act(environment.actions(), &mut rng);
            log.acted(action, behaviour.probability(action, environment.actions()));
            let outcome = environment.step(action, &mut rng, &mut state);
            log.row(&state, outcome.reward as f32, outcome.ending);
            environment.log(&mut log.beside);
            left -= 1;
            length += 1;
            if outcome.ending == Ending::Terminal {
                break;
            }
            behaviour.see(&state, false);
        }
        log.lengths.push(length);
    }
    log
}

impl Recorded {
    fn row(&mut self, state: &[f32], reward: f32, ending: Ending) {
        self.states.extend_from_slice(state);
        self.actions.push(None);
        self.probabilities.push(f64::NAN);
        self.rewards.push(reward);
        self.endings.push(ending);
    }

    /// Stores the action of the last row.
    fn acted(&mut self, action: usize, probability: f64) {
        if let Some((last, odds)) = self.actions.last_mut().zip(self.probabilities.last_mut()) {
            (*last, *odds) = (Some(action as u16), probability);
        }
    }

    /// Returns these rows as a log of an environment with `levels` actions.
    ///
    /// # Errors
    /// As [`Decisions::new`].
    pub fn decisions(self, levels: usize) -> Result<Decisions, ControlError> {
        let rows = self.actions.len();
        let columns = self.states.len() / rows.max(1);
        let states = States::new(self.states, rows, columns)?;
        let segments = Segments::from_lengths(self.lengths)?;
        let columns =
            Columns { actions: &self.actions, rewards: &self.rewards, endings: &self.endings };
        Decisions::new(states, &segments, columns, levels)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{AgentConfig, Begin, CartPole, Simulated};

    fn cart_pole() -> Simulated<CartPole> {
        Simulated::new(CartPole::default(), Begin::AsTheTask)
    }

    #[test]
    fn a_log_has_as_many_transitions_as_asked_for() {
        let mut world = cart_pole();
        let log = record(&mut Behaviour::Random, &mut world, 500, 15, Seed::new(1));
        let log = log.decisions(2).expect("a log");
        assert_eq!(log.len(), 500);
        assert!(log.counts().iter().all(|&count| count > 200), "{:?}", log.counts());
        assert!(log.terminals() > 5, "{}", log.terminals());
        let recorded = log.recorded_return(15).expect("numbers");
        assert!(recorded.worst >= Some(1.0) && recorded.best == Some(15.0), "{recorded:?}");
        assert!(log.starts().len() > log.terminals(), "some episodes are cut");
    }

    /// Records 4,000 transitions of a behaviour, 30 % of whose actions are random.
    fn recording(behaviour: Behaviour) -> Recorded {
        record(&mut behaviour.perturbed(0.3), &mut cart_pole(), 4000, 50, Seed::new(4))
    }

    #[test]
    fn probabilities_are_how_often_an_action_is_taken() {
        let mut world = cart_pole();
        let agent = Agent::new(AgentConfig { temperature: 1.0, ..AgentConfig::default() }, 4, 2);
        let span = RunLength { steps: 2000, timeout: 200 };
        let learned = Behaviour::learned(agent, &mut world, 1e9, span, Seed::new(2));
        for recorded in [recording(learned), recording(Behaviour::Random)] {
            let taken = recorded.actions.iter().zip(&recorded.probabilities);
            let mut expected = 0.0;
            let mut ones = 0.0;
            for (action, &probability) in taken {
                let Some(action) = action else {
                    assert!(probability.is_nan());
                    continue;
                };
                assert!(probability > 0.0 && probability <= 1.0, "{probability}");
                ones += f64::from(*action);
                expected += if *action == 1 { probability } else { 1.0 - probability };
            }
            // The standard deviation of 4,000 draws is at most 32.
            assert!((expected - ones).abs() < 130.0, "{expected} {ones}");
        }
    }

    /// Returns the mean return of 50 episodes.
    fn mean_return(behaviour: &mut Behaviour) -> f64 {
        behaviour.mean_return(&mut cart_pole(), 50, 200, Seed::new(3))
    }

    #[test]
    fn what_was_learned_is_better_than_chance() {
        let mut world = cart_pole();
        let span = RunLength { steps: 20_000, timeout: 200 };
        let agent = Agent::new(AgentConfig::default(), 4, 2);
        let mut learned = Behaviour::learned(agent, &mut world, 80.0, span, Seed::new(2));
        let mut half = learned.clone().perturbed(Quality::Medium.random_share());
        let learned = mean_return(&mut learned);
        let random = mean_return(&mut Behaviour::Random);
        assert!(learned > 50.0 && random < 30.0, "{learned} {random}");
        let half = mean_return(&mut half);
        assert!(half < learned && half > random, "{random} {half} {learned}");
    }
}
