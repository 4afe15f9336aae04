//! Hyperparameters that a proposed study could vary beside the learning rate.

use toml::{Table, Value};

use crate::lines::Lines;

/// Part of a run after which a step size that decays is a half. Our choice.
const HALVED_AFTER: i64 = 4;

/// Optimisers with eligibility traces. calib refuses a replay buffer and step sizes that decay by a schedule with them.
const WITH_TRACES: [&str; 2] = ["true_online_td", "swift_td"];

/// A hyperparameter that a study could vary.
struct Axis {
    key: &'static str,
    /// The values as TOML. The default is among them.
    values: String,
    why: &'static str,
}

/// Writes a line of `[sweep.grid]` for each hyperparameter that suits the agent of `study`, as a comment. It leaves out
/// those that the study has already. The time of the study is planned without these lines.
pub(crate) fn other_axes(study: &Table, text: &mut Lines) {
    for Axis { key, values, why } in axes(study) {
        let own = at(study, &["agent", key]).or_else(|| at(study, &["sweep", "grid", key]));
        if own.is_none() {
            let why = format!("{why}: without its first #, this line doubles settings and time");
            text.comment_after(&format!("# {key} = {values}"), &why);
        }
    }
}

/// Returns the hyperparameters that have an effect on the agent of a study: none for a program of the user, or if the
/// grid varies the optimiser, because they would not have an effect on each of its agents.
fn axes(study: &Table) -> Vec<Axis> {
    let kind = at(study, &["agent", "kind"]).and_then(Value::as_str);
    if kind == Some("external") || at(study, &["sweep", "grid", "optimiser"]).is_some() {
        return Vec::new();
    }
    let optimiser = at(study, &["agent", "optimiser"]).and_then(Value::as_str);
    if optimiser.is_some_and(|name| WITH_TRACES.contains(&name)) {
        return vec![Axis {
            key: "lambda",
            values: "[0, 0.9]".to_owned(),
            why: "whether errors also correct earlier predictions, by eligibility traces",
        }];
    }
    let steps = at(study, &["sweep", "steps"]).and_then(Value::as_integer).unwrap_or(0);
    vec![
        Axis {
            key: "halve_after",
            values: format!("[0, {}]", (steps / HALVED_AFTER).max(1)),
            why: "whether step sizes decay, to a half in a quarter of a run",
        },
        Axis {
            key: "replay",
            values: "[\"uniform\", \"none\"]".to_owned(),
            why: "whether the agent learns from stored transitions",
        },
    ]
}

/// Returns the value at this path of keys, if the table has one.
fn at<'a>(table: &'a Table, path: &[&str]) -> Option<&'a Value> {
    let (last, sections) = path.split_last()?;
    let section = sections
        .iter()
        .try_fold(table, |table, section| table.get(*section).and_then(Value::as_table));
    section?.get(*last)
}

#[cfg(test)]
mod tests {
    use calib_core::Seed;
    use calib_study::{Job, Request};
    use calib_sweep::candidates;

    use super::*;
    use crate::given::with_given;

    const LINEAR: &str = r#"
[agent]
value_function = "linear"
optimiser = "swift_td"
replay = "none"
baseline = "best"
gamma = 0.9
learning_rate = 0

[sweep]
sensors = ["A"]
steps = 1000

[sweep.grid]
learning_rate = [0, 1e-4]
"#;

    /// Returns a study of a network.
    fn network() -> String {
        let network = "value_function = \"mlp\"\nhidden_units = 32\nbatch_size = 32";
        let linear = "value_function = \"linear\"\noptimiser = \"swift_td\"\nreplay = \"none\"";
        assert!(LINEAR.contains(linear));
        LINEAR.replace(linear, network)
    }

    /// Returns the lines that a study with the given keys offers, without their marks.
    fn offered(study: &str, given: &[&str]) -> String {
        let given: Vec<String> = given.iter().map(|&key| key.to_owned()).collect();
        let study: Table = toml::from_str(&with_given(study, &given)).expect("TOML");
        let mut text = Lines::default();
        other_axes(&study, &mut text);
        let lines = text.0.lines().map(|line| line.strip_prefix("# ").expect("a comment"));
        lines.collect::<Vec<_>>().join("\n")
    }

    /// Returns the keys that a study with the given keys offers.
    fn keys(study: &str, given: &[&str]) -> Vec<String> {
        let table: Table = toml::from_str(&offered(study, given)).expect("TOML");
        table.keys().cloned().collect()
    }

    #[test]
    fn a_study_is_valid_with_the_lines_that_it_offers() {
        assert_eq!(keys(LINEAR, &[]), ["lambda"]);
        assert_eq!(keys(&network(), &[]), ["halve_after", "replay"]);
        assert!(offered(&network(), &[]).contains("halve_after = [0, 250] "));
        let network = network();
        for (text, settings) in [(LINEAR, 4), (network.as_str(), 8)] {
            let text = format!("{text}{}\n", offered(text, &[]));
            let job = Job::of_text(Request::new("study.toml"), text).expect("known keys");
            let study = job.study();
            let all = candidates(&study.sweep, &study.agent, Seed::new(study.seed));
            let all = all.expect("valid agents");
            assert_eq!(all.len(), settings, "the default is among the values");
            assert!(all.iter().any(|candidate| candidate.is_default));
        }
    }

    #[test]
    fn no_line_is_offered_that_has_no_effect_or_whose_key_is_there() {
        let network = &network();
        assert_eq!(keys(LINEAR, &["agent.optimiser=true_online_td"]), ["lambda"]);
        // A linear study says already that there is no replay.
        assert_eq!(keys(LINEAR, &["agent.optimiser=adam"]), ["halve_after"]);
        assert_eq!(keys(network, &["agent.optimiser=sgd"]), ["halve_after", "replay"]);
        let online = ["agent.value_function=linear", "agent.optimiser=swift_td"];
        assert_eq!(keys(network, &online), ["lambda"]);
        assert_eq!(keys(network, &["agent.replay=none"]), ["halve_after"]);
        assert_eq!(keys(network, &["sweep.grid.halve_after=[0, 9]"]), ["replay"]);
        assert_eq!(keys(LINEAR, &["agent.lambda=0.5"]), [""; 0]);
        assert_eq!(keys(LINEAR, &["sweep.grid.lambda=[0.5, 0.9]"]), [""; 0]);
        assert_eq!(keys(network, &["sweep.grid.optimiser=[\"adam\", \"sgd\"]"]), [""; 0]);
        assert_eq!(keys(network, &["agent.kind=external"]), [""; 0]);
    }
}
