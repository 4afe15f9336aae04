//! Estimates the time of a sweep of agents that act on this machine, by timing some of each piece of work.

use std::time::Duration;

use calib_base::{StepError, clock::Stopwatch};
use calib_control::{
    ActionModel, ActionModelKind, Actor, Agent, AgentConfig, Algorithm, ControlConfig, Decisions,
    Ensemble as _, Environment as _, FittedQValue, FixedPolicy, IncrementModel, Increments,
    ModelEnvironment, NetworkConfig, NetworkModel, RunLength, off_policy_values, run_agent,
};
use calib_core::{Monitor, Seed, Silent, States};

use super::log;

/// Shortest timing of one kind of step.
const TIMED: Duration = Duration::from_millis(30);
/// Steps of the first timing. Each later timing doubles them.
const FIRST_STEPS: usize = 16;
/// Steps of the last timing, however short they are.
const LAST_STEPS: usize = 1 << 20;
/// A model of a part of the log is large enough if it takes this long to build.
const ENOUGH: Duration = Duration::from_millis(100);
/// Transitions of the first such model, and of the largest.
const FEW_TRANSITIONS: usize = 500;
const MANY_TRANSITIONS: usize = 8_000;
/// Number of settings whose agents are timed. The others are assumed to take the mean of these.
const TIMED_AGENTS: usize = 10;
/// The order in which parts of a grid are timed, so that the first few are spread over the whole grid.
const SPREAD_OUT: [usize; TIMED_AGENTS] = [0, 9, 4, 7, 2, 5, 8, 1, 6, 3];
/// Time limit for timing all agents. The first agent is always timed.
const ALL_AGENTS: Duration = Duration::from_millis(1_200);
/// A step size with which no agent diverges while it is timed.
const SMALL_STEP_SIZE: f64 = 1e-4;
/// Largest product of weights and batch transitions in a timed step of a network: some tens of milliseconds.
const MOST_WORK: usize = 50_000_000;
/// Updates of the timed network. Every check is made, and the rest shows the time of an update.
const UPDATES: usize = 3 * NetworkConfig::CHECKS;
/// Passes through a network per update, with about equal work each: one forward and two backward.
const PASSES: f64 = 3.0;

/// Seconds that a thread takes to store a run in its own file. It mostly waits for the disk: 0.3 to 9 ms on the disk of
/// a virtual machine, where this was measured. A dry run writes nothing, so it cannot measure this.
pub(super) const KEEPING_SECS: f64 = 0.005;

/// The time of each piece of work, in seconds.
#[derive(Debug)]
pub(super) struct MeasuredCosts {
    /// Building the model on all threads. 0 if it exists.
    pub(super) building: f64,
    /// A step in the model of neighbours.
    pub(super) neighbors_step: f64,
    /// The cost of each kind of model, in the order of the study.
    pub(super) kinds: Vec<KindCost>,
    /// The cost of each setting's agent.
    pub(super) agents: Vec<AgentCost>,
}

/// The cost of a kind of model.
#[derive(Clone, Copy, Debug)]
pub(super) struct KindCost {
    /// Preparation beyond the model of neighbours: increments on all threads, or the network of one member on one
    /// thread.
    pub(super) making: f64,
    /// A step, without the agent.
    pub(super) step: f64,
}

/// The cost of an agent on one thread.
#[derive(Clone, Copy, Debug)]
pub(super) struct AgentCost {
    /// Creating a new agent.
    pub(super) beginning: f64,
    /// A step, without the model.
    pub(super) step: f64,
    /// Its evaluation from the log alone in the largest number of passes, per transition of the log.
    pub(super) evaluated_transition: f64,
}

impl AgentCost {
    /// Returns the mean of several costs.
    fn mean(costs: &[Self]) -> Self {
        Self {
            beginning: Self::mean_of(costs, |cost| cost.beginning),
            step: Self::mean_of(costs, |cost| cost.step),
            evaluated_transition: Self::mean_of(costs, |cost| cost.evaluated_transition),
        }
    }

    fn mean_of(costs: &[Self], field: fn(&Self) -> f64) -> f64 {
        costs.iter().map(field).sum::<f64>() / costs.len().max(1) as f64
    }
}

