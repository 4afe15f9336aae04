/// An agent that `calib init` proposes. All of them start from the simple predictor that suits the sensor best.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProposedAgent {
    /// A linear value function that learns from every step with `SwiftTD`.
    Linear,
    /// A network that learns from a replay buffer.
    Network,
}

impl ProposedAgent {
    /// All of them, the simplest first.
    pub const ALL: [Self; 2] = [Self::Linear, Self::Network];

    /// What it is called in text.
    pub const fn label(self) -> &'static str {
        match self {
            Self::Linear => "a linear agent",
            Self::Network => "a network",
        }
    }
}

/// What an agent came to on the last third of the training range, when it learnt from the rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trial {
    /// Which agent.
    pub agent: ProposedAgent,
    /// Its error by that of the best simple predictor: geometric mean over sensors.
    pub ratio: f64,
}

/// An agent has to have less than this share of a simpler one's error to be proposed instead.
const WORTH_IT: f64 = 0.98;

/// The simplest agent that no other one beats by more than two per cent; none if nothing was tried.
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

    /// The agent that is chosen by these ratios.
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
