use crate::{lines::list, written::quoted};

/// Columns of a log of decisions that are not part of the state.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DecisionColumns {
    /// Columns of the action taken in a row.
    pub actions: Vec<String>,
    /// Column of the reward for the step that led to a row. `None` if the reward has terms, which are given as `control.reward`; their
    /// columns may be part of the state.
    pub reward: Option<String>,
    /// Column that is not 0 where an episode ended.
    pub terminal: Option<String>,
    /// Column of the probability of the action taken.
    pub probability: Option<String>,
}

impl DecisionColumns {
    /// Returns all columns, each with the argument of `calib init` that names it.
    pub fn with_arguments(&self) -> impl Iterator<Item = (&'static str, &String)> {
        let actions = self.actions.iter().map(|name| ("--action", name));
        let reward = self.reward.iter().map(|name| ("--reward", name));
        let terminal = self.terminal.iter().map(|name| ("--terminal", name));
        let probability = self.probability.iter().map(|name| ("--probability", name));
        actions.chain(reward).chain(terminal).chain(probability)
    }

    /// Whether a column is one of them.
    pub fn contains(&self, name: &str) -> bool {
        self.with_arguments().any(|(_, own)| own == name)
    }

    /// Returns the keys of `[control]` that name the columns, each with its value as TOML. A reward of terms is not among them.
    pub fn keys(&self) -> Vec<(&'static str, String)> {
        let actions: Vec<String> = self.actions.iter().map(|name| quoted(name)).collect();
        let mut keys = vec![("actions", list(&actions))];
        keys.extend(self.reward.iter().map(|name| ("reward", quoted(name))));
        keys.extend(self.terminal.iter().map(|name| ("terminal", quoted(name))));
        keys.extend(self.probability.iter().map(|name| ("probability", quoted(name))));
        keys
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_keys_of_control() {
        let columns = DecisionColumns {
            actions: vec!["dose".to_owned(), "a \"b\"".to_owned()],
            reward: Some("gain".to_owned()),
            terminal: Some("stopped".to_owned()),
            probability: None,
        };
        let keys = [
            ("actions", r#"["dose", "a \"b\""]"#.to_owned()),
            ("reward", r#""gain""#.to_owned()),
            ("terminal", r#""stopped""#.to_owned()),
        ];
        assert_eq!(columns.keys(), keys);
        assert!(columns.contains("stopped") && !columns.contains("level"));
        let of_terms = DecisionColumns { reward: None, ..columns };
        let named: Vec<&str> = of_terms.keys().into_iter().map(|(key, _)| key).collect();
        assert_eq!(named, ["actions", "terminal"]);
        assert!(!of_terms.contains("gain"), "it may be part of the state");
    }
}