impl MeasuredCosts {
    /// Times some of each piece of the work on `log`. Steps are timed in the model that was `kept`, if there is one.
    ///
    /// # Errors
    /// Returns an error if a part of the log is not a valid log, or the monitor interrupts.
    pub(super) fn measure(
        config: &ControlConfig,
        agents: &[AgentConfig],
        log: &Decisions,
        kept: Option<&ActionModel>,
        worst_return: f64,
        monitor: &dyn Monitor,
    ) -> Result<Self, StepError> {
        let few = log.sample(least_transitions(config))?;
        let starts = log::starts(&few, few.states(), config.start)?.observed;
        let few = FewDecisions { log: few, starts };
        let part = PartModel::build(config, log, worst_return, monitor)?;
        let model = kept.unwrap_or(&part.model);
        let timeout = config.timeout;
        let mut random = FixedPolicy::Random(log.levels());
        let neighbors_step = step_secs(&mut random, &mut model.rollout(0), timeout);
        let mut kinds = Vec::new();
        for &kind in &config.models {
            monitor.check()?;
            kinds.push(match kind {
                ActionModelKind::Neighbors => KindCost { making: 0.0, step: neighbors_step },
                ActionModelKind::Increments => part.increments(config, log, monitor)?,
                ActionModelKind::Network => few.network(config, log, monitor)?,
            });
        }
        let pass = few.pass(timeout, monitor)?;
        let timing = AgentTiming { model, neighbors_step, few: &few, pass, timeout };
        Ok(Self {
            building: if kept.is_some() { 0.0 } else { part.building },
            neighbors_step,
            kinds,
            agents: timing.all(agents, monitor)?,
        })
    }
}

/// Returns the transitions of the smallest part of a log that the models of a study can be built from.
fn least_transitions(config: &ControlConfig) -> usize {
    FEW_TRANSITIONS.max(config.model.members.saturating_mul(4))
}

/// Returns the seconds per step of `actor` in `rollout`. It doubles the steps until they take long enough to time.
fn step_secs<W: ModelEnvironment>(actor: &mut impl Actor, rollout: &mut W, timeout: usize) -> f64 {
    let mut steps = FIRST_STEPS;
    loop {
        let before = rollout.coverage().steps;
        let clock = Stopwatch::start();
        let run = run_agent(actor, rollout, RunLength { steps, timeout }, Seed::new(steps as u64));
        let took = clock.elapsed();
        if took >= TIMED || steps >= LAST_STEPS || run.diverged {
            let taken = rollout.coverage().steps - before;
            return took.as_secs_f64() / taken.max(1) as f64;
        }
        steps *= 2;
    }
}

/// A model of a part of the log.
struct PartModel {
    model: ActionModel,
    /// Extrapolated time to build the model of the whole log.
    building: f64,
    /// Exponent with which the time to search a log grows with its transitions.
    power: f64,
}

impl PartModel {
    /// Builds models of growing parts, until one covers the whole log or takes long enough.
    fn build(
        config: &ControlConfig,
        log: &Decisions,
        worst_return: f64,
        monitor: &dyn Monitor,
    ) -> Result<Self, StepError> {
        let all = log.len();
        let mut wanted = least_transitions(config);
        let mut before: Option<(usize, f64)> = None;
        loop {
            let part = log.sample(wanted)?;
            let transitions = part.len();
            let metric = part.states().clone();
            let starts = log::starts(&part, &metric, config.start)?;
            let clock = Stopwatch::start();
            let model =
                ActionModel::build(part, &metric, starts, &config.model, worst_return, monitor)?;
            let took = clock.elapsed();
            let secs = took.as_secs_f64();
            if transitions >= all || took >= ENOUGH || wanted >= MANY_TRANSITIONS {
                let power =
                    before.map_or(1.0, |(fewer, less)| power([fewer, transitions], [less, secs]));
                let building = secs * grown(transitions, all).powf(power);
                return Ok(Self { model, building, power });
            }
            before = Some((transitions, secs));
            wanted = wanted.saturating_mul(2);
        }
    }

    /// Returns the cost of increments for the whole log.
    fn increments(
        &self,
        config: &ControlConfig,
        log: &Decisions,
        monitor: &dyn Monitor,
    ) -> Result<KindCost, StepError> {
        let clock = Stopwatch::start();
        let increments = Increments::new(&self.model, config.model.coverage, monitor)?;
        let making = clock.elapsed().as_secs_f64();
        let model = IncrementModel::new(&self.model, &increments);
        let mut random = FixedPolicy::Random(log.levels());
        let step = step_secs(&mut random, &mut model.rollout(0), config.timeout);
        let grown = grown(self.model.log().len(), log.len());
        // A step searches all transitions with its action.
        Ok(KindCost { making: making * grown.powf(self.power), step: step * grown })
    }
}

/// Returns the ratio of the whole to a part.
fn grown(part: usize, whole: usize) -> f64 {
    whole as f64 / part.max(1) as f64
}

/// Returns the exponent with which time grows between two numbers of transitions. It is limited to the range from a
/// tree search to a search through everything.
fn power(transitions: [usize; 2], secs: [f64; 2]) -> f64 {
    let [less, more] = secs.map(|secs| secs.max(1e-9));
    let larger = grown(transitions[0], transitions[1]);
    if larger > 1.0 { ((more / less).ln() / larger.ln()).clamp(1.0, 2.0) } else { 1.0 }
}

