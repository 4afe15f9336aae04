//! Fitted Q evaluation: the value of a policy from a log, without a model. A baseline.

use calib_core::{Cancelled, Monitor, States, TransitionIndex};
use rayon::prelude::*;

use crate::{
    Agent, AgentConfig, ControlError, Decisions, Ending, Outcome,
    agent::{Pairs, Tiles, policy},
};

/// Tilings, tiles and step size of the fitted values; fewer tilings than agents have, for the sake of time.
const TILINGS: usize = 4;
const TILES: usize = 8;
const STEP: f64 = 0.3;
/// States of more columns have tiles of single columns only: pairs would be hundreds of times as many.
const PAIRED_COLUMNS: usize = 16;
/// Passes over the log.
const PASSES: usize = 20;

/// The value of each candidate from the log alone, `[candidates]`: what it learns from the recorded transitions, evaluated on them.
///
/// A candidate learns from the log in the order in which it was recorded, again and again until it has seen `updates` transitions, without
/// traces (they would follow the behaviour, not the agent). The policy π that it has then is evaluated by fitted Q evaluation (Le,
/// Voloshin & Yue 2019) with values linear in tile coding of their own, with pairs of columns where there are at most 16: in 20 passes over the log, last transition first,
/// q(s, a) ← q(s, a) + 0.3 · (r + γ Σ π(a' | s') q(s', a') − q(s, a)), the target being cut to what an episode of `timeout` steps can get. The value is the
/// mean of Σ π(a | s) q(s, a) over the states in which episodes begin. −∞ if the candidate diverged.
///
/// # Errors
/// If the monitor interrupts.
pub fn fitted_q_evaluation(
    log: &Decisions,
    starts: &States,
    candidates: &[AgentConfig],
    updates: usize,
    timeout: usize,
    monitor: &dyn Monitor,
) -> Result<Vec<f64>, ControlError> {
    monitor.begin("fitted Q evaluation", candidates.len() as u64);
    let values: Result<Vec<f64>, Cancelled> = candidates
        .par_iter()
        .map(|&config| {
            monitor.check()?;
            let mut agent = from_log(log, config, updates);
            let value = evaluated(log, starts, &mut agent, config, timeout);
            monitor.advance(1);
            Ok(if value.is_finite() { value } else { f64::NEG_INFINITY })
        })
        .collect();
    Ok(values?)
}

/// An agent that learnt from `updates` recorded transitions.
pub(crate) fn from_log(log: &Decisions, config: AgentConfig, updates: usize) -> Agent {
    let config = AgentConfig { lambda: 0.0, ..config };
    let mut agent = Agent::new(config, log.states().columns(), log.levels());
    let mut before = None;
    for update in 0..updates {
        let number = update % log.len();
        let transition = TransitionIndex::new(number);
        let source = log.transitions().source(transition);
        if before != Some(source) {
            agent.look(log.states().row(source.get()));
        }
        let next = log.transitions().next(transition);
        let reward = f64::from(log.rewards()[number]);
        let outcome = Outcome { reward, ending: log.endings()[number] };
        agent.learn(usize::from(log.actions()[number]), outcome, log.states().row(next.get()));
        before = Some(next);
    }
    agent
}

/// π(· | state) of each of `rows` states, one after the other.
pub(crate) fn policies<'a>(
    agent: &mut Agent,
    config: &AgentConfig,
    states: impl Iterator<Item = &'a [f32]>,
) -> Vec<f64> {
    let mut all = Vec::new();
    let mut probabilities = vec![0.0; agent.actions()];
    for state in states {
        agent.go_on(state);
        policy(config, agent.values(), &mut probabilities);
        all.extend_from_slice(&probabilities);
    }
    all
}

