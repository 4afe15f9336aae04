/// An agent that `calib init` proposes. Each starts from the simple predictor that suits the sensor best.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProposedAgent {
    /// A linear value function that learns from every step with `SwiftTD`.
    Linear,
    /// A network that learns from a replay buffer.
    Network,
}

impl ProposedAgent {
    /// All agents, the simplest first.
    pub const ALL: [Self; 2] = [Self::Linear, Self::Network];

    /// Returns the name of the agent in text.
    pub const fn label(self) -> &'static str {
        match self {
            Self::Linear => "a linear agent",
            Self::Network => "a network",
        }
    }
}

/// Result of an agent that learned from the first two thirds of the training range, measured on the last third.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trial {
    /// The agent.
    pub agent: ProposedAgent,
    /// Its error divided by that of the best simple predictor: geometric mean over sensors.
    pub ratio: f64,
}

/// An agent must have less than this share of a simpler agent's error to be proposed instead.
const WORTH_IT: f64 = 0.98;

/// Returns the simplest agent whose error no other agent undercuts by more than 2 %; `None` without trials.
pub fn choose_agent(trials: &[Trial]) -> Option<Trial> {
    let simplest_first = trials.iter().filter(|trial| trial.ratio.is_finite());
    simplest_first.copied().reduce(
        |best, other| {
            if other.ratio < WORTH_IT * best.ratio { other } else { best }
        },
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the agent that is chosen for these ratios.
    fn chosen(ratios: [f64; 2]) -> Option<ProposedAgent> {
        let trials =
            [0, 1].map(|place| Trial { agent: ProposedAgent::ALL[place], ratio: ratios[place] });
        choose_agent(&trials).map(|trial| trial.agent)
    }

    #[test]
    fn a_network_has_to_earn_its_place() {
        assert_eq!(chosen([1.0, 0.99]), Some(ProposedAgent::Linear));
        assert_eq!(chosen([1.0, 0.9]), Some(ProposedAgent::Network));
        assert_eq!(chosen([f64::INFINITY, 1.2]), Some(ProposedAgent::Network));
        assert_eq!(chosen([f64::NAN, f64::NAN]), None);
    }
}
