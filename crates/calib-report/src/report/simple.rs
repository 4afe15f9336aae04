//! Simple predictors beside the chosen agent.

use calib_agent::SimplePredictor;
use calib_stats::{Estimate, Interval};

use super::Verdict;
use super::sentence::{chance_of_change, changed, listed};
use crate::number::number;

/// A simple predictor on the held-out windows.
#[derive(Debug, Clone, PartialEq)]
pub struct SimpleRow {
    /// What predicts.
    pub predictor: SimplePredictor,
    /// Its mean score over windows.
    pub error: f64,
    /// Its typical error in the sensor's own unit, (1 − γ) RMSE: mean over windows. None where the unit is not known.
    pub typical_error: Option<f64>,
}

/// An agent with less than this share of a predictor's error may be worth more windows: as much as what counts as no worse. Our choice.
pub(super) const WORTH_MENTIONING: f64 = 0.98;

/// A predictor whose error is within this factor of the agent's does as well, whatever windows show. Our choice.
const AS_WELL: f64 = 1.01;

/// A few windows decide a mean error over windows where its quotient is so many times the geometric one, or the other way round.
const FEW_DECIDE: f64 = 2.0;

/// A simple predictor beside the chosen agent.
#[derive(Debug, Clone, PartialEq)]
pub struct Simpler {
    /// What predicts.
    pub predictor: SimplePredictor,
    /// Error of the agent by that of the predictor, geometric mean over held-out windows.
    pub ratio: Option<Estimate>,
    /// Whether the predictor is better, and that is no chance.
    pub is_better: bool,
    /// Typical errors of predictor and agent, in the sensor's own unit: (1 − γ) RMSE, mean over windows.
    pub typical_errors: Option<[f64; 2]>,
    /// Held-out windows in which the agent has more than ten times the error of the predictor.
    pub runaway_windows: usize,
    /// Whether the agent starts from a simple predictor.
    pub has_baseline: bool,
}

impl Simpler {
    /// Error of the predictor by that of the agent, where neither is without bounds.
    fn inverse(&self) -> Option<Estimate> {
        let ratio = self.ratio.filter(|ratio| ratio.value.is_finite() && ratio.value != 0.0)?;
        let interval = ratio
            .interval
            .map(|interval| Interval { low: 1.0 / interval.high, high: 1.0 / interval.low });
        Some(Estimate { value: 1.0 / ratio.value, interval })
    }

    /// Whether the predictor is better, and windows show that this is no chance. A single window shows nothing.
    pub(super) fn is_shown(&self) -> bool {
        self.is_better && self.ratio.is_some_and(|ratio| ratio.interval.is_some())
    }

    /// "42 % less", of the error of the predictor beside the agent's.
    fn difference(&self) -> Option<String> {
        Some(changed(self.inverse()?.value))
    }

    /// Whether the agent has less error by more than a rounding, which could be chance.
    pub(super) fn may_be_worse(&self) -> bool {
        !self.is_better && self.ratio.is_some_and(|ratio| ratio.value < WORTH_MENTIONING)
    }

    /// Whether the predictor is better by less than a hundredth.
    fn does_as_well(&self) -> bool {
        self.ratio.is_some_and(|ratio| ratio.value < AS_WELL)
    }

    /// Whether the mean over windows compares them otherwise than the geometric mean does, because of a few windows.
    fn is_decided_by_few(&self) -> bool {
        let means = self.typical_errors.map(|[predictor, agent]| agent / predictor);
        means.zip(self.ratio).is_some_and(|(means, ratio)| {
            let apart = means / ratio.value;
            !(1.0 / FEW_DECIDE..=FEW_DECIDE).contains(&apart)
        })
    }

    /// Typical errors of both.
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

    /// That the agent matches it.
    pub(super) fn matched_sentence(&self) -> Option<String> {
        let ratio = self.ratio.filter(|ratio| ratio.value.is_finite() && ratio.value != 0.0)?;
        Some(format!(
            "It has {} error than {}, the simple predictor that the log prefers{}.{}",
            changed(ratio.value),
            self.predictor.label(),
            chance_of_change(ratio),
            self.typical()
        ))
    }

    /// What that means, and what to try.
    pub(super) fn plain(&self) -> String {
        let name = self.predictor.label();
        let interval = self.inverse().map_or_else(String::new, chance_of_change);
        let difference = self.difference().unwrap_or_else(|| "less".to_owned());
        let typical = self.typical();
        let chance = if self.is_shown() { "" } else { ", which could be chance" };
        let hint = if self.may_be_worse() {
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
        format!(
            "On held-out data {name} has {difference} error than the chosen agent{chance}{interval}.{typical}{hint}"
        )
    }
}

impl Verdict {
    /// The advice where a simple predictor does as well or better.
    pub(super) fn simpler_headline(&self, simpler: &Simpler) -> String {
        let name = simpler.predictor.label();
        let sensor = &self.sensor;
        if let Some(windows) = self.runaway_windows(simpler) {
            return format!(
                "Use {name} for {sensor}, not an agent: in {windows} the agent's error was more than ten times as large."
            );
        }
        match simpler.difference() {
            Some(difference) if simpler.is_better && !simpler.is_shown() => format!(
                "Use {name} for {sensor} for now: it has {difference} error than the agent, in too few held-out windows to be sure."
            ),
            Some(_) if simpler.is_better && simpler.does_as_well() => {
                format!("Use {name} for {sensor}: it does as well as the agent and is simpler.")
            }
            Some(difference) if simpler.is_better => {
                format!("Use {name} for {sensor}, not an agent: it has {difference} error.")
            }
            _ if simpler.is_better => format!("Use {name} for {sensor}, not an agent."),
            _ if simpler.may_be_worse() => {
                format!(
                    "Use {name} for {sensor} for now: an agent may do better, but it is not shown."
                )
            }
            _ => format!("Use {name} for {sensor}: no agent is shown to do better."),
        }
    }

    /// "2 of 4 held-out windows": those in which the agent has more than ten times the error of a predictor, where it has not in others.
    /// There a mean over all windows says little.
    fn runaway_windows(&self, simpler: &Simpler) -> Option<String> {
        let windows = self.online.as_ref()?.windows;
        let some = simpler.runaway_windows;
        (some > 0 && some < windows).then(|| format!("{some} of {windows} held-out windows"))
    }

    /// How much less error the agent has than the best simple predictor on the held-out windows, where that is another than the one
    /// that the log prefers. Which it is is known only afterwards.
    pub(super) fn beside_the_best(&self) -> Option<String> {
        let matched = self.matched.as_ref()?.predictor;
        let agent = self.online.as_ref()?.chosen_error;
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

    /// "persistence for PIT300".
    pub(super) fn instead(&self) -> String {
        let simpler = self.simpler.as_ref().map(|simpler| simpler.predictor);
        let name = simpler.or(self.frozen).map_or("a simple predictor", SimplePredictor::label);
        format!("{name} for {}", self.sensor)
    }

    /// How every simple predictor did.
    pub(super) fn simple_sentence(&self) -> Option<String> {
        let chosen_error = self.online.as_ref()?.chosen_error;
        if self.simple.is_empty() {
            return None;
        }
        let each: Vec<String> = self
            .simple
            .iter()
            .map(|row| format!("{} {}", row.predictor.label(), number(row.error)))
            .collect();
        Some(format!(
            "NRMSE of simple predictors on the same windows: {}. The agent: {}.",
            listed(&each),
            number(chosen_error)
        ))
    }
}
