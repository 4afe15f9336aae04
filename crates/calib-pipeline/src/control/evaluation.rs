//! The evaluation of agents that act: the compared settings, and the verdict on them.

use calib_base::StepError;
use calib_control::{Doubt, FittedQValue, Importance, ReturnVerdict, Support};
use calib_report::{AgentConduct, Decision};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{
    advice::{Advice, Reason, STUDY},
    agents::{ActingAgent, SettingFailure},
    described::ActionLogSummary,
    held_out_period::{HeldOutLog, HeldOutPeriod},
};

/// `verdict.json`: a summary of the log, the compared settings, and the verdict on deployment.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
pub struct ControlEvaluation {
    /// Summary of the log.
    #[serde(flatten)]
    pub(super) log: ActionLogSummary,
    /// Warnings about the log, in sentences.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(super) log_warnings: Vec<String>,
    /// Time from one decision to the next, in seconds.
    pub(super) decision_secs: f64,
    /// Mean reward of a recorded step.
    pub(super) mean_reward: f64,
    /// The held-out periods, in the order of time.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(super) held_out: Vec<HeldOutPeriod>,
    /// Return that an episode ends with where the log does not cover a step.
    pub(super) worst_return: f64,
    /// The agents that were compared, one for each setting.
    pub(super) candidates: Vec<ActingAgent>,
    /// The swept fields of each setting, with their values.
    pub(super) fields: Vec<Vec<(String, String)>>,
    pub(super) verdict: ReturnVerdict,
    /// Learning curve of each setting: the mean return per episode in each tenth of its episodes, over ensemble members and runs with at
    /// least ten episodes (`[candidates][tenths]`; empty if there are none).
    #[serde(with = "calib_stats::diverged::rows")]
    #[schemars(with = "Vec<Vec<calib_stats::diverged::Stored>>")]
    pub(super) learning: Vec<Vec<f64>>,
    /// Value of each setting by fitted Q evaluation, which needs no model: for comparison only. Empty for agents of a program.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(super) fitted_q_evaluation: Vec<FittedQValue>,
    /// Value of each setting by weighted importance sampling, if the log has the probabilities of its actions: for comparison only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) importance_sampling: Option<Vec<Importance>>,
    /// Value of each setting by the weighted doubly robust estimator, which corrects the values of fitted Q evaluation on the episodes of
    /// importance sampling. None for a setting if fitted Q evaluation diverged or importance sampling has no value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) doubly_robust: Option<Vec<Option<f64>>>,
    /// Behaviour of the chosen agent at the end of its first run; none if it diverged in this run.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) conduct: Option<AgentConduct>,
    /// Settings with which a program failed. They rank last.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(super) failures: Vec<SettingFailure>,
}

impl ControlEvaluation {
    /// Returns the verdict: the best setting in the models, its lead, and the doubts about deploying it.
    pub fn verdict(&self) -> &ReturnVerdict {
        &self.verdict
    }

    /// Returns the agent of every setting, in the order of the verdict.
    pub fn agents(&self) -> &[ActingAgent] {
        &self.candidates
    }

    /// Returns the advice with all reasons, one line each, as `calib control --why` prints it. The first line is the decision.
    pub fn why(&self) -> Vec<String> {
        self.advise(|advice| advice.why())
    }

    /// Returns the object that `calib control --json` prints.
    ///
    /// # Errors
    /// If it cannot be written as JSON.
    pub fn to_json(&self) -> Result<String, StepError> {
        Ok(serde_json::to_string(&ControlSummary::from(self))?)
    }

