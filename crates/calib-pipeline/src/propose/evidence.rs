//! The choice of the proposed agent, from trials on the training range.

use calib_base::{
    Context as _, StepError,
    output::{Printer, span},
};
use calib_propose::{Horizon, ProposedAgent, Sensors, Trial, choose_agent};

use super::{
    alternatives::OtherTrials,
    prediction::TrialPrediction,
    trial::{Trials, halved},
};

/// Agents with this many times the error of a simple predictor learn nothing from the values. Our choice.
const FAR_WORSE: f64 = 100.0;

/// The result of trials on the training range, and the choice that follows.
pub(super) struct Evidence {
    pub(super) agent: ProposedAgent,
    pub(super) reason: String,
    /// The trial of each proposed sensor.
    pub(super) predicted: Vec<TrialPrediction>,
    /// The agents that were tried, the simplest first.
    pub(super) tried: Vec<ProposedAgent>,
    /// Whether an agent is shown to be ahead of the simple predictors of a sensor.
    pub(super) is_ahead: bool,
    /// Trials with another horizon, other sensors or another spacing. `None` if they were not needed.
    pub(super) others: Option<OtherTrials>,
}

impl Evidence {
    /// Tries agents at the `horizon`. Halves it, as long as there is time, until something predicts at least one sensor
    /// better than its mean.
    ///
    /// # Errors
    /// Returns an error if not even the simplest agent could be tried.
    pub(super) fn gather(
        trials: &Trials<'_>,
        horizon: &mut Horizon,
        text: impl Fn(ProposedAgent, Horizon) -> String,
    ) -> Result<Self, StepError> {
        trials
            .context
            .say("comparing agents with simple predictors on the last third of the training range");
        let mut predicted = trials
            .compare(&trials.comparing, horizon, |at| text(ProposedAgent::Linear, at))?
            .context("half of the time of --within is over")?;
        let is_given = trials.args.horizon.is_some();
        let mut shorter = *horizon;
        while !predicted.iter().any(TrialPrediction::is_predicted)
            && !is_given
            && shorter.states >= 4.0
        {
            shorter = halved(shorter);
            let linear = trials
                .compare(&trials.comparing, &mut shorter, |at| text(ProposedAgent::Linear, at))?;
            let Some(nearer) = linear else { break };
            if nearer.iter().any(TrialPrediction::is_predicted) {
                trials.context.say(&format!(
                    "nothing predicts {} ahead better than the mean does",
                    span(horizon.secs)
                ));
                (predicted, *horizon) = (nearer, shorter);
            }
        }
        let mut nearer = *horizon;
        let network = trials
            .compare(&trials.comparing, &mut nearer, |at| text(ProposedAgent::Network, at))?;
        let mut tried = vec![Trial { agent: ProposedAgent::Linear, ratio: typical(&predicted) }];
        if let Some(sensors) = &network {
            *horizon = nearer;
            tried.push(Trial { agent: ProposedAgent::Network, ratio: typical(sensors) });
        }
        let chosen = choose_agent(&tried).unwrap_or(tried[0]);
        let mut reason = format!(
            "On the last third of the training range, error divided by that of the best simple predictor (below 1 is better): {}",
            ratios(&tried)
        );
        if tried.iter().all(|trial| trial.ratio > FAR_WORSE || !trial.ratio.is_finite()) {
            trials.context.warn(
                "agents diverge on the training range, or are far worse than simple predictors there: values may be damaged, for example by a lost decimal \
                 sign; look at the smallest and largest ones with `calib inspect`",
            );
        }
        if network.is_none() {
            reason.push_str("; half of the time of --within was over before a network was tried");
        }
        let sensors: Vec<&TrialPrediction> =
            predicted.iter().chain(network.iter().flatten()).collect();
        let is_ahead = sensors.iter().any(|sensor| sensor.lead.is_some());
        if !sensors.iter().any(|sensor| sensor.is_predicted()) {
            let warning = format!(
                "nothing that calib tried predicts {} ahead better than the mean",
                span(horizon.secs)
            );
            trials.context.warn(&warning);
            reason = format!("{reason}; {warning}");
        } else if !is_ahead {
            reason.push_str(
                "; no agent is shown to do better there, and the study tests it again on the held-out period",
            );
        }
        let tried = tried.into_iter().map(|trial| trial.agent).collect();
        Ok(Self { agent: chosen.agent, reason, predicted, tried, is_ahead, others: None })
    }

    /// Returns the proposal if nothing could be tried, with the reason.
    pub(super) fn untried(reason: &StepError, printer: &Printer) -> Self {
        let reason = format!(
            "agents could not be compared on the training range ({reason}): a linear agent is proposed, and `calib run` compares it with simple predictors"
        );
        // The study may have no such trouble: it has all rows.
        printer.warn(&reason);
        Self {
            agent: ProposedAgent::Linear,
            reason,
            predicted: Vec::new(),
            tried: Vec::new(),
            is_ahead: false,
            others: None,
        }
    }

    /// Moves sensors that something predicts to the front, unless the order `is_given`.
    pub(super) fn reorder(&self, sensors: &mut Sensors, is_given: bool) {
        if is_given || self.predicted.is_empty() {
            return;
        }
        let all: Vec<(usize, bool)> = sensors
            .proposed
            .iter()
            .copied()
            .zip(self.predicted.iter().map(TrialPrediction::is_predicted))
            .collect();
        let (first, last): (Vec<_>, Vec<_>) =
            all.into_iter().partition(|(_, predicted)| *predicted);
        sensors.proposed = first.into_iter().chain(last).map(|(channel, _)| channel).collect();
    }
}

/// Returns the ratio of each agent, in words.
fn ratios(tried: &[Trial]) -> String {
    let told = tried.iter().map(|trial| {
        let label = trial.agent.label();
        if trial.ratio.is_finite() {
            format!("{label} {:.3}", trial.ratio)
        } else {
            format!("{label} diverged")
        }
    });
    told.collect::<Vec<_>>().join(", ")
}

/// Returns the geometric mean over sensors of the ratio of the agent's error to that of the best simple predictor.
fn typical(sensors: &[TrialPrediction]) -> f64 {
    let sum: f64 = sensors.iter().map(|sensor| sensor.agent.ln()).sum();
    (sum / sensors.len() as f64).exp()
}
