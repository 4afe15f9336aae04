use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use calib_agent::SimplePredictor;

use super::{
    rule::ChoiceStanding,
    simple::{self, SimpleComparison},
    truth::Truth,
};

/// How well held-out data supports a choice. Where it can show nothing, simple predictors are compared on the log.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Grade {
    /// At most 5 % more error than the best setting of each window, over two windows or more.
    Good,
    /// More error than that, or only one held-out window. It is not shown to be worse than the default.
    Fair,
    /// A simple predictor is as good or better: the agent is not known to have at most 2 % more error than the predictor that the log
    /// prefers, or another predictor is better by more than chance. Without held-out data this is so on windows of the log.
    Simpler,
    /// The default is better, or the choice diverged or has no skill, or held-out values lie far from the values of the training range.
    Poor,
    /// No predictor is shown to be better than a mean return by 2 %. The mean return is that of the training range if simple predictors are
    /// known, and otherwise that of each window.
    NotLearnt,
    /// There is no held-out data, or its returns do not vary or are not known to vary. On the log, no simple predictor is known to be
    /// as good.
    Unchecked,
}

/// A regret up to this is no reason to look further.
const SMALL_REGRET: f64 = 0.05;

impl Grade {
    /// Applies these rules. The first that holds decides:
    ///
    /// 1. *poor* if the choice diverged in some stream that it was made from, as every other setting then did;
    /// 2. without held-out data, and where the sensor is constant in it, rule 6 by the windows of the replayed log, and
    ///    *unchecked* where that has no result;
    /// 3. *poor* if the choice diverged in some held-out window;
    /// 4. as rule 2 where the spread of the returns is 0, or not known;
    /// 5. *poor* if the training mean, where it is known, has an error of more than twenty spreads of the training
    ///    range;
    /// 6. where simple predictors are known, and the choice is not known to match the one that the log prefers or
    ///    another is better by more than chance: *not learned* if the training mean does as well as that one, and
    ///    *simpler* otherwise. Also *not learned* if the choice matches the one that the log prefers but is not shown to
    ///    have two per cent less error than the training mean, or if that holds for the default that is used instead
    ///    (`learning_off`). If other predictors are shown to beat the training mean, the same is asked about those, and
    ///    the grade is *simpler* or that of the agent;
    /// 7. where they are not known, *not learned* if the best setting over windows has no skill (1 − RMSE / σ ≤ 0), and
    ///    *poor* if the choice has no skill;
    /// 8. *unchecked* if all settings have the same error;
    /// 9. *poor* if the choice has more error than the default, with an interval over windows that excludes equality;
    /// 10. *good* if its regret is at most 5 %, over two windows or more;
    /// 11. *fair* otherwise.
    pub(super) fn of(
        standing: ChoiceStanding,
        truth: Option<&Truth>,
        simple: &[SimpleComparison],
        stands_still: bool,
        learning_off: Option<usize>,
    ) -> Self {
        if standing == ChoiceStanding::Diverged {
            return Self::Poor;
        }
        let instead = simple::decisive(simple, truth, learning_off);
        let lowered = instead.map(|instead| match instead.predictor {
            SimplePredictor::Mean => Self::NotLearnt,
            _ => Self::Simpler,
        });
        let unchecked = lowered.unwrap_or(Self::Unchecked);
        let Some(truth) = truth else { return unchecked };
        if stands_still {
            return unchecked;
        }
        let (Some(best), Some(regret)) = (truth.best, truth.choice.regret) else {
            return Self::Poor;
        };
        if truth.choice.online_error.is_infinite() {
            return Self::Poor;
        }
        let (Some(best_skill), Some(skill)) =
            (truth.scores.skill[best], truth.scores.skill[truth.choice.chosen])
        else {
            return unchecked;
        };
        if simple::elsewhere(simple).is_some() {
            return Self::Poor;
        }
        match lowered {
            Some(grade) => return grade,
            None if simple.is_empty() && best_skill <= 0.0 => return Self::NotLearnt,
            None if simple.is_empty() && skill <= 0.0 => return Self::Poor,
            None => {}
        }
        if !truth.tells_apart() {
            return Self::Unchecked;
        }
        if truth.prefers_the_default() {
            return Self::Poor;
        }
        if truth.windows.len() > 1 && regret.value <= SMALL_REGRET {
            Self::Good
        } else {
            Self::Fair
        }
    }

    /// Returns the grade in a word or two.
    pub const fn word(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Fair => "fair",
            Self::Simpler => "simpler is better",
            Self::Poor => "poor",
            Self::NotLearnt => "not learned",
            Self::Unchecked => "not checked",
        }
    }
}

/// Recommendation for the agent of a sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Recommendation {
    /// Deploy an agent with the chosen values.
    Deploy,
    /// Deploy an agent with the default values: held-out data prefers them, or the evidence prefers no setting.
    KeepDefault,
    /// Deploy the simple predictor instead of an agent.
    UseSimplePredictor,
    /// Deploy nothing on this evidence.
    DoNotDeploy,
    /// There is no held-out data to decide whether the choice can be deployed. On the log, no simple predictor is known to be as good.
    NotChecked,
}
