//! Advice on a verdict about agents that act, in words. Studies and Python share it.

mod beside;
mod reasons;

use calib_base::output::{number, percent};
use calib_control::{Doubt, FEWEST_BLOCKS, KINDS_AGREE, ReturnVerdict};
use calib_report::{Decision, Support, listed};
use calib_stats::{Difference, Interval, RankRule};

pub(super) use beside::beyond_whole_episodes;
use beside::{beside_random_actions, recorded_episodes};
pub use reasons::Reason;

/// The user's names for the settings of a verdict.
#[derive(Clone, Copy, Debug)]
pub struct Vocabulary {
    /// The length of training.
    pub steps: &'static str,
    /// The number of runs per setting.
    pub runs: &'static str,
    /// The number of ensemble members.
    pub members: &'static str,
    /// The largest share of steps that the log may leave uncovered.
    pub most_uncovered: &'static str,
    /// The smallest number of terminals in the log.
    pub fewest_terminals: &'static str,
    /// A statement of what the default is.
    pub default: &'static str,
    /// A statement that no default is compared.
    pub no_default: &'static str,
    /// A statement that the default failed.
    pub default_failed: &'static str,
    /// The remedy for a default that failed.
    pub mend_default: &'static str,
    /// The remedy for too few settings.
    pub add_settings: &'static str,
}

/// The keys of a study.
pub(super) const STUDY: Vocabulary = Vocabulary {
    steps: "control.steps",
    runs: "control.runs",
    members: "control.model.members",
    most_uncovered: "control.most_uncovered",
    fewest_terminals: "control.fewest_terminals",
    default: "the default is the agent of [control.agent], not what runs on the plant",
    no_default: "The default is not in the grid.",
    default_failed: "the program failed with the default",
    mend_default: "mend the program and run the same command again",
    add_settings: "Add values to [control.grid], such as step_size = [0.003, 0.03, 0.3].",
};

/// The keys of a study whose agents belong to a program.
pub(super) const PROGRAM: Vocabulary = Vocabulary {
    default: "the default is the agent of [agent.parameters], not what runs on the plant",
    add_settings: "Add values to [sweep.grid].",
    ..STUDY
};

/// The arguments of `calib_rl.tune`.
pub const PYTHON: Vocabulary = Vocabulary {
    steps: "total_timesteps",
    runs: "runs",
    members: "members=, and control.model.members of the model",
    most_uncovered: "most_uncovered",
    fewest_terminals: "fewest_terminals",
    default: "the default is the agent as it is, or with the values of default=, not what runs on the plant",
    no_default: "No default was compared.",
    default_failed: "the default was tried, and failed",
    mend_default: "see in `failures` why, and mend it, or name another one with default=",
    add_settings: "Add values to the grid.",
};

/// Number of reasons on the first screen.
const MOST_REASONS: usize = 3;

/// Smallest number of different values of a field for which an end of the grid is reported. With two values each is at
/// an end.
const FEWEST_NUMBERS: usize = 3;

/// Fields whose values are at most 1.
const AT_MOST_ONE: [&str; 3] = ["epsilon", "lambda", "gamma"];

/// A verdict with the names of everything in it.
#[derive(Clone, Copy, Debug)]
pub struct Advice<'a> {
    /// The verdict.
    pub verdict: &'a ReturnVerdict,
    /// The name of each setting.
    pub settings: &'a [String],
    /// The fields that have an effect in each setting, with their values.
    pub fields: &'a [Vec<(String, String)>],
    /// The names of the actions, by number.
    pub actions: &'a [String],
    /// The state columns.
    pub columns: &'a [String],
    /// The other names that the user knows.
    pub vocabulary: Vocabulary,
}

