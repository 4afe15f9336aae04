//! What a verdict says of simple predictors beside the chosen agent.

use calib_agent::SimplePredictor;
use calib_core::number;
use calib_stats::{Estimate, Interval};

use super::sentence::{chance_of_change, changed, listed};
use super::{Simpler, Verdict};

/// If the agent's error is below this share of the predictor's, more windows may be
/// worthwhile. It equals the limit for "no worse". Our choice.
pub(super) const WORTH_MENTIONING: f64 = 0.98;

/// A predictor whose error is within this factor of the agent's is as good, whatever the windows show. Our choice.
const AS_WELL: f64 = 1.01;

/// A few windows decide a mean error if its ratio differs from the geometric mean ratio by more than this factor.
const FEW_DECIDE: f64 = 2.0;

impl Simpler {
    /// Returns the error of the predictor divided by that of the agent, if both are finite and not 0.
    fn inverse(&self) -> Option<Estimate> {
        let ratio = self.ratio.filter(|ratio| ratio.value.is_finite() && ratio.value != 0.0)?;
        let interval = ratio
            .interval
            .map(|interval| Interval { low: 1.0 / interval.high, high: 1.0 / interval.low });
        Some(Estimate { value: 1.0 / ratio.value, interval })
    }

    /// Whether windows show that the predictor is better, and not by chance. A single window shows nothing.
    pub(super) fn is_shown(&self) -> bool {
        self.is_better && self.ratio.is_some_and(|ratio| ratio.interval.is_some())
    }

    /// Formats the predictor's error relative to the agent's: "42 % less".
    fn difference(&self) -> Option<String> {
        Some(changed(self.inverse()?.value))
    }

    /// Whether the agent has less error. The difference is above rounding, but may be chance.
    pub(super) fn may_be_worse(&self) -> bool {
        !self.is_better && self.ratio.is_some_and(|ratio| ratio.value < WORTH_MENTIONING)
    }

    /// Whether the agent has at most 1 % more error than the predictor, or less.
    fn does_as_well(&self) -> bool {
        self.ratio.is_some_and(|ratio| ratio.value < AS_WELL)
    }

    /// Whether a few windows make the mean over windows disagree with the geometric mean: in size, or about which of
    /// the two is better.
    fn is_decided_by_few(&self) -> bool {
        let means = self.typical_errors.map(|[predictor, agent]| agent / predictor);
        means.zip(self.ratio).is_some_and(|(means, ratio)| {
            let apart = means / ratio.value;
            let disagree = (means < 1.0 && ratio.value > 1.0) || (means > 1.0 && ratio.value < 1.0);
            disagree || !(1.0 / FEW_DECIDE..=FEW_DECIDE).contains(&apart)
        })
    }

    /// Returns the typical errors of both as a sentence.
    fn typical(&self) -> String {
        let few = if self.is_decided_by_few() {
            ", as a mean over windows, which the worst of them decide"
        } else {
            ""
        };
        self.typical_errors.map_or_else(String::new, |[predictor, agent]| {
            format!(
                " Typical error of the predicted mean, in the sensor's unit{few}: {} {}, the agent {}.",
                self.predictor.label(),
                number(predictor),
                number(agent)
            )
        })
    }

    /// Returns the sentence that the agent matches the predictor.
    pub(super) fn matched_sentence(&self) -> Option<String> {
        let ratio = self.ratio.filter(|ratio| ratio.value.is_finite() && ratio.value != 0.0)?;
        Some(format!(
            "It has {} error than {}, the simple predictor that the log prefers{}.{}{}",
            changed(ratio.value),
            self.predictor.label(),
            chance_of_change(ratio),
            self.typical(),
            self.other_start()
        ))
    }

    /// Returns the sentence that the agent starts from another predictor; empty if it does not.
    fn other_start(&self) -> String {
        self.starts_from.map_or_else(String::new, |start| {
            format!(
                " The agent starts from {} instead, which cross-validation in the training range prefers.",
                start.label()
            )
        })
    }

    /// Returns the meaning of the comparison, and what to try. `why_of_log` is there if the windows are those of the log.
    pub(super) fn plain(&self, why_of_log: Option<&str>) -> String {
        let name = self.predictor.label();
        let interval = self.inverse().map_or_else(String::new, chance_of_change);
        let difference = self.difference().unwrap_or_else(|| "less".to_owned());
        let [typical, start] = [self.typical(), self.other_start()];
        let chance = if self.is_shown() { "" } else { ", which could be chance" };
        let hint = if self.may_be_worse() && why_of_log.is_some() {
            " Held-out data would decide: hold some out (data.held_out, or data.train_fraction)."
                .to_owned()
        } else if self.may_be_worse() {
            " More held-out windows would decide: hold out more (data.held_out, or data.train_fraction), or use shorter runs (sweep.steps)."
                .to_owned()
        } else if self.has_baseline {
            String::new()
        } else {
            let baseline = self.predictor.name();
            format!(
                " To improve on it, let the agent start from it: agent.baseline = \"{baseline}\"."
            )
        };
        let (place, why) = match why_of_log {
            Some(why) => ("windows of the log", format!(" {why}")),
            None => ("held-out data", String::new()),
        };
        format!(
            "On {place} {name} has {difference} error than the chosen agent{chance}{interval}.{typical}{start}{why}{hint}"
        )
    }
}

