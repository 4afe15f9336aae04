//! Hyperparameters that a proposed study could vary beside the learning rate.

use crate::{ProposedAgent, Size, lines::Lines};

/// Part of a run after which a step size that decays is a half. Our choice.
const HALVED_AFTER: usize = 4;

/// Writes a line of `[sweep.grid]` for each hyperparameter that suits the agent, as a comment. The default is among the
/// values. The time of the study is planned without these lines.
pub(crate) fn other_axes(size: &Size, text: &mut Lines) {
    let halved = (size.steps / HALVED_AFTER).max(1);
    let axes = match size.agent {
        // SwiftTD has neither a replay buffer nor step sizes that decay by a schedule.
        ProposedAgent::Linear => vec![(
            "lambda = [0, 0.9]".to_owned(),
            "whether errors also correct earlier predictions, by eligibility traces",
        )],
        ProposedAgent::Network => vec![
            (
                format!("halve_after = [0, {halved}]"),
                "whether step sizes decay, to a half in a quarter of a run",
            ),
            (
                "replay = [\"uniform\", \"none\"]".to_owned(),
                "whether the agent learns from stored transitions",
            ),
        ],
    };
    for (axis, why) in axes {
        let why = format!("{why}: without its first #, this line doubles settings and time");
        text.comment_after(&format!("# {axis}"), &why);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ProposedModel;

    #[test]
    fn each_line_is_one_of_the_grid_without_its_mark() {
        let [linear, network] = [ProposedAgent::Linear, ProposedAgent::Network].map(|agent| {
            let mut text = Lines::default();
            other_axes(&Size::trial(agent, ProposedModel::None, 1_000, 1), &mut text);
            let lines = text.0.lines().map(|line| line.strip_prefix("# ").expect("a comment"));
            let text = lines.collect::<Vec<_>>().join("\n");
            toml::from_str::<toml::Table>(&text).expect("TOML")
        });
        assert_eq!(linear.keys().collect::<Vec<_>>(), ["lambda"]);
        assert_eq!(linear["lambda"][1].as_float(), Some(0.9));
        assert_eq!(network.keys().collect::<Vec<_>>(), ["halve_after", "replay"]);
        assert_eq!(network["halve_after"][1].as_integer(), Some(250));
        assert_eq!(network["replay"][0].as_str(), Some("uniform"));
    }
}
