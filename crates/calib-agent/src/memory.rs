use crate::{
    AgentConfig, Precision, PretrainSettings, ReplayKind, ValueFunction, layer_sizes,
    parameter_count, population::can_share,
};

/// Returns an upper bound on the bytes that [`train_learners`](crate::train_learners) takes beside the stream, if each
/// of `agents` predicts each of `sensors` columns of a stream of `states` states of `width` values.
///
/// The bound is the sum of all allocations, a few per cent too high. Populations are trained one after the other, so
/// the largest counts:
///
/// - for each agent and sensor: parameters, two moments (Adam) and a target network, if any, 4 bytes each; twice more
///   while the state of a long run is written; and the rounded copies of parameters, if any;
/// - for the population: a mini-batch of s and s' with its activations and their gradients, 4 bytes each; the states
///   with traces, if any, 4 bytes each; returns, 8 bytes per step and sensor; the replay buffer, which is a list of
///   step numbers, 4 bytes per step.
pub fn training_bytes(agents: &[AgentConfig], sensors: usize, width: usize, states: usize) -> u64 {
    agents
        .iter()
        .map(|first| {
            let size = agents.iter().filter(|agent| can_share(first, agent)).count();
            population_bytes(first, size * sensors, sensors, width, states)
        })
        .max()
        .unwrap_or(0)
}

/// Returns an upper bound on the bytes that [`pretrain`](crate::pretrain) takes beside the stream, with one `agent` for
/// each of `sensors` columns of a stream of `states` states of `width` values, on `threads` threads:
///
/// - for each agent: parameters and moments, their copy that is written at the end of an epoch, and the best epoch's if
///   the agent may stop early, 4 bytes each;
/// - for each thread: a mini-batch with its activations, as in [`training_bytes`], and values of the longest validation
///   piece, 4 bytes per state;
/// - two lists of transitions, in time order and shuffled, 8 bytes each; the states with traces, if any.
pub fn pretraining_bytes(
    agent: &AgentConfig,
    PretrainSettings { patience, validation_fraction, .. }: PretrainSettings,
    sensors: usize,
    width: usize,
    states: usize,
    threads: usize,
) -> u64 {
    let seen = agent.seen_width(width);
    let parameters = parameter_count(agent, seen);
    let target = usize::from(agent.target_network_period > 0);
    let best = if patience > 0 { 3 } else { 0 };
    let own = 3 * (3 + target + best) * parameters + (1 + target) * rounded(agent, seen);
    let validated = (states as f64 * validation_fraction).ceil() as usize;
    let groups = threads.min(sensors);
    let work = batch_work(agent, agent.batch_size, sensors.div_ceil(groups.max(1)), seen);
    let traced = if agent.traces.is_empty() { 0 } else { states * seen };
    4 * (sensors * own + groups * (work + validated) + traced) as u64 + 16 * states as u64
}

fn population_bytes(
    agent: &AgentConfig,
    size: usize,
    sensors: usize,
    width: usize,
    states: usize,
) -> u64 {
    let seen = agent.seen_width(width);
    let parameters = parameter_count(agent, seen);
    let target = usize::from(agent.target_network_period > 0);
    // The copy that is written, and its serialised bytes.
    let own = 3 * (3 + target) * parameters + (1 + target) * rounded(agent, seen);
    let work = batch_work(agent, agent.transitions_per_update(), size, seen);
    let traced = if agent.traces.is_empty() { 0 } else { states * seen };
    let buffer = if agent.replay == ReplayKind::Uniform { states } else { 0 };
    4 * (size * own + work + traced + buffer) as u64 + 8 * (states * sensors) as u64
}