    /// Builds the advice, and passes it to `words`.
    pub(super) fn advise<T>(&self, words: impl FnOnce(Advice<'_>) -> T) -> T {
        let settings: Vec<String> =
            (0..self.candidates.len()).map(|candidate| self.setting_name(candidate)).collect();
        let actions: Vec<String> =
            self.log.actions.iter().map(|action| action.name.clone()).collect();
        let fields: Vec<Vec<(String, String)>> = self
            .candidates
            .iter()
            .zip(&self.fields)
            .map(|(agent, fields)| -> Vec<(String, String)> {
                fields.iter().filter(|(field, _)| agent.uses(field)).cloned().collect()
            })
            .collect();
        words(Advice {
            verdict: &self.verdict,
            settings: &settings,
            fields: &fields,
            actions: &actions,
            columns: &self.log.columns,
            vocabulary: self.candidates.first().map_or(STUDY, ActingAgent::vocabulary),
        })
    }

    /// Returns the name of a setting.
    pub(super) fn setting_name(&self, candidate: usize) -> String {
        setting_name(&self.fields[candidate])
    }

    /// Whether the verdict is on these held-out periods.
    pub(super) fn is_on(&self, held_out: &[HeldOutLog]) -> bool {
        self.held_out.len() == held_out.len()
            && self.held_out.iter().zip(held_out).all(|(period, log)| period.is_of(log))
    }

    /// Returns the same verdict on these held-out periods, with the doubts about them.
    pub(super) fn with_held_out(mut self, held_out: Vec<HeldOutPeriod>, support: Support) -> Self {
        let doubts = &mut self.verdict.doubts;
        doubts.retain(|doubt| !matches!(doubt, Doubt::HeldOutUncovered { .. }));
        let judged = held_out.iter().filter(|period| period.can_be_judged());
        doubts.extend(judged.filter_map(|period| {
            support.doubt_about_held_out(period.deployment.as_deref(), period.uncovered)
        }));
        Self { held_out, ..self }
    }

    /// Returns the same verdict with these warnings about its log.
    pub(super) fn with_log_warnings(self, log_warnings: Vec<String>) -> Self {
        Self { log_warnings, ..self }
    }

    /// Whether a program failed with some settings, so that the next command tries them again.
    pub(super) fn lacks_settings(&self) -> bool {
        !self.failures.is_empty()
    }

    /// Whether a program failed with this setting.
    pub(super) fn has_failed(&self, candidate: usize) -> bool {
        self.failures.iter().any(|failure| failure.candidate == candidate)
    }

    /// Returns the reasons why the log does not support the choice, and the settings that are missing.
    pub(super) fn warnings(&self) -> Vec<String> {
        let reasons = self.advise(|advice| advice.reasons());
        let mut warnings: Vec<String> = reasons.iter().map(Reason::whole).collect();
        warnings.extend(self.failed_settings());
        warnings
    }

    /// Returns warnings about settings with which a program failed.
    pub(super) fn failed_settings(&self) -> Vec<String> {
        self.failures.iter().map(SettingFailure::warning).collect()
    }
}

/// The evaluation for `--json`, with the choice first.
#[derive(Serialize, JsonSchema)]
pub(crate) struct ControlSummary<'a> {
    /// The agent of the chosen setting. Deploy it only if the log supports it.
    choice: &'a ActingAgent,
    /// The decision in words.
    decision: Decision,
    /// Whether the chosen setting is ahead of the default in the models, even if there are reasons against deployment.
    is_ahead_of_default: bool,
    /// Agreement of the kinds of models on the order of the settings (Spearman's correlation); none if there is one kind or too few
    /// settings.
    kinds_agreement: Option<f64>,
    #[serde(flatten)]
    evaluation: &'a ControlEvaluation,
}

impl<'a> From<&'a ControlEvaluation> for ControlSummary<'a> {
    fn from(evaluation: &'a ControlEvaluation) -> Self {
        Self {
            choice: &evaluation.candidates[evaluation.verdict.chosen],
            decision: evaluation.advise(|advice| advice.decision()),
            is_ahead_of_default: evaluation.verdict.is_ahead_of_default(),
            kinds_agreement: evaluation.verdict.kinds_agreement(),
            evaluation,
        }
    }
}

/// Returns the name of a setting: its swept `fields` with their values.
pub(super) fn setting_name(fields: &[(String, String)]) -> String {
    if fields.is_empty() {
        return "the agent".to_owned();
    }
    fields.iter().map(|(field, value)| format!("{field}={value}")).collect::<Vec<_>>().join(" ")
}