impl Advice<'_> {
    /// Returns the decision, as the card of a report shows it.
    pub fn decision(&self) -> Decision {
        let Self { verdict, settings, vocabulary, .. } = self;
        let chosen = &settings[verdict.chosen];
        let rank = rank_name(verdict.rule);
        let default = vocabulary.default;
        let other_default = verdict.default.filter(|&default| default != verdict.chosen);
        let (support, badge, headline, plain) = if settings.len() < 2 {
            (
                Support::Unsupported,
                "Nothing to choose",
                "There is one setting, so nothing was chosen.".to_owned(),
                vocabulary.add_settings.to_owned(),
            )
        } else if verdict.is_supported() {
            let (headline, plain) = if verdict.default == Some(verdict.chosen) {
                (format!("Keep the default: {chosen}."), format!(", and {default}."))
            } else {
                let over = verdict.over_default.as_ref().map_or_else(String::new, |over| {
                    format!(
                        " Its return beside that of the default: {}. Here {default}.",
                        difference(over)
                    )
                });
                (format!("Deploy {chosen}."), format!(".{over}"))
            };
            let plain = format!("It has the best {rank}{plain}");
            (Support::Supported, "Supported by the log", headline, plain)
        } else if let Some(other) = other_default.filter(|_| self.doubts_only_the_default()) {
            (
                Support::KeepDefault,
                "No clear difference",
                format!("Keep the default: {}.", settings[other]),
                format!("{chosen} is first by {rank}, but may be no better. Here {default}."),
            )
        } else {
            let plain = if self.has_diverged() {
                format!("Every setting diverged in a model. First by {rank} is {chosen}.")
            } else if let Some(agreement) = self.disagreement() {
                format!(
                    "First by {rank} is {chosen}, but the kinds of models disagree on the order of the settings (Spearman {agreement:.2} on average). Why not to deploy it is listed below."
                )
            } else if self.is_arbitrary() {
                format!("First by {rank} is {chosen}. Why not to deploy it is listed below.")
            } else {
                let ahead = if verdict.is_ahead_of_default() {
                    ", and clearly ahead of the default by rank or by return"
                } else {
                    ""
                };
                format!(
                    "First by {rank} is {chosen}{ahead}: the setting for a trial that can do no harm. Why not to deploy it is listed below."
                )
            };
            (
                Support::Unsupported,
                "Not supported by the log",
                "Deploy nothing on this evidence.".to_owned(),
                plain,
            )
        };
        Decision { support, badge: badge.to_owned(), headline, plain }
    }

    /// Whether the choice diverged. Diverged settings rank last, so every other setting diverged too.
    fn has_diverged(&self) -> bool {
        self.verdict.doubts.iter().any(|doubt| matches!(doubt, Doubt::Diverged))
    }

    /// Whether the only doubt is that the choice may be no better than the default.
    fn doubts_only_the_default(&self) -> bool {
        let mut doubts = self.verdict.doubts.iter();
        doubts.all(|doubt| matches!(doubt, Doubt::NotBetterThanDefault | Doubt::NotToldApart))
    }

    /// Whether the models show no difference between the settings, or cannot rank the choice. Otherwise their ranking
    /// is more reliable than the returns that they predict. docs/control.md shows how choices do that are not
    /// recommended.
    fn is_arbitrary(&self) -> bool {
        let mut doubts = self.verdict.doubts.iter();
        doubts.any(|doubt| matches!(doubt, Doubt::NotToldApart | Doubt::Diverged))
    }

    /// Returns the agreement of the kinds of models on the order of the settings, if it is too low to prefer a setting.
    fn disagreement(&self) -> Option<f64> {
        let agreement = self.verdict.kinds_agreement().filter(|_| !self.all_tie());
        agreement.filter(|agreement| *agreement < KINDS_AGREE)
    }

    /// Returns the first screen: the decision, the return of the choice, and the strongest reasons against it.
    pub fn summary(&self) -> Vec<String> {
        let reasons = self.reasons().into_iter().take(MOST_REASONS);
        [self.decision().headline, self.choice_return()]
            .into_iter()
            .chain(reasons.map(|reason| reason.what))
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
                "{first}: {} per episode than the default in the models{}.",
                amount(over.mean),
                over.interval.map_or_else(String::new, interval_of_amounts)
            ),
            None => format!(
                "{first}: {} per episode in the models, and recorded episodes got {}{}.",
                number(promised),
                number(verdict.behaviour.mean),
                verdict.behaviour.interval.map_or_else(String::new, interval)
            ),
        }
    }

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

    /// Whether all settings get the same return in every ensemble member, so that no kind of model ranks them.
    fn all_tie(&self) -> bool {
        let mut members = self.verdict.kinds.iter().flat_map(|own| &own.members).peekable();
        members.peek().is_some()
            && members
                .all(|returns| returns.windows(2).all(|pair| pair[0].total_cmp(&pair[1]).is_eq()))
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

    /// Returns which end of the grid `value` is in `field`, if it is one. Nothing lies below 0, such as a temperature
    /// of 0.
    fn at_end(&self, field: &str, value: &str) -> Option<String> {
        let own = finite(value)?;
        let all = self.fields.iter().flatten().filter(|(other, _)| other == field);
        let mut numbers: Vec<f64> = all.map(|(_, value)| finite(value)).collect::<Option<_>>()?;
        numbers.sort_by(f64::total_cmp);
        numbers.dedup();
        if numbers.len() < FEWEST_NUMBERS {
            return None;
        }
        let is_last = AT_MOST_ONE.contains(&field) && own >= 1.0;
        let end = if numbers.iter().all(|&number| number <= own) && !is_last {
            "largest"
        } else if own > 0.0 && numbers.iter().all(|&number| number >= own) {
            "smallest"
        } else {
            return None;
        };
        Some(format!("{field}={value} ({end})"))
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

    fn action(&self, number: usize) -> &str {
        self.actions.get(number).map_or("?", String::as_str)
    }
}

/// Parses a finite number.
fn finite(value: &str) -> Option<f64> {
    value.parse().ok().filter(|number: &f64| number.is_finite())
}

/// What the chosen setting gets beside a policy that learns nothing.
fn more_than(other: &str, over: Option<&Difference>) -> String {
    let Some(over) = over.filter(|over| over.mean.is_finite()) else { return String::new() };
    let interval = over.interval.map_or_else(String::new, |around| {
        let is_chance = around.low < 0.0 && around.high > 0.0;
        let chance = if is_chance { ", which could be chance" } else { "" };
        format!("{}{chance}", interval_of_amounts(around))
    });
    format!(" The chosen setting gets {} than {other}{interval}.", amount(over.mean))
}

/// Returns the name of the rank that a rule uses.
pub(super) fn rank_name(rule: RankRule) -> &'static str {
    match rule {
        RankRule::MeanRank => "mean rank",
        RankRule::WorstRank => "worst rank",
    }
}

fn difference(difference: &Difference) -> String {
    let sign = if difference.mean >= 0.0 { "+" } else { "" };
    let interval = difference.interval.map_or_else(String::new, interval);
    format!("{sign}{} in the model, over blocks of the log{interval}", number(difference.mean))
}

fn interval(interval: Interval) -> String {
    format!(" (95 %: {} to {})", number(interval.low), number(interval.high))
}

fn interval_of_amounts(interval: Interval) -> String {
    let [low, high] = [interval.low, interval.high].map(amount);
    format!(" (95 % over blocks of the log: {low} to {high})")
}

/// Formats a difference, such as "2.5 more" or "2.5 less".
fn amount(difference: f64) -> String {
    let side = if difference < 0.0 { "less" } else { "more" };
    format!("{} {side}", number(difference.abs()))
}

#[cfg(test)]
mod tests;