impl Verdict {
    /// Returns the advice if a simple predictor is as good or better.
    pub(super) fn simpler_headline(&self, simpler: &Simpler) -> String {
        let name = simpler.predictor.label();
        let sensor = &self.sensor;
        let (ground, windows) = if self.is_of_log() {
            (", on the evidence of the log", "windows")
        } else {
            ("", "held-out windows")
        };
        if let Some(windows) = self.runaway_windows(simpler) {
            return format!(
                "Use {name} for {sensor}, not an agent: in {windows} the agent's error was more than ten times as large."
            );
        }
        match simpler.difference() {
            Some(difference) if simpler.is_better && !simpler.is_shown() => format!(
                "Use {name} for {sensor} for now{ground}: it has {difference} error than the agent, in too few {windows} to be sure."
            ),
            Some(_) if simpler.is_better && simpler.does_as_well() => {
                format!(
                    "Use {name} for {sensor}{ground}: it does as well as the agent and is simpler."
                )
            }
            Some(difference) if simpler.is_better => {
                format!("Use {name} for {sensor}, not an agent{ground}: it has {difference} error.")
            }
            _ if simpler.is_better => format!("Use {name} for {sensor}, not an agent{ground}."),
            _ if simpler.may_be_worse() => {
                format!(
                    "Use {name} for {sensor} for now{ground}: an agent may do better, but it is not shown."
                )
            }
            _ => format!("Use {name} for {sensor}{ground}: no agent is shown to do better."),
        }
    }

    /// Returns the windows in which the agent has more than ten times the error of a predictor: "2 of 4 held-out windows". `None` if
    /// there are no such windows, or all are. A mean over all windows says little then.
    fn runaway_windows(&self, simpler: &Simpler) -> Option<String> {
        let windows = self.online.as_ref().filter(|_| !self.is_of_log())?.windows;
        let some = simpler.runaway_windows;
        (some > 0 && some < windows).then(|| format!("{some} of {windows} held-out windows"))
    }

    /// Compares the agent's error with that of the best simple predictor on the held-out windows, if the log prefers another one.
    /// Only the held-out data shows which predictor is best.
    pub(super) fn beside_the_best(&self) -> Option<String> {
        let matched = self.matched.as_ref()?.predictor;
        let agent = self.online.as_ref().filter(|_| !self.is_of_log())?.chosen_error;
        let best = self
            .simple
            .iter()
            .filter(|row| row.error.is_finite() && row.error > 0.0)
            .reduce(|best, row| if row.error < best.error { row } else { best })?;
        if best.predictor == matched || !agent.is_finite() {
            return None;
        }
        Some(format!(
            "The best simple predictor on these windows is {}. The agent has {} error than that.",
            best.predictor.label(),
            changed(agent / best.error)
        ))
    }

    /// Returns the recommended predictor and the sensor: "persistence for PIT300".
    pub(super) fn instead(&self) -> String {
        let simpler = self.simpler.as_ref().map(|simpler| simpler.predictor);
        let name = simpler.or(self.frozen).map_or("a simple predictor", SimplePredictor::label);
        format!("{name} for {}", self.sensor)
    }

    /// Returns the results of all simple predictors as a sentence.
    pub(super) fn simple_sentence(&self) -> Option<String> {
        let (windows, agent) = match (self.agent_on_log, &self.online) {
            (Some(agent), _) => ("windows of the log, as geometric means", agent),
            (None, Some(online)) => ("the same windows", online.chosen_error),
            (None, None) => return None,
        };
        if self.simple.is_empty() {
            return None;
        }
        let each: Vec<String> = self
            .simple
            .iter()
            .map(|row| format!("{} {}", row.predictor.label(), number(row.error)))
            .collect();
        Some(format!(
            "NRMSE of simple predictors on {windows}: {}. The agent: {}.",
            listed(&each),
            number(agent)
        ))
    }

    /// Whether simple predictors are compared on windows of the log, because held-out data can show nothing.
    pub(super) const fn is_of_log(&self) -> bool {
        self.agent_on_log.is_some()
    }

    /// Returns the reason why simple predictors are compared on windows of the log, if they are.
    pub(super) fn why_of_log(&self) -> Option<&'static str> {
        self.is_of_log().then_some(if self.online.is_none() {
            "No data was held out, so this is the evidence of the log."
        } else {
            "Its values do not vary in the held-out data, so this is the evidence of the log."
        })
    }
}