/// Returns the number of values in a mini-batch of s and s', its activations and gradients, for `size` agents.
fn batch_work(agent: &AgentConfig, batch: usize, size: usize, seen: usize) -> usize {
    let sizes = layer_sizes(agent, seen);
    let parameters = parameter_count(agent, seen);
    let rows = 2 * batch + 1;
    let widest = sizes.iter().skip(1).max().copied().unwrap_or(1);
    match (agent.value_function, agent.precision) {
        (ValueFunction::Linear, _) => size * parameters,
        (ValueFunction::Mlp, Precision::F32) => {
            rows * (sizes.iter().sum::<usize>() + 2 * widest) + parameters
        }
        (ValueFunction::Mlp, Precision::Bf16) => {
            // Two bytes each: states and activations by rows. Those that are learned from and their errors count once
            // or twice more.
            let hidden: usize = sizes[1..sizes.len() - 1].iter().map(|&size| whole(size)).sum();
            rows * (seen + whole(seen) + BLOCK + hidden * 3 / 2) + parameters
        }
    }
}

/// Features per block in rounded storage.
const BLOCK: usize = 32;

/// Rounds the number of features up to whole blocks.
fn whole(features: usize) -> usize {
    features.next_multiple_of(BLOCK)
}

/// Returns the size of an agent's rounded parameters, as numbers of 4 bytes: plain and transposed weights, two bytes
/// each.
fn rounded(agent: &AgentConfig, seen: usize) -> usize {
    match agent.precision {
        Precision::F32 => 0,
        Precision::Bf16 => {
            let sizes = layer_sizes(agent, seen);
            sizes.windows(2).map(|pair| (whole(pair[0]) + 1) * whole(pair[1])).sum()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pre_training_grows_with_what_is_kept() {
        let agent = AgentConfig { batch_size: 4, hidden_units: 8, ..AgentConfig::default() };
        let settings = PretrainSettings { epochs: 1, patience: 0, validation_fraction: 0.1 };
        let work = 9 * (27 + 16) + 169;
        let one = 4 * (9 * 169 + work + 100) + 16_000;
        assert_eq!(
            pretraining_bytes(&agent, settings, 1, 10, 1000, 2),
            one,
            "no more threads than agents"
        );
        assert_eq!(
            pretraining_bytes(&agent, settings, 2, 10, 1000, 2),
            one + 4 * (9 * 169 + work + 100)
        );
        let patient = PretrainSettings { patience: 3, ..settings };
        assert_eq!(pretraining_bytes(&agent, patient, 1, 10, 1000, 2), one + 4 * 9 * 169);
    }

    /// Returns the bytes of training with one sensor, over 1,000 states of 10 values.
    fn bytes_for_one_sensor(agents: &[AgentConfig]) -> u64 {
        training_bytes(agents, 1, 10, 1000)
    }

    #[test]
    fn the_largest_population_counts() {
        let small = AgentConfig { batch_size: 4, hidden_units: 8, ..AgentConfig::default() };
        // 10 · 8 + 8 + 8 · 8 + 8 + 8 + 1 = 169 parameters; 9 rows of 10 + 8 + 8 + 1 values and two of 8.
        let expected = 4 * (9 * 169 + 9 * (27 + 16) + 169 + 1000) + 8 * 1000;
        assert_eq!(bytes_for_one_sensor(std::slice::from_ref(&small)), expected);
        let faster = AgentConfig { learning_rate: 0.5, ..small.clone() };
        assert_eq!(
            bytes_for_one_sensor(&[small.clone(), faster]),
            expected + 4 * 9 * 169,
            "in one population"
        );
        let other = AgentConfig { gamma: 0.5, ..small.clone() };
        assert_eq!(bytes_for_one_sensor(&[small.clone(), other]), expected, "one after the other");
        let traced = AgentConfig { traces: vec![0.9], ..small.clone() };
        assert!(bytes_for_one_sensor(&[traced]) > expected + 4 * 20 * 1000);
        // 32 · 32 + 32 three times; 9 rows of 10 + 32 + 32 + 96 values instead of the 43 above.
        let rounded = AgentConfig { precision: Precision::Bf16, ..small.clone() };
        assert_eq!(bytes_for_one_sensor(&[rounded]), expected + 4 * (3 * 33 * 32 + 9 * (170 - 43)));
        let sensors = training_bytes(&[small], 3, 10, 1000);
        assert_eq!(sensors, expected + 2 * (4 * 9 * 169 + 8 * 1000));
    }
}
