//! A held-out period of a study of agents that act, as it was read and as it was judged.

use calib_control::{Decisions, RecordedReturn};
use calib_core::Frames;
use calib_files::Fingerprint;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The fewest decisions of a period that may speak against a choice. Our choice.
const FEWEST_DECISIONS: usize = 20;

/// A held-out period beside the training range.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub(super) struct HeldOutPeriod {
    /// Name of the deployment; none for a period without a name.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) deployment: Option<String>,
    /// Fingerprint of its states, rewards and terminals.
    pub(super) log: Fingerprint,
    /// Number of recorded decisions.
    pub(super) decisions: usize,
    /// Share of them in states that no decision of the training range covers, whatever the actions.
    pub(super) uncovered: f64,
    /// Return of the recorded behaviour.
    pub(super) behaviour: RecordedReturn,
    /// Mean reward of a recorded step.
    pub(super) mean_reward: f64,
}

impl HeldOutPeriod {
    /// Returns its name for people.
    pub(super) fn name(&self) -> String {
        period_name(self.deployment.as_deref())
    }

    /// Whether it has the steps of an episode. The return of less is that of no episode.
    pub(super) fn has_an_episode(&self) -> bool {
        self.behaviour.episodes >= 1.0
    }

    /// Whether it has enough decisions for a share of them to mean something.
    pub(super) fn can_be_judged(&self) -> bool {
        self.decisions >= FEWEST_DECISIONS
    }

    /// Returns a warning if it has too few decisions.
    pub(super) fn warning(&self) -> Option<String> {
        let (name, decisions) = (self.name(), self.decisions);
        (!self.can_be_judged()).then(|| {
            format!(
                "the {name} has too few decisions to be a reason against the choice: {decisions}, of at least {FEWEST_DECISIONS}; name a longer \
                 period"
            )
        })
    }

    /// Whether this is the result of such a log.
    pub(super) fn is_of(&self, log: &HeldOutLog) -> bool {
        (&self.deployment, &self.log) == (&log.deployment, &log.fingerprint)
    }
}

/// Returns "deployment april", or "held-out period" for one without a name.
pub(super) fn period_name(deployment: Option<&str>) -> String {
    deployment.map_or_else(|| "held-out period".to_owned(), |name| format!("deployment {name}"))
}

/// The rows of a held-out period.
pub(super) struct HeldOutRows {
    /// Its states, normalised as those of the training range.
    pub(super) frames: Frames,
    /// Fingerprint of its states.
    pub(super) states: Fingerprint,
    /// The recorded columns of `[control]`, `[columns][rows]`.
    pub(super) recorded: Vec<Vec<f64>>,
}

/// The decisions that were recorded in a held-out period.
pub(super) struct HeldOutLog {
    pub(super) deployment: Option<String>,
    /// They have a single action, because it does not matter here which one was taken.
    pub(super) decisions: Decisions,
    pub(super) fingerprint: Fingerprint,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_few_decisions_are_warned_of() {
        let recorded =
            r#"{ "mean": 1.0, "interval": null, "episodes": 0.5, "best": null, "worst": null }"#;
        let mut period = HeldOutPeriod {
            deployment: Some("june".to_owned()),
            log: Fingerprint::of(b"june"),
            decisions: 19,
            uncovered: 1.0,
            behaviour: serde_json::from_str(recorded).expect("a return"),
            mean_reward: 1.0,
        };
        assert!(!period.can_be_judged() && !period.has_an_episode());
        let warning = period.warning().expect("it is short");
        assert!(warning.starts_with("the deployment june has too few decisions"), "{warning}");
        assert!(warning.contains("19, of at least 20"), "{warning}");
        period.decisions = 20;
        assert_eq!(period.warning(), None);
    }
}
