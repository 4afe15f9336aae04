//! The study's configuration of agents that an external program implements.

use std::{borrow::Cow, collections::BTreeMap};

use super::{
    AgentConfig, AgentConfigError,
    kind::{AgentKind, STATES_PER_MESSAGE, TIMEOUT_SECS},
    require,
};

/// Hyperparameters that only calib's own agents have.
const OWN_FIELDS: [&str; 22] = [
    "lambda",
    "meta_step_size",
    "rate_bound",
    "rate_decay",
    "baseline",
    "halve_after",
    "traces",
    "value_function",
    "hidden_layers",
    "hidden_units",
    "precision",
    "optimiser",
    "learning_rate",
    "beta1",
    "beta2",
    "epsilon",
    "weight_decay",
    "replay",
    "replay_capacity",
    "batch_size",
    "updates_per_step",
    "target_network_period",
];

impl AgentConfig {
    /// Whether an external program implements the agents.
    pub fn is_external(&self) -> bool {
        self.kind == AgentKind::External
    }

    /// Returns the part of the configuration that decides the results: everything but calib's time limit
    /// and the discount factors of other sensors.
    pub fn identity(&self) -> Cow<'_, Self> {
        if self.timeout_secs == TIMEOUT_SECS && self.gammas.is_empty() {
            return Cow::Borrowed(self);
        }
        Cow::Owned(Self { timeout_secs: TIMEOUT_SECS, gammas: BTreeMap::new(), ..self.clone() })
    }

    #[expect(clippy::trivially_copy_pass_by_ref, reason = "serde hands fields over so")]
    pub(super) fn is_default_message(states: &usize) -> bool {
        *states == STATES_PER_MESSAGE
    }

    #[expect(clippy::trivially_copy_pass_by_ref, reason = "serde hands fields over so")]
    pub(super) fn is_default_timeout(secs: &f64) -> bool {
        *secs == TIMEOUT_SECS
    }

    /// Checks that the keys of external programs are set exactly where there is a program, and that the
    /// program sees every key.
    pub(super) fn check_kind(&self) -> Result<(), AgentConfigError> {
        let external = self.is_external();
        let names_a_program = self.command.first().is_some_and(|program| !program.is_empty());
        require(
            names_a_program == external,
            "command",
            &format!("{:?}", self.command),
            if external {
                "a program and its arguments, such as [\"python3\", \"agent.py\"]"
            } else {
                "none, or kind = \"external\""
            },
        )?;
        let of_programs = "none, or kind = \"external\"";
        let own_names = self.parameters.keys().map(String::as_str).collect::<Vec<_>>().join(", ");
        require(external || self.parameters.is_empty(), "parameters", &own_names, of_programs)?;
        require(
            !self.parameters.contains_key("gamma"),
            "parameters",
            &"gamma",
            "other names: every agent is told agent.gamma",
        )?;
        require(
            (1..=1 << 20).contains(&self.states_per_message),
            "states_per_message",
            &self.states_per_message,
            "1 to 1048576",
        )?;
        require(
            self.timeout_secs > 0.0 && self.timeout_secs <= 1e6,
            "timeout_secs",
            &self.timeout_secs,
            "a number above 0 and at most 1e6",
        )?;
        if external { self.check_nothing_is_lost() } else { Ok(()) }
    }

    /// Checks that no key is set that only calib's own agents use: the program would not see it.
    fn check_nothing_is_lost(&self) -> Result<(), AgentConfigError> {
        let default = Self { gamma: self.gamma, ..Self::default() };
        let own = Self { kind: AgentKind::Td, ..self.clone() }.fields();
        let unset = default.fields();
        let set = unset.iter().find(|(field, value)| own.get(*field) != Some(value));
        let Some((field, _)) = set else { return Ok(()) };
        Err(AgentConfigError {
            field: OWN_FIELDS.into_iter().find(|own_field| own_field == field).unwrap_or("kind"),
            got: own[field].to_string(),
            expected: "nothing with kind = \"external\": what a program is to know stands in [agent.parameters]"
                .to_owned(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn external() -> AgentConfig {
        AgentConfig {
            kind: AgentKind::External,
            command: vec!["python3".to_owned(), "agent.py".to_owned()],
            parameters: BTreeMap::from([("rate".to_owned(), 0.1.into())]),
            ..AgentConfig::default()
        }
    }

    #[test]
    fn programs_have_hyperparameters_of_their_own() {
        let agent = external();
        assert_eq!(agent.check(), Ok(()));
        assert_eq!(agent.fields().keys().collect::<Vec<_>>(), ["gamma", "rate"]);
        let written = serde_json::to_value(&agent).expect("serialises");
        assert_eq!(serde_json::from_value::<AgentConfig>(written).expect("reads"), agent);
        let patient = AgentConfig { timeout_secs: 5.0, ..agent.clone() };
        assert_eq!(*patient.identity(), agent);
        assert_eq!(*agent.identity(), agent);
        let default = serde_json::to_value(AgentConfig::default()).expect("serialises");
        for field in ["kind", "command", "parameters", "states_per_message", "timeout_secs"] {
            assert_eq!(default.get(field), None, "known as before");
        }
    }

    /// Returns the message with which `config` is refused after a change.
    fn refusal(change: fn(&mut AgentConfig), mut config: AgentConfig) -> String {
        change(&mut config);
        config.check().expect_err("refused").to_string()
    }

    #[test]
    fn what_a_program_would_not_see_is_refused() {
        assert_eq!(
            refusal(|config| config.learning_rate = 0.5, external()),
            "agent hyperparameter `learning_rate`: expected nothing with kind = \"external\": what a program is to \
             know stands in [agent.parameters], got 0.5"
        );
        assert!(refusal(|config| config.command.clear(), external()).contains("`command`"));
        assert!(
            refusal(|config| config.kind = AgentKind::Td, external())
                .contains("kind = \"external\"")
        );
        let own = AgentConfig::default();
        assert!(
            refusal(|config| drop(config.parameters.insert("a".to_owned(), 1.into())), own)
                .contains("got a")
        );
        assert!(
            refusal(
                |config| drop(config.parameters.insert("gamma".to_owned(), 1.into())),
                external()
            )
            .contains("agent.gamma")
        );
        assert!(
            refusal(|config| config.states_per_message = 0, external()).contains("1 to 1048576")
        );
        assert!(refusal(|config| config.timeout_secs = f64::NAN, external()).contains("above 0"));
        let unset = AgentConfig::default().fields();
        let all: Vec<&String> = unset.keys().filter(|field| *field != "gamma").collect();
        let mut told = OWN_FIELDS;
        told.sort_unstable();
        assert_eq!(all, told.iter().collect::<Vec<_>>(), "every key of calib's own agents is told");
    }
}
