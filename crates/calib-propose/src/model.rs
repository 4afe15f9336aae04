use toml::Value;

use crate::given::parsed;

/// Members of an ensemble.
const MEMBERS: usize = 5;

/// Sections of a study that only one with a model has. Fine-tuning is among them: how an agent goes on long after it was trained, a model
/// of what the plant has been like since can tell, and the replayed log cannot.
const SECTIONS: [&str; 5] = ["representation", "dynamics", "rollout", "models", "pretrain"];

/// Keys of `[sweep]` that say how much is run in a model.
const SWEEP_KEYS: [&str; 3] = ["member_runs", "network_runs", "start"];

/// Rules that choose by the replayed log.
const RULES_OF_THE_LOG: [&str; 2] = ["log_replay", "one_standard_error"];

/// Whether a study that `calib init` proposes has a model. Agents that only predict are chosen on the replayed log as well as by any
/// model: docs/validity.md.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProposedModel {
    /// The replayed log decides.
    None,
    /// An ensemble of neighbours, because something was asked for that only a model can do.
    Ensemble,
}

impl ProposedModel {
    /// For a study with these keys, `SECTION.KEY=VALUE`: none, unless one of them is about a model.
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

    /// Members of the model.
    pub(crate) const fn members(self) -> usize {
        match self {
            Self::None => 0,
            Self::Ensemble => MEMBERS,
        }
    }

    /// Runs in each of its members, of so many that are wanted.
    pub(crate) const fn runs(self, wanted: usize) -> usize {
        match self {
            Self::None => 0,
            Self::Ensemble => wanted,
        }
    }
}

/// Whether a key asks for what only a model can do.
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

/// A value without the quotes that it may have.
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
