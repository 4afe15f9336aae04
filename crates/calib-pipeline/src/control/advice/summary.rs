//! The advice in a few lines, and all of it.

use calib_base::output::number;
use calib_report::Decision;

use super::{
    Advice,
    reasons::Reason,
    words::{amount, interval, interval_of_amounts, rank_name},
};

/// Number of reasons on the first screen.
pub(super) const MOST_REASONS: usize = 3;

impl Advice<'_> {
    /// Returns the first screen: the decision, the return of the choice, and the strongest reasons against it, or a warning about a choice
    /// that nothing else is against.
    pub fn summary(&self) -> Vec<String> {
        let reasons = self.reasons().into_iter().take(MOST_REASONS).map(|reason| reason.what);
        let warning = self.early_ends().filter(|_| self.verdict.is_supported());
        [self.decision().headline, self.choice_return()]
            .into_iter()
            .chain(reasons)
            .chain(warning)
            .collect()
    }

    /// Returns the decision, the return of the choice, and all evidence.
    pub fn why(&self) -> Vec<String> {
        let Decision { headline, plain, .. } = self.decision();
        let reasons: Vec<String> = self.reasons().iter().map(Reason::whole).collect();
        [vec![headline, self.choice_return(), plain], reasons, self.findings()].concat()
    }

    /// Returns a sentence on the return of the choice. It is compared with the default if that is another setting, and
    /// otherwise with the recorded returns.
    fn choice_return(&self) -> String {
        let Self { verdict, settings, .. } = self;
        let chosen = &settings[verdict.chosen];
        let promised = verdict.selection.mean_errors[verdict.chosen];
        if !promised.is_finite() {
            return format!("{chosen} diverged in a model.");
        }
        let first = if settings.len() > 1 {
            format!("{chosen} is first by {}", rank_name(verdict.rule))
        } else {
            chosen.clone()
        };
        let has_other = verdict.default.is_some_and(|default| default != verdict.chosen);
        let over_other =
            verdict.over_default.as_ref().filter(|over| has_other && over.mean.is_finite());
        match over_other {
            Some(over) => format!(
                "{first}: {} per episode than the default in the models{}{}.",
                amount(over.mean),
                over.interval.map_or_else(String::new, interval_of_amounts),
                self.lead_in_ranks()
            ),
            None => format!(
                "{first}: {} per episode in the models, and recorded episodes got {}{}.",
                number(promised),
                number(verdict.behaviour.mean),
                verdict.behaviour.interval.map_or_else(String::new, interval)
            ),
        }
    }

    /// Returns the lead over the default in ranks, if it is what shows that the choice is ahead: where an interval of returns contains 0,
    /// readers would ask why calib is sure.
    fn lead_in_ranks(&self) -> String {
        let Self { verdict, .. } = self;
        let returns = verdict.over_default.and_then(|over| over.interval);
        if !verdict.is_ahead_of_default() || returns.is_none_or(|returns| returns.low > 0.0) {
            return String::new();
        }
        let Some(ranks) = verdict.ranks_over_default else { return String::new() };
        let around = ranks.interval.map_or_else(String::new, interval);
        format!("; clearly ahead of it in mean rank, by {}{around}", number(ranks.mean))
    }
}
