//! Warnings about agent values that do not fit the returns of a log. Both are in units of return.

use calib_base::output::{count, number};
use calib_control::{
    AgentConfig, ControlConfig, Decisions, ProposedSettings, is_beyond_returns, is_random,
};

/// A value of an agent in units of return, next to the recorded returns with the agent's discount.
#[derive(Clone, Copy)]
struct BesideReturns {
    value: f64,
    gamma: f64,
    /// Spread of the recorded returns.
    spread: f64,
}

impl BesideReturns {
    /// Returns the value in spreads.
    fn spreads(&self) -> f64 {
        self.value.abs() / self.spread
    }

    /// Returns the value of the agent that fits the returns best. `spreads` are those of the returns of each discount. `None`
    /// without agents, or if the returns of some agent have no spread.
    fn nearest<'a>(
        agents: impl Iterator<Item = &'a AgentConfig>,
        spreads: &[(f64, Option<f64>)],
        value: impl Fn(&AgentConfig) -> f64,
    ) -> Option<Self> {
        let each = agents.map(|agent| {
            let spread = spreads.iter().find(|(gamma, _)| *gamma == agent.gamma)?.1?;
            Some(Self { value: value(agent), gamma: agent.gamma, spread })
        });
        let all: Vec<Self> = each.collect::<Option<_>>()?;
        all.into_iter().min_by(|one, other| one.spreads().total_cmp(&other.spreads()))
    }

    fn told(&self, timeout: usize) -> String {
        format!(
            "the spread of the recorded returns, {} (gamma {}, timeout {})",
            number(self.spread),
            self.gamma,
            count(timeout)
        )
    }
}

/// Returns warnings about temperatures and initial weights that are too large for the returns of the log in all
/// settings. Each setting is compared with the returns of its own discount.
pub(super) fn beyond_returns(
    config: &ControlConfig,
    candidates: &[AgentConfig],
    log: &Decisions,
) -> Vec<String> {
    let timeout = config.longest_episode();
    let mut spreads: Vec<(f64, Option<f64>)> = Vec::new();
    for agent in candidates {
        if !spreads.iter().any(|(gamma, _)| *gamma == agent.gamma) {
            spreads.push((agent.gamma, log.return_spread(agent.gamma, timeout)));
        }
    }
    let tempered = candidates.iter().filter(|agent| agent.algorithm.uses("temperature"));
    let temperature = BesideReturns::nearest(tempered, &spreads, |agent| agent.temperature);
    let columns = log.states().columns();
    let first =
        BesideReturns::nearest(candidates.iter(), &spreads, |agent| agent.first_value(columns));
    let temperature = temperature.filter(|nearest| is_random(nearest.value, nearest.spread));
    let first = first.filter(|nearest| is_beyond_returns(nearest.value, nearest.spread));
    let random = temperature.map(|nearest| {
        format!(
            "temperature {} is more than {}, so that agents choose nearly at random: set {} to {}, or less",
            nearest.value,
            nearest.told(timeout),
            swept_key("temperature", config.grid.temperature.is_some()),
            ProposedSettings::for_spread(nearest.spread, &config.agent, columns).temperature
        )
    });
    let beyond = first.map(|nearest| {
        format!(
            "initial weights put the first values at {}, more than a hundred times {}, so that agents spend their run on unlearning them: set {} to 0, or about {}",
            number(nearest.value.abs()),
            nearest.told(timeout),
            swept_key("initial_weight", config.grid.initial_weight.is_some()),
            ProposedSettings::for_spread(nearest.spread, &config.agent, columns).initial_weights[1]
        )
    });
    random.into_iter().chain(beyond).collect()
}

/// Returns the key of the study that sets this field of agents.
fn swept_key(field: &str, is_swept: bool) -> String {
    format!("control.{}.{field}", if is_swept { "grid" } else { "agent" })
}
