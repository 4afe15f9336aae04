use calib_control::{Algorithm, StartRows, two_digits};
use calib_core::Timestamp;

use crate::{
    Cut, DecisionColumns, LogDraft, ProposedControl,
    lines::{Lines, number, numbers},
};

/// A study of acting agents whose comments give the reason for each choice.
#[derive(Clone, Copy, Debug)]
pub struct ControlDraft<'a> {
    /// The log.
    pub log: LogDraft<'a>,
    /// Roles of its columns.
    pub columns: &'a DecisionColumns,
    /// `control.levels` and its reason; `None` if every combination of values is an action.
    pub levels: Option<&'a (usize, String)>,
    /// Settings that follow from the decisions; `None` before the decisions are read.
    pub proposed: Option<&'a ProposedControl>,
    /// `control.steps`.
    pub steps: usize,
    /// Reason for this number of steps.
    pub steps_reason: &'a str,
}

impl ControlDraft<'_> {
    /// Returns the text of the study file.
    pub fn text(&self) -> String {
        let mut text = Lines::default();
        text.comment(
            "Proposed by `calib init`, which looked at the log and at the decisions in it.",
        );
        text.comment("Every value has its reason beside it, and every one may be changed: docs/study.md has all keys.");
        text.line("");
        text.key("seed", "0", "root of all randomness");
        self.log.write(&mut text, |text| self.range(text));
        let (limit, why) = &self.log.cleaning.fill_limit;
        text.section("preprocess");
        text.key("missing", "\"forward_fill\"", "values stand until the next");
        text.key("fill_limit", &limit.to_string(), why);
        text.key("outliers", "\"keep\"", "a jump may be what an action did");
        self.control(&mut text);
        if let Some(proposed) = self.proposed {
            agents(proposed, &mut text);
        }
        text.0
    }

    /// Writes a training range that covers the whole scope. Nothing is held out, because no log can
    /// be replayed for acting agents.
    fn range(&self, text: &mut Lines) {
        let scope = self.log.scope;
        if !scope.is_part {
            let why = "agents act in models of the log, so nothing is held out";
            return text.key("train_fraction", "1.0", why);
        }
        let times = &self.log.sketch.timestamps[scope.rows.clone()];
        let period = (1e6 * self.log.sketch.period_secs).ceil() as i64;
        let end = Timestamp::from_micros(times[times.len() - 1].as_micros() + period);
        text.key("train", &Cut::toml(&[times[0], end], self.log.sketch.clock.zone()), "");
    }

    fn control(&self, text: &mut Lines) {
        text.section("control");
        for (key, value) in self.columns.keys() {
            text.key(key, &value, "");
        }
        if let Some((levels, why)) = self.levels {
            text.key("levels", &levels.to_string(), why);
        }
        if let Some(ProposedControl { timeout, start, .. }) = self.proposed {
            text.key("timeout", &timeout.0.to_string(), &timeout.1);
            let value = match start.0 {
                StartRows::Episodes => "\"episodes\"",
                StartRows::Anywhere => "\"anywhere\"",
            };
            text.key("start", value, &start.1);
        }
        text.key("steps", &self.steps.to_string(), self.steps_reason);
    }
}

/// Writes the default agent and the settings of the sweep.
fn agents(proposed: &ProposedControl, text: &mut Lines) {
    let ProposedControl { gamma, algorithm, without_pairs, spread, settings, .. } = proposed;
    let has_temperature = algorithm.uses("temperature");
    text.section("control.agent");
    text.comment("The default that a choice is compared with.");
    text.key("gamma", &number(gamma.0), &gamma.1);
    let by_spread = format!(
        "in units of return: the spread of recorded returns is {}",
        number(two_digits(*spread))
    );
    let [step_size_reason, step_sizes_reason] = if *algorithm == Algorithm::DeepQLearning {
        ["Adam's usual one for a network, whatever the returns are", "less, and more"]
    } else {
        [by_spread.as_str(), "by the same spread"]
    };
    text.key("step_size", &number(settings.step_size), step_size_reason);
    if has_temperature {
        text.key("temperature", &number(settings.temperature), &by_spread);
    }
    if let Some(why) = without_pairs {
        text.key("pairs", "false", why);
    }
    text.section("control.grid");
    text.key("step_size", &numbers(settings.step_sizes), step_sizes_reason);
    if has_temperature {
        text.key("temperature", &numbers(settings.temperatures), "by the same spread");
    }
    text.key(
        "initial_weight",
        &numbers(settings.initial_weights),
        "first values of 0 and of a few spreads: larger ones make agents explore more",
    );
}

