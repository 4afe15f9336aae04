use toml::Value;

use crate::given::parsed;

/// Number of ensemble members.
const MEMBERS: usize = 5;

/// Sections for which a model is proposed. All but fine-tuning (`pretrain`) need one. For fine-tuning, log replay chose well up to 93
/// days ahead with a year of log (docs/validity.md), and a model was the safer choice with a month (docs/fine-tuning.md). With a
/// model, the verdict compares both.
const SECTIONS: [&str; 5] = ["representation", "dynamics", "rollout", "models", "pretrain"];

/// Keys of `[sweep]` for runs in a model.
const SWEEP_KEYS: [&str; 3] = ["member_runs", "network_runs", "start"];

/// Selection rules that use log replay.
const RULES_OF_THE_LOG: [&str; 2] = ["log_replay", "one_standard_error"];

/// Whether a study that `calib init` proposes has a model. For agents that only predict, log replay chooses as well as any
/// model: docs/validity.md.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProposedModel {
    /// No model: log replay decides.
    None,
    /// An ensemble of neighbours, because a given key needs a model.
    Ensemble,
}

impl ProposedModel {
    /// Chooses for a study with these keys, `SECTION.KEY=VALUE`: no model, unless a key is about a model.
    pub fn for_given(given: &[String]) -> Self {
        let keys = given.iter().filter_map(|text| {
            let (key, value) = text.split_once('=')?;
            Some((key.trim(), plain(value.trim())))
        });
        let mut model = Self::None;
        for (key, value) in keys {
            if key == "model.kind" && value == "none" {
                return Self::None;
            }
            if is_about_a_model(key, &value) {
                model = Self::Ensemble;
            }
        }
        model
    }

    /// Returns the number of members of the model.
    pub(crate) const fn members(self) -> usize {
        match self {
            Self::None => 0,
            Self::Ensemble => MEMBERS,
        }
    }

    /// Returns the number of runs per member: `wanted`, or 0 without a model.
    pub(crate) const fn runs(self, wanted: usize) -> usize {
        match self {
            Self::None => 0,
            Self::Ensemble => wanted,
        }
    }
}

/// Whether a model is proposed for a key.
fn is_about_a_model(key: &str, value: &str) -> bool {
    match key.split_once('.') {
        Some(("model", key)) => key != "period",
        Some(("sweep", "log_replay_runs")) => value == "0",
        Some(("sweep", key)) => SWEEP_KEYS.contains(&key),
        Some(("evaluate", "rule")) => !RULES_OF_THE_LOG.contains(&value),
        Some((section, _)) => SECTIONS.contains(&section),
        None => key == "model" || SECTIONS.contains(&key),
    }
}

/// Removes the quotes of a value, if it has any.
fn plain(value: &str) -> String {
    parsed(value).as_ref().and_then(Value::as_str).unwrap_or(value).to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn proposed(given: &[&str]) -> ProposedModel {
        let given: Vec<String> = given.iter().map(|&text| text.to_owned()).collect();
        ProposedModel::for_given(&given)
    }

    #[test]
    fn a_model_is_proposed_where_something_is_asked_for_that_only_one_can_do() {
        for nothing in [
            &[][..],
            &["data.time_zone=Europe/Paris", "agent.gamma=0.5", "sweep.steps=900"],
            &["evaluate.rule=log_replay"],
            &["evaluate.rule=\"one_standard_error\""],
            &["sweep.log_replay_runs=9", "model.period={ start = 2024-01-01 }"],
            &["model.kind=none"],
            &["model.kind = \"none\"", "rollout.steps=9"],
        ] {
            assert_eq!(proposed(nothing), ProposedModel::None, "{nothing:?}");
        }
        for model in [
            "model.kind=nn",
            "model.members=3",
            "representation.kind=laplacian",
            "rollout.start=calendar_month",
            "dynamics.epochs=3",
            "pretrain.epochs=100",
            "sweep.member_runs=4",
            "sweep.start=recent",
            "sweep.log_replay_runs=0",
            "evaluate.rule=pooled",
            "evaluate.rule=\"worst_rank\"",
        ] {
            assert_eq!(proposed(&["agent.gamma=0.5", model]), ProposedModel::Ensemble, "{model}");
        }
    }
}
