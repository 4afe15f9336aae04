use super::{AgentConfig, Algorithm};

/// Computes the probability of each action from the values of all actions.
pub(super) fn policy(config: &AgentConfig, values: &[f64], probabilities: &mut [f64]) {
    let best = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    match config.algorithm {
        Algorithm::ExpectedSarsa => {
            for (probability, value) in probabilities.iter_mut().zip(values) {
                *probability = ((value - best) / config.temperature).exp();
            }
        }
        Algorithm::QLearning | Algorithm::DeepQLearning => {
            let ties = values.iter().filter(|&&value| value == best).count().max(1) as f64;
            let random = config.epsilon / values.len() as f64;
            for (probability, value) in probabilities.iter_mut().zip(values) {
                let greedy = if *value == best { (1.0 - config.epsilon) / ties } else { 0.0 };
                *probability = random + greedy;
            }
        }
    }
    let total: f64 = probabilities.iter().sum();
    for probability in probabilities {
        *probability /= total;
    }
}