#[cfg(test)]
mod tests {
    use calib_control::{AgentConfig, ProposedSettings};

    use super::*;
    use crate::{
        Cleaning, Scope,
        testing::{sketch, wave},
    };

    #[test]
    fn every_choice_stands_in_the_file_with_its_reason() {
        let sensors = sketch(2_000, &[("A", wave(40.0)), ("fixed", Box::new(|_| 3.0))]);
        let scope = Scope::of(&sensors).expect("channels");
        let columns = DecisionColumns {
            actions: vec!["dose".to_owned()],
            reward: Some("gain".to_owned()),
            terminal: None,
            probability: None,
        };
        let proposed = ProposedControl {
            timeout: (54, "the longest".to_owned()),
            start: (StartRows::Anywhere, "few episodes".to_owned()),
            gamma: (1.0, "they end".to_owned()),
            algorithm: Algorithm::ExpectedSarsa,
            without_pairs: Some("many columns".to_owned()),
            spread: 12.34,
            settings: ProposedSettings::for_spread(12.34, &AgentConfig::default(), 4),
        };
        let levels = (7, "any number".to_owned());
        let draft = ControlDraft {
            log: LogDraft {
                sketch: &sensors,
                path: "log.csv",
                scope: &scope,
                cleaning: &Cleaning::of(&sensors, &scope),
                missing_values: &[],
                angles: &[],
                clock: None,
            },
            columns: &columns,
            levels: Some(&levels),
            proposed: Some(&proposed),
            steps: 15_000,
            steps_reason: "about a minute",
        };
        let text = draft.text();
        let read: toml::Table = toml::from_str(&text).expect("TOML");
        assert_eq!(read["data"]["train_fraction"].as_float(), Some(1.0));
        assert_eq!(read["data"]["exclude"][0].as_str(), Some("fixed"));
        let control = &read["control"];
        assert_eq!(control["actions"][0].as_str(), Some("dose"));
        assert_eq!(control["levels"].as_integer(), Some(7));
        assert_eq!(control["timeout"].as_integer(), Some(54));
        assert_eq!(control["start"].as_str(), Some("anywhere"));
        assert_eq!(control["agent"]["pairs"].as_bool(), Some(false));
        assert_eq!(control["agent"]["step_size"].as_float(), Some(0.037));
        assert_eq!(control["grid"]["temperature"].as_array().map(Vec::len), Some(3));
        assert!(control.get("terminal").is_none());
        assert!(text.contains("the spread of recorded returns is 12"), "{text}");
        assert!(text.contains("# any number") && text.contains("# about a minute"), "{text}");
        let greedy = ProposedControl { algorithm: Algorithm::QLearning, ..proposed.clone() };
        let greedy = ControlDraft { proposed: Some(&greedy), ..draft }.text();
        let greedy: toml::Table = toml::from_str(&greedy).expect("TOML");
        for section in ["agent", "grid"] {
            let section = greedy["control"][section].as_table().expect("a section");
            assert!(section.contains_key("step_size") && !section.contains_key("temperature"));
        }
        let unread = ControlDraft { levels: None, proposed: None, ..draft }.text();
        let unread: toml::Table = toml::from_str(&unread).expect("TOML");
        assert!(unread["control"].get("grid").is_none(), "decisions are read first");
    }
}