/// The smallest part of a log that suffices to time a network and an evaluation without a model.
struct FewDecisions {
    log: Decisions,
    starts: States,
}

impl FewDecisions {
    /// Returns the seconds of a pass of fitted Q evaluation, which takes equally long for every agent.
    fn pass(&self, timeout: usize, monitor: &dyn Monitor) -> Result<f64, StepError> {
        let Self { log, starts } = self;
        let clock = Stopwatch::start();
        // With a discount factor of 0, values converge in few passes.
        let random = FittedQValue::of_random_actions(log, starts, 0.0, timeout, monitor)?;
        Ok(clock.elapsed().as_secs_f64() / random.passes as f64)
    }

    /// Returns the cost of the network of one member for the whole log.
    fn network(
        &self,
        config: &ControlConfig,
        log: &Decisions,
        monitor: &dyn Monitor,
    ) -> Result<KindCost, StepError> {
        let whole = NetworkConfig { members: config.model.members, ..NetworkConfig::default() };
        let timed = NetworkConfig { updates: UPDATES, ..whole };
        let Self { log: few, starts } = self;
        let (starts, seed) = (starts.clone(), Seed::new(0));
        let clock = Stopwatch::start();
        let model = NetworkModel::train_members(few, starts, &timed, &[0], seed, None, monitor)?;
        let update = clock.elapsed().as_secs_f64() / updates(&timed, few.len());
        let mut random = FixedPolicy::Random(log.levels());
        let step = step_secs(&mut random, &mut model.rollout(0), config.timeout);
        Ok(KindCost { making: update * updates(&whole, log.len()), step })
    }
}

/// Returns the updates of a network, with its checks as equivalent updates. A check is a forward pass over the block
/// that the member leaves out.
fn updates(config: &NetworkConfig, transitions: usize) -> f64 {
    let checked = NetworkConfig::CHECKS * transitions / config.members.max(1);
    config.updates as f64 + checked as f64 / config.batch as f64 / PASSES
}

/// The inputs for timing agents.
struct AgentTiming<'a> {
    /// The model that they act in.
    model: &'a ActionModel,
    /// Seconds of a step in it without agents.
    neighbors_step: f64,
    few: &'a FewDecisions,
    /// Seconds of a pass of fitted Q evaluation over the few decisions.
    pass: f64,
    timeout: usize,
}

impl AgentTiming<'_> {
    /// Returns the cost of each agent. Agents that differ only in fields without an effect on time are timed once.
    fn all(
        &self,
        agents: &[AgentConfig],
        monitor: &dyn Monitor,
    ) -> Result<Vec<AgentCost>, StepError> {
        let mut different: Vec<AgentConfig> = Vec::new();
        let mut places = Vec::with_capacity(agents.len());
        for agent in agents {
            let alike = timed_like(agent);
            let place = different.iter().position(|other| *other == alike);
            places.push(place.unwrap_or(different.len()));
            if place.is_none() {
                different.push(alike);
            }
        }
        let clock = Stopwatch::start();
        let mut costs: Vec<Option<AgentCost>> = vec![None; different.len()];
        let timed = different.len().min(TIMED_AGENTS);
        let order = SPREAD_OUT.into_iter().filter(|&number| number < timed);
        for (before, number) in order.enumerate() {
            monitor.check()?;
            if before > 0 && clock.elapsed() >= ALL_AGENTS {
                break;
            }
            let place = number * different.len() / timed;
            costs[place] = Some(self.agent(different[place])?);
        }
        let known: Vec<AgentCost> = costs.iter().copied().flatten().collect();
        let mean = AgentCost::mean(&known);
        Ok(places.into_iter().map(|place| costs[place].unwrap_or(mean)).collect())
    }

    fn agent(&self, agent: AgentConfig) -> Result<AgentCost, StepError> {
        let mut rollout = self.model.rollout(0);
        let TimeableAgent { config, times } = timeable(agent, rollout.columns(), rollout.actions());
        let clock = Stopwatch::start();
        let mut actor = Agent::seeded(config, rollout.columns(), rollout.actions(), Seed::new(0));
        let beginning = clock.elapsed().as_secs_f64();
        if config.algorithm == Algorithm::DeepQLearning {
            // Steps cost almost nothing until there are enough transitions for a batch.
            let filling = RunLength { steps: config.batch, timeout: self.timeout };
            run_agent(&mut actor, &mut rollout, filling, Seed::new(1));
        }
        let both = step_secs(&mut actor, &mut rollout, self.timeout);
        let step = times * (both - self.neighbors_step).max(0.0);
        let FewDecisions { log, starts } = self.few;
        let clock = Stopwatch::start();
        let values = off_policy_values(log, starts, &[config], 1, self.timeout, &Silent)?;
        let took = (clock.elapsed().as_secs_f64() - beginning).max(0.0);
        let evaluated = evaluation_secs(took, values.fitted_q[0].passes, self.pass);
        Ok(AgentCost { beginning, step, evaluated_transition: evaluated / log.len() as f64 })
    }
}