fn evaluated(
    log: &Decisions,
    starts: &States,
    agent: &mut Agent,
    config: AgentConfig,
    timeout: usize,
) -> f64 {
    let states = log.states();
    let source = |number: usize| log.transitions().source(TransitionIndex::new(number)).get();
    let next = |number: usize| log.transitions().next(TransitionIndex::new(number)).get();
    let after = policies(agent, &config, (0..log.len()).map(|number| states.row(next(number))));
    let pairs = if states.columns() > PAIRED_COLUMNS { Pairs::No } else { Pairs::Too };
    // Features are found anew in every pass: those of all rows of a long log would take more memory than the log.
    let mut tiles = Tiles::new(TILINGS, TILES, states.columns(), pairs);
    let mut here = Vec::new();
    let mut ahead = Vec::new();
    let mut row_here = None;
    let actions = log.levels();
    let length = tiles.len();
    let mut weights = vec![0.0_f64; actions * length];
    let rewards = log.rewards().iter().copied().map(f64::from);
    let extreme = |reward: f64, other: f64| (timeout as f64 * reward).min(other.min(reward));
    let lowest = extreme(rewards.clone().fold(f64::INFINITY, f64::min), 0.0);
    let highest = -extreme(rewards.map(|reward| -reward).fold(f64::INFINITY, f64::min), 0.0);
    let step = STEP / tiles.active() as f64;
    for _ in 0..PASSES {
        for number in (0..log.len()).rev() {
            let mut target = f64::from(log.rewards()[number]);
            if log.endings()[number] == Ending::Continues {
                let policy = &after[number * actions..][..actions];
                // Backwards, the next row is mostly the one that was just looked at.
                if row_here == Some(next(number)) {
                    std::mem::swap(&mut here, &mut ahead);
                } else {
                    tiles.of(states.row(next(number)), &mut ahead);
                }
                target += config.gamma * mean_value(&weights, length, policy, &ahead);
            }
            let own = &mut weights[usize::from(log.actions()[number]) * length..][..length];
            tiles.of(states.row(source(number)), &mut here);
            row_here = Some(source(number));
            let value: f64 = here.iter().map(|&feature| own[feature as usize]).sum();
            let change = step * (target.clamp(lowest, highest) - value);
            for &feature in &here {
                own[feature as usize] += change;
            }
        }
    }
    let first = policies(agent, &config, (0..starts.rows()).map(|row| starts.row(row)));
    let mut value = 0.0;
    for (row, policy) in first.chunks(actions).enumerate() {
        tiles.of(starts.row(row), &mut here);
        value += mean_value(&weights, length, policy, &here);
    }
    value / starts.rows() as f64
}

/// Σ π(a) q(a) at `features`.
fn mean_value(weights: &[f64], length: usize, policy: &[f64], features: &[u32]) -> f64 {
    policy
        .iter()
        .enumerate()
        .map(|(action, probability)| {
            let own = &weights[action * length..][..length];
            probability * features.iter().map(|&feature| own[feature as usize]).sum::<f64>()
        })
        .sum()
}

#[cfg(test)]
pub(crate) mod tests {
    use calib_core::{Seed, Segments, Silent};

    use super::*;
    use crate::Columns;

    /// A corridor of ten places, −1 a step, left or right by chance; right of the last is the end.
    pub(crate) fn corridor() -> Decisions {
        let mut rng = Seed::new(1).rng();
        let mut states = Vec::new();
        let mut actions = Vec::new();
        let mut endings = Vec::new();
        let mut lengths = Vec::new();
        while states.len() < 6000 {
            let mut place = rng.below(10) as i32;
            let mut length = 1;
            while place < 10 {
                let action = rng.below(2);
                states.push(place as f32 / 10.0);
                actions.push(Some(action as u16));
                endings.push(Ending::Continues);
                place = (place + if action == 1 { 1 } else { -1 }).max(0);
                length += 1;
            }
            states.push(1.0);
            actions.push(None);
            endings.push(Ending::Terminal);
            lengths.push(length);
        }
        let rows = states.len();
        let columns = Columns { actions: &actions, rewards: &vec![-1.0; rows], endings: &endings };
        let states = States::new(states, rows, 1).expect("valid");
        Decisions::new(states, &Segments::from_lengths(lengths).expect("valid"), columns, 2)
            .expect("a log")
    }

    #[test]
    fn the_better_policy_has_the_higher_value() {
        let log = corridor();
        let starts = States::new(vec![0.5], 1, 1).expect("valid");
        // One learns to go right, which takes five steps; the other cannot tell left from right.
        let sharp = AgentConfig { temperature: 0.1, gamma: 0.95, ..AgentConfig::default() };
        let dull = AgentConfig { temperature: 1e6, ..sharp };
        let values =
            fitted_q_evaluation(&log, &starts, &[sharp, dull], 20_000, 100, &Silent).expect("run");
        let five_steps = -(1.0 - 0.95_f64.powi(5)) / 0.05;
        assert!((values[0] - five_steps).abs() < 1.0, "{values:?}, not {five_steps}");
        assert!(values[1] < values[0] - 4.0, "{values:?}");
    }
}
