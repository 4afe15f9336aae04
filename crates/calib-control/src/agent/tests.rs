use super::*;
use crate::{Ending, Environment};

/// Five places in a row. Episodes start in the middle. Right of the last place an episode ends with reward 1, left of
/// the first one with 0.
struct Row(i32);

impl Environment for Row {
    fn actions(&self) -> usize {
        2
    }

    fn columns(&self) -> usize {
        1
    }

    fn start(&mut self, _rng: &mut Rng, state: &mut [f32]) {
        self.0 = 2;
        state[0] = 0.5;
    }

    fn step(&mut self, action: usize, _rng: &mut Rng, state: &mut [f32]) -> Outcome {
        self.0 += if action == 1 { 1 } else { -1 };
        state[0] = self.0 as f32 / 4.0;
        let ended = !(0..5).contains(&self.0);
        let reward = if self.0 == 5 { 1.0 } else { 0.0 };
        Outcome { reward, ending: Ending::terminal_if(ended) }
    }
}

#[test]
fn the_first_value_holds_the_initial_weight_of_every_active_feature() {
    let state = [0.1, 0.4, 0.6, 0.9];
    let optimist = AgentConfig { initial_weight: 8.0, ..AgentConfig::default() };
    let alone = AgentConfig { pairs: false, ..optimist };
    for (config, expected) in [(optimist, 80.0), (alone, 32.0)] {
        assert_eq!(Agent::new(config, 4, 3).values_in(&state), [expected; 3]);
        assert_eq!(config.first_value(4), expected);
    }
    let network = AgentConfig { algorithm: Algorithm::DeepQLearning, ..optimist };
    for value in Agent::new(network, 4, 3).values_in(&state) {
        assert!((value - network.first_value(4)).abs() < 4.0, "{value}, not about 8");
    }
}

fn learned(config: AgentConfig) -> Agent {
    let mut row = Row(0);
    let mut agent = Agent::new(config, 1, 2);
    let mut rng = Seed::new(5).rng();
    let mut state = [0.0];
    for _ in 0..3000 {
        row.start(&mut rng, &mut state);
        agent.look(&state);
        loop {
            let action = agent.act(&mut rng).expect("finite");
            let outcome = row.step(action, &mut rng, &mut state);
            agent.learn(action, outcome, &state);
            if outcome.ending == Ending::Terminal {
                break;
            }
        }
    }
    agent
}

/// q of going right from each place is γ to the power of the further steps, if the agent nearly always goes right.
#[test]
fn both_algorithms_find_the_values_of_a_row() {
    let shared = AgentConfig {
        step_size: 0.01,
        gamma: 0.9,
        temperature: 0.01,
        epsilon: 0.1,
        lambda: 0.5,
        ..AgentConfig::default()
    };
    for algorithm in [Algorithm::ExpectedSarsa, Algorithm::QLearning] {
        let mut agent = learned(AgentConfig { algorithm, ..shared });
        for place in 2..5 {
            agent.look(&[place as f32 / 4.0]);
            let expected = 0.9_f64.powi(4 - place);
            let got = agent.values()[1];
            assert!((got - expected).abs() < 0.06, "{algorithm:?} {place}: {got}, not {expected}");
            assert!(agent.values()[0] < got);
        }
    }
}

#[test]
fn a_network_finds_them_too_and_the_same_each_time() {
    let config = AgentConfig {
        algorithm: Algorithm::DeepQLearning,
        step_size: 0.003,
        beta1: 0.9,
        gamma: 0.9,
        epsilon: 0.3,
        hidden_width: 16,
        hidden_layers: 1,
        batch: 16,
        replay: 1000,
        target_steps: 50,
        ..AgentConfig::default()
    };
    let mut agent = learned(config);
    for place in 2..5 {
        agent.look(&[place as f32 / 4.0]);
        let expected = 0.9_f64.powi(4 - place);
        let got = agent.values()[1];
        assert!((got - expected).abs() < 0.1, "{place}: {got}, not {expected}");
    }
    let twice = [0, 1].map(|_| learned(config).values().to_vec());
    assert_eq!(twice[0], twice[1]);
    let too_few = AgentConfig { replay: 8, ..config };
    assert!(too_few.check().expect_err("fewer than a batch").to_string().contains("replay"));
}

#[test]
fn policies_are_their_formulas() {
    let values = [1.0, 3.0, 3.0];
    let mut probabilities = [0.0; 3];
    let soft = AgentConfig { temperature: 2.0, ..AgentConfig::default() };
    policy(&soft, &values, &mut probabilities);
    let e = (-1.0_f64).exp();
    let expected = [e / (2.0 + e), 1.0 / (2.0 + e), 1.0 / (2.0 + e)];
    assert!(
        probabilities.iter().zip(expected).all(|(got, expected)| (got - expected).abs() < 1e-12)
    );
    let greedy = AgentConfig { algorithm: Algorithm::QLearning, epsilon: 0.3, ..soft };
    policy(&greedy, &values, &mut probabilities);
    assert!(
        probabilities
            .iter()
            .zip([0.1, 0.45, 0.45])
            .all(|(got, expected)| (got - expected).abs() < 1e-12)
    );
}

#[test]
fn a_diverged_agent_does_not_act() {
    let mut agent = Agent::new(AgentConfig::default(), 1, 2);
    agent.look(&[0.5]);
    let mut rng = Seed::new(1).rng();
    assert!(agent.act(&mut rng).is_some());
    agent.learn(0, Outcome { reward: f64::NAN, ending: Ending::Terminal }, &[0.5]);
    assert_eq!(agent.act(&mut rng), None);
}

#[test]
fn impossible_settings_are_named() {
    let wrong = AgentConfig { temperature: 0.0, ..AgentConfig::default() };
    let told = wrong.check().expect_err("no temperature").to_string();
    assert!(told.contains("temperature") && told.contains("positive"), "{told}");
    assert!(AgentConfig { gamma: f64::NAN, ..AgentConfig::default() }.check().is_err());
    assert!(AgentConfig::default().check().is_ok());
}
