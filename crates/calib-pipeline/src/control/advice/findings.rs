//! The evidence for the decision about a verdict.

use calib_base::output::{about, number, percent};
use calib_control::{Doubt, FEWEST_BLOCKS, StepRates};
use calib_report::listed;
use calib_sweep::GridEnd;

use super::{
    Advice,
    beside::{beside_random_actions, recorded_episodes},
    words::{difference, interval},
};

/// Fields whose values are at most 1.
const AT_MOST_ONE: [&str; 3] = ["epsilon", "lambda", "gamma"];

impl Advice<'_> {
    /// Returns the evidence for the decision.
    pub fn findings(&self) -> Vec<String> {
        let verdict = self.verdict;
        let mut lines = Vec::new();
        match &verdict.over_default {
            _ if verdict.default == Some(verdict.chosen) => {
                lines.push("That is the default.".to_owned());
            }
            Some(over) => lines.push(format!("Over the default: {}.", difference(over))),
            None if verdict.doubts.contains(&Doubt::DefaultFailed) => {
                lines.push("The default was tried, and failed.".to_owned());
            }
            None if verdict.default.is_none() => {
                lines.push(self.vocabulary.no_default.to_owned());
            }
            None => lines.push("The default diverged in the model as well.".to_owned()),
        }
        lines.extend(self.ranks_over_default());
        lines.extend(self.over_random());
        if !self.has_diverged() {
            lines.extend(self.kinds());
        }
        lines.extend(self.at_ends());
        lines.extend(verdict.constant.as_ref().map(|constant| self.beside_constant(constant)));
        lines.extend(verdict.random_actions.as_ref().map(beside_random_actions));
        lines.push(recorded_episodes(&verdict.behaviour));
        lines.extend(self.early_ends().or_else(|| self.terminals()));
        lines.push(format!(
            "Not covered by the log: {} of its steps in the model.",
            percent(verdict.coverage[verdict.chosen].uncovered())
        ));
        lines.push(
            "Returns in the model rank settings. They do not say what the plant will give."
                .to_owned(),
        );
        lines.extend(self.few_blocks());
        lines
    }

    /// Returns a sentence on the lead of the choice over the default in ranks, if the default is another setting.
    fn ranks_over_default(&self) -> Option<String> {
        let verdict = self.verdict;
        let ranks = verdict
            .ranks_over_default
            .filter(|ranks| ranks.mean > 0.0 && verdict.default != Some(verdict.chosen))?;
        let around = ranks.interval.map_or_else(String::new, interval);
        let by = number(ranks.mean);
        Some(format!("Ahead of the default by {by} in mean rank, over blocks of the log{around}."))
    }

    /// Returns a warning if the choice has high returns because its episodes are short.
    pub(super) fn early_ends(&self) -> Option<String> {
        let rates = self.verdict.step_rates.filter(StepRates::end_early)?;
        Some(format!(
            "Its episodes in the models end in a terminal {} times as often as the recorded ones (in {} of the steps, recorded {}), and its steps get less reward ({}, \
             recorded {}). If a terminal is a failure, such as a trip, do not deploy this: give terminals a penalty in the reward. If it is a goal, this speaks for it.",
            about(rates.terminals_in_model / rates.terminals_in_log),
            percent(rates.terminals_in_model),
            percent(rates.terminals_in_log),
            number(rates.reward_in_model),
            number(rates.reward_in_log)
        ))
    }

    /// Returns a sentence on how often episodes end in a terminal, if any do.
    fn terminals(&self) -> Option<String> {
        let rates = self.verdict.step_rates?;
        (rates.terminals_in_model > 0.0 || rates.terminals_in_log > 0.0).then(|| {
            format!(
                "A terminal ends the episode in {} of its steps in the models, and in {} of the recorded ones.",
                percent(rates.terminals_in_model),
                percent(rates.terminals_in_log)
            )
        })
    }

    /// Returns a sentence on the lead of the choice over a random setting, if there are several settings.
    fn over_random(&self) -> Option<String> {
        let over = &self.verdict.over_random;
        let told = if over.mean.is_finite() {
            format!("Over a random setting: {}.", difference(over))
        } else {
            "A random setting may fail or diverge.".to_owned()
        };
        (self.settings.len() > 1).then_some(told)
    }

    /// Returns a note that intervals over few blocks of the log are weak, if there are few.
    fn few_blocks(&self) -> Option<String> {
        let members = self.vocabulary.members;
        let told = match self.verdict.members.len() {
            1 => "One ensemble member gives no interval".to_owned(),
            few @ 2..FEWEST_BLOCKS => format!("Intervals over {few} blocks of the log are weak"),
            _ => return None,
        };
        Some(format!("{told}: use {FEWEST_BLOCKS} ensemble members or more ({members})."))
    }

    /// Returns a note on values of the choice at an end of the grid, if the settings differ in their returns.
    fn at_ends(&self) -> Option<String> {
        if self.is_arbitrary() {
            return None;
        }
        let chosen = self.fields.get(self.verdict.chosen)?.iter();
        let ends: Vec<String> =
            chosen.filter_map(|(field, value)| self.at_end(field, value)).collect();
        let told =
            format!("At the end of the grid: {}. Settings beyond may be better.", listed(&ends));
        (!ends.is_empty()).then_some(told)
    }

    /// Returns which end of the grid `value` is in `field`, if it is one.
    fn at_end(&self, field: &str, value: &str) -> Option<String> {
        let own = finite(value)?;
        let all = self.fields.iter().flatten().filter(|(other, _)| other == field);
        let numbers = all.map(|(_, value)| finite(value)).collect::<Option<_>>()?;
        let end = GridEnd::at(own, numbers)?;
        if end == GridEnd::Largest && AT_MOST_ONE.contains(&field) && own >= 1.0 {
            return None;
        }
        Some(format!("{field}={value} ({})", end.name()))
    }

    /// Returns sentences on the setting that each kind of model alone would choose, if there are several kinds.
    fn kinds(&self) -> Vec<String> {
        let verdict = self.verdict;
        if verdict.kinds.len() < 2 {
            return Vec::new();
        }
        if self.all_tie() {
            return vec!["All settings get the same in every model.".to_owned()];
        }
        let (agree, others): (Vec<_>, Vec<_>) =
            verdict.kinds.iter().partition(|own| own.chosen == verdict.chosen);
        let names: Vec<String> = agree.iter().map(|own| own.kind.name().to_owned()).collect();
        let mut lines = vec![match &names[..] {
            [] => "No kind of model alone would choose it.".to_owned(),
            names => format!("Alone, {} would choose the same.", listed(names)),
        }];
        lines.extend(others.iter().map(|other| {
            let setting = &self.settings[other.chosen];
            format!("Alone, {} would choose {setting}.", other.kind.name())
        }));
        lines.extend(verdict.kinds_agreement().map(|agreement| {
            format!("The orders of the settings by the kinds have a Spearman correlation of {agreement:.2}; at 1 they are the same.")
        }));
        lines
    }
}

/// Parses a finite number.
fn finite(value: &str) -> Option<f64> {
    value.parse().ok().filter(|number: &f64| number.is_finite())
}