/// Returns the seconds of an evaluation in the largest number of passes, which agents that have learned more may need. One with `passes`
/// passes `took` this long, and each pass takes `pass`. The policies in all states are found once.
fn evaluation_secs(took: f64, passes: usize, pass: f64) -> f64 {
    took + (FittedQValue::MOST_PASSES - passes) as f64 * pass
}

/// Returns an agent that takes the same time, whatever it learns.
fn timed_like(agent: &AgentConfig) -> AgentConfig {
    let AgentConfig { temperature, epsilon, target_steps, .. } = AgentConfig::default();
    AgentConfig {
        step_size: SMALL_STEP_SIZE,
        beta1: 0.0,
        temperature,
        epsilon,
        initial_weight: 0.0,
        target_steps,
        ..*agent
    }
}

/// A version of an agent that is fast enough to time.
struct TimeableAgent {
    config: AgentConfig,
    /// Factor from its time per step to that of the real agent.
    times: f64,
}

/// Returns the agent with smaller batches, if a step would otherwise take too long.
fn timeable(agent: AgentConfig, columns: usize, actions: usize) -> TimeableAgent {
    if agent.algorithm != Algorithm::DeepQLearning {
        return TimeableAgent { config: agent, times: 1.0 };
    }
    let width = agent.hidden_width;
    let between = agent.hidden_layers.saturating_sub(1) * width * width;
    let weights = columns * width + between + width * actions;
    let batch = agent.batch.min((MOST_WORK / weights.max(1)).max(1));
    let times = agent.batch as f64 / batch as f64;
    TimeableAgent { config: AgentConfig { batch, ..agent }, times }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_grows_between_a_tree_and_everything() {
        assert_eq!(power([100, 200], [1.0, 2.0]), 1.0);
        assert!((power([100, 200], [1.0, 3.0]) - 3.0_f64.log2()).abs() < 1e-12);
        assert_eq!(power([100, 200], [1.0, 9.0]), 2.0);
        // Times that are too short to measure.
        assert_eq!(power([100, 200], [0.0, 0.0]), 1.0);
        assert_eq!(power([100, 100], [1.0, 2.0]), 1.0);
    }

    #[test]
    fn only_passes_grow_with_the_passes() {
        assert_eq!(evaluation_secs(7.0, FittedQValue::MOST_PASSES, 0.5), 7.0);
        // Policies of two seconds, and ten passes of half a second.
        let all = 2.0 + FittedQValue::MOST_PASSES as f64 * 0.5;
        assert_eq!(evaluation_secs(7.0, 10, 0.5), all);
    }

    #[test]
    fn checks_count_as_the_updates_that_take_as_long() {
        let config = NetworkConfig { members: 5, updates: 100, batch: 64, ..Default::default() };
        // Twenty times a fifth of 9,600 transitions, 64 at a time, a third of an update each.
        assert!((updates(&config, 9_600) - 300.0).abs() < 1e-9);
    }

    #[test]
    fn agents_are_timed_from_all_over_a_grid() {
        let mut sorted = SPREAD_OUT;
        sorted.sort_unstable();
        assert!(sorted.into_iter().eq(0..TIMED_AGENTS), "each part once");
        for timed in 2..=TIMED_AGENTS {
            let order = SPREAD_OUT.into_iter().filter(|&number| number < timed);
            let early: Vec<usize> = order.take(timed.div_ceil(2)).collect();
            let mean = early.iter().sum::<usize>() as f64 / early.len() as f64;
            let middle = (timed - 1) as f64 / 2.0;
            assert!((mean - middle).abs() <= 1.0, "{early:?} of {timed}");
        }
    }

    #[test]
    fn settings_that_take_as_long_are_timed_once() {
        let agent = AgentConfig::default();
        let hotter = AgentConfig { temperature: 3.0, step_size: 0.3, ..agent };
        assert_eq!(timed_like(&agent), timed_like(&hotter));
        let finer = AgentConfig { tilings: 32, ..agent };
        assert_ne!(timed_like(&agent), timed_like(&finer));
    }

    #[test]
    fn batches_of_networks_that_nobody_waits_for_are_cut() {
        let deep = AgentConfig { algorithm: Algorithm::DeepQLearning, ..AgentConfig::default() };
        let TimeableAgent { config, times } = timeable(deep, 4, 2);
        assert_eq!((config, times), (deep, 1.0));
        let huge = AgentConfig { hidden_width: 4_096, batch: 4_096, replay: 4_096, ..deep };
        let TimeableAgent { config, times } = timeable(huge, 4, 2);
        assert!(config.batch < 4 && times > 1_000.0, "{} {times}", config.batch);
    }
}
