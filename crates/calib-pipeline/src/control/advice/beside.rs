//! Comparison of the choice with policies that learn nothing, and with the recorded behaviour.

use calib_base::output::{number, percent};
use calib_control::{BestConstant, OutlyingMember, RandomActions, RecordedReturn};
use calib_report::listed;

use super::{
    Advice,
    reasons::Reason,
    vocabulary::Vocabulary,
    words::{interval, interval_of_amounts, more_than},
};

/// What the choice is compared with in each ensemble member. The best of many actions looks better than it is by chance.
const BEST_OF_OTHERS: &str = "the action that is best in the other ensemble members";

impl Advice<'_> {
    /// Returns the doubt that a constant action gets more. The remedy depends on whether this could be chance.
    pub(super) fn constant_gets_more(&self, action: usize, constant: f64, promised: f64) -> Reason {
        let steps = self.vocabulary.steps;
        let told = format!(
            "always taking {} gets {} per episode in the model, and the chosen setting gets {}, learning included",
            self.action(action),
            number(constant),
            number(promised)
        );
        let learn = format!("or let agents learn for longer ({steps})");
        let over = self.verdict.constant.as_ref().and_then(|best| best.over.as_ref());
        let around = over.and_then(|over| over.interval);
        if around.is_some_and(|around| around.high <= 0.0) {
            return Reason { what: told, remedy: format!("take that action, {learn}") };
        }
        // Without an interval no more is shown than with one around 0.
        let around = around.map_or_else(String::new, interval_of_amounts);
        Reason {
            what: format!("{told}, which could be chance{around}"),
            remedy: format!("try that action first, {learn}"),
        }
    }

    /// Returns the doubt that the choice may get no more than random actions. The remedy depends on whether a single
    /// member causes it.
    pub(super) fn random_actions_may_be_as_good(&self, random: f64, promised: f64) -> Reason {
        let Vocabulary { steps, runs, members, .. } = self.vocabulary;
        let beside = self.verdict.random_actions.as_ref();
        let over = beside.and_then(|beside| beside.over.as_ref()).filter(|over| over.mean > 0.0);
        let told = format!(
            "random actions get {} per episode in the models, and the chosen setting gets {}, learning included",
            number(random),
            number(promised)
        );
        let learn = "record more varied actions, sweep settings that explore less,";
        let Some(around) = over.and_then(|over| over.interval) else {
            return Reason {
                what: format!("{told}: that it learns anything of use is not shown"),
                remedy: format!("{learn} or let agents learn for longer ({steps})"),
            };
        };
        let chance = format!("{told}, which could be chance{}", interval_of_amounts(around));
        match beside.and_then(|beside| beside.outlying) {
            Some(OutlyingMember { kind, member, chosen_return }) => Reason {
                what: format!(
                    "{chance}: without the {} of ensemble member {member}, in which it gets {}, the interval would exclude 0",
                    kind.name(),
                    number(chosen_return)
                ),
                remedy: format!(
                    "make more runs ({runs}), or use more ensemble members ({members})"
                ),
            },
            None => Reason {
                what: chance,
                remedy: format!(
                    "{learn} let agents learn for longer ({steps}), or narrow the interval with more ensemble members ({members})"
                ),
            },
        }
    }

    /// Returns a sentence on the return of the best constant action, which needs no agent.
    pub(super) fn beside_constant(&self, constant: &BestConstant) -> String {
        let BestConstant { action, mean_return, uncovered, over, kinds } = constant;
        let has_others = self.verdict.members.len() > 1;
        let other = if has_others { BEST_OF_OTHERS } else { "that" };
        let over = more_than(other, over.as_ref());
        let each: Vec<String> = kinds
            .iter()
            .map(|own| format!("{} in {}", number(own.mean_return), own.kind.name()))
            .collect();
        let each = if each.len() > 1 { format!(" ({})", listed(&each)) } else { String::new() };
        format!(
            "Best constant action: always {} gets {} in the model{each}, where {} of its steps are not covered.{over}",
            self.action(*action),
            number(*mean_return),
            percent(*uncovered),
        )
    }
}

/// Returns a sentence on the return of random actions.
pub(super) fn beside_random_actions(random: &RandomActions) -> String {
    let over = more_than("that", random.over.as_ref());
    format!("Random actions get {} in the model.{over}", number(random.mean_return))
}

/// Returns a sentence on the return of the recorded behaviour.
pub(super) fn recorded_episodes(recorded: &RecordedReturn) -> String {
    let RecordedReturn { mean, interval: around, best, .. } = *recorded;
    format!(
        "Recorded episodes: mean return {}{}{}.{}",
        number(mean),
        around.map_or_else(String::new, interval),
        best.map_or_else(String::new, |best| format!(", at most {}", number(best))),
        beyond_whole_episodes(recorded).map_or_else(String::new, |reason| format!(" {reason}"))
    )
}

/// Returns the reason for a mean beyond the return of every whole episode, if it is. Without its reason it would look
/// like a mistake.
pub(crate) fn beyond_whole_episodes(recorded: &RecordedReturn) -> Option<&'static str> {
    let RecordedReturn { mean, best, worst, .. } = *recorded;
    let told = number(mean);
    // Values that print alike do not count as beyond each other.
    let above = best.is_some_and(|best| mean > best && number(best) != told);
    let below = worst.is_some_and(|worst| mean < worst && number(worst) != told);
    (above || below).then_some(
        "The mean is beyond every whole episode, because it counts parts of episodes too: it is the sum of all rewards divided by the number of episodes, \
         and a part counts there as its share of the timeout.",
    )
}
