//! Warnings about agent values that do not fit the returns of a log. All are in units of return.

use std::cmp::Ordering;

use calib_base::output::{count, number};
use calib_control::{
    AgentConfig, Algorithm, ControlConfig, Decisions, ProposedSettings, is_below_returns,
    is_beyond_returns, is_nearly_greedy, is_random,
};

/// A value of an agent in units of return, next to the recorded returns with the agent's discount.
#[derive(Clone, Copy, Debug)]
struct BesideReturns<'a> {
    agent: &'a AgentConfig,
    value: f64,
    /// Spread of the recorded returns.
    spread: f64,
}

impl BesideReturns<'_> {
    /// Returns the value in spreads.
    fn spreads(&self) -> f64 {
        self.value.abs() / self.spread
    }

    /// Orders two values by their size in spreads.
    fn compared(&self, other: &Self) -> Ordering {
        self.spreads().total_cmp(&other.spreads())
    }

    /// Describes the spread, such as "the spread of the recorded returns, 10.1 (gamma 1, timeout 500)".
    fn told(&self, timeout: usize) -> String {
        format!(
            "the spread of the recorded returns, {} (gamma {}, timeout {})",
            number(self.spread),
            self.agent.gamma,
            count(timeout)
        )
    }
}

/// The smallest and the largest value of agents, in spreads of the recorded returns.
#[derive(Clone, Copy, Debug)]
struct ValueRange<'a> {
    smallest: BesideReturns<'a>,
    largest: BesideReturns<'a>,
}

impl<'a> ValueRange<'a> {
    /// Compares the value of each agent with the returns of its own discount. `spreads` are those of each discount. `None` without
    /// agents, or if the returns of some agent have no spread.
    fn of_agents(
        agents: impl Iterator<Item = &'a AgentConfig>,
        spreads: &[(f64, Option<f64>)],
        value: impl Fn(&AgentConfig) -> f64,
    ) -> Option<Self> {
        let each = agents.map(|agent| {
            let spread = spreads.iter().find(|(gamma, _)| *gamma == agent.gamma)?.1?;
            Some(BesideReturns { agent, value: value(agent), spread })
        });
        let all: Vec<BesideReturns<'a>> = each.collect::<Option<_>>()?;
        let smallest = *all.iter().min_by(|one, other| one.compared(other))?;
        let largest = *all.iter().max_by(|one, other| one.compared(other))?;
        Some(Self { smallest, largest })
    }
}

/// Returns warnings about temperatures, initial weights and step sizes that do not fit the returns of the log in any
/// setting.
pub(super) fn beyond_returns(
    config: &ControlConfig,
    candidates: &[AgentConfig],
    log: &Decisions,
) -> Vec<String> {
    let timeout = config.longest_episode();
    let columns = log.states().columns();
    let mut spreads: Vec<(f64, Option<f64>)> = Vec::new();
    for agent in candidates {
        if !spreads.iter().any(|(gamma, _)| *gamma == agent.gamma) {
            spreads.push((agent.gamma, log.return_spread(agent.gamma, timeout)));
        }
    }
    let tempered = candidates.iter().filter(|agent| agent.algorithm.uses("temperature"));
    let temperatures = ValueRange::of_agents(tempered, &spreads, |agent| agent.temperature);
    let first_values =
        ValueRange::of_agents(candidates.iter(), &spreads, |agent| agent.first_value(columns));
    // Step sizes of networks have no unit.
    let tiled = candidates.iter().filter(|agent| agent.algorithm != Algorithm::DeepQLearning);
    let steps = ValueRange::of_agents(tiled, &spreads, |agent| agent.step_of_value(columns));
    let temperature = temperatures.and_then(|range| of_temperature(config, range, columns));
    let first_value = first_values.and_then(|range| of_first_value(config, range, columns));
    let step = steps.and_then(|range| of_step(config, range, columns));
    temperature.into_iter().chain(first_value).chain(step).collect()
}

/// Returns a warning if all temperatures are too large, or all are too small.
fn of_temperature(config: &ControlConfig, range: ValueRange<'_>, columns: usize) -> Option<String> {
    let ValueRange { smallest, largest } = range;
    let timeout = config.longest_episode();
    let key = swept_key("temperature", config.grid.temperature.is_some());
    let fitting = |spread| ProposedSettings::for_spread(spread, &config.agent, columns).temperature;
    if is_random(smallest.value, smallest.spread) {
        return Some(format!(
            "temperature {} is more than {}, so that agents choose nearly at random: set {key} to {}, or less",
            smallest.value,
            smallest.told(timeout),
            fitting(smallest.spread)
        ));
    }
    is_nearly_greedy(largest.value, largest.spread).then(|| {
        format!(
            "temperature {} is less than a five-hundredth of {}, so that agents hardly ever try another action: set {key} to about {}",
            largest.value,
            largest.told(timeout),
            fitting(largest.spread)
        )
    })
}

/// Returns a warning if all first values are too large.
fn of_first_value(config: &ControlConfig, range: ValueRange<'_>, columns: usize) -> Option<String> {
    let first = range.smallest;
    is_beyond_returns(first.value, first.spread).then(|| {
        format!(
            "initial weights put the first values at {}, more than a hundred times {}, so that agents spend their run on unlearning them: set {} to 0, or about {}",
            number(first.value.abs()),
            first.told(config.longest_episode()),
            swept_key("initial_weight", config.grid.initial_weight.is_some()),
            ProposedSettings::for_spread(first.spread, &config.agent, columns).initial_weights[1]
        )
    })
}

/// Returns a warning if all step sizes are too small.
fn of_step(config: &ControlConfig, range: ValueRange<'_>, columns: usize) -> Option<String> {
    let step = range.largest;
    is_below_returns(step.value, step.spread).then(|| {
        format!(
            "step size {} changes a value by {} in a step, less than a 2,500th of {}, so that agents hardly learn: set {} to about {}",
            step.agent.step_size,
            number(step.value),
            step.told(config.longest_episode()),
            swept_key("step_size", config.grid.step_size.is_some()),
            ProposedSettings::for_spread(step.spread, step.agent, columns).step_size
        )
    })
}

/// Returns the key of the study that sets this field of agents.
fn swept_key(field: &str, is_swept: bool) -> String {
    format!("control.{}.{field}", if is_swept { "grid" } else { "agent" })
}
