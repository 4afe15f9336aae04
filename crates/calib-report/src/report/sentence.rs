//! A verdict in sentences that need no statistics to be understood.

use calib_stats::{Bounded, Estimate};

use super::{Agreement, Alternative, Grade, Reason, Told, Verdict, Way};
use crate::number::{number, percent};
use crate::{Score, Setting};

mod words;

pub(super) use words::assigned;
pub use words::listed;
use words::{fields, ordinal};

/// Choices that differ more often than this from draw to draw are told as uncertain.
const STABLE: f64 = 0.8;

/// Shares that would be written as 100 %.
const ALL: f64 = 0.995;

impl Verdict {
    /// The verdict in one sentence.
    pub fn headline(&self) -> String {
        let Self { sensor, chosen, .. } = self;
        let choice = self.assigned();
        let field = fields(&self.field);
        match self.grade {
            _ if self.is_arbitrary() => {
                format!("No value of {field} stands out for {sensor}: all did alike.")
            }
            Grade::Simpler => match &self.simpler {
                Some(simpler) => self.simpler_headline(simpler),
                None => format!("Use a simple predictor for {sensor}, not an agent."),
            },
            Grade::Good | Grade::Fair => match self.frozen {
                Some(predictor) => {
                    format!("Use {} for {sensor}: learning on adds nothing.", predictor.label())
                }
                None => format!("Use {choice} for {sensor}."),
            },
            Grade::Poor if self.has_all_diverged() => {
                format!("No value of {field} can be deployed for {sensor}: every one diverged.")
            }
            Grade::Poor => match self.better_default() {
                Some(default) => {
                    let default = assigned(&self.field, default);
                    format!("Keep the default, {default}, for {sensor}: {chosen} is worse.")
                }
                None => format!("Do not deploy {choice} for {sensor} on this evidence."),
            },
            Grade::NotLearnt if self.left_training().is_some() => {
                format!("Do not deploy an agent for {sensor}: it was never trained on such values.")
            }
            Grade::NotLearnt if !self.simple.is_empty() => format!(
                "Do not deploy an agent for {sensor}: none is shown to beat the training mean."
            ),
            Grade::NotLearnt if self.hardly_varies() => format!(
                "{sensor} hardly varies in the held-out windows, and no value of {field} predicts it better than their own \
                 means would: nothing to deploy on this evidence."
            ),
            Grade::NotLearnt => {
                format!("No value of {field} learns {sensor}: do not deploy on this evidence.")
            }
            Grade::Unchecked if self.online.as_ref().is_some_and(|online| online.stands_still) => {
                format!(
                    "{sensor} never changes in the held-out data, so the choice could not be checked. The log suggests {choice}."
                )
            }
            Grade::Unchecked => {
                format!("Use {choice} for {sensor}, on the evidence of the log.")
            }
        }
    }

    /// Whether errors are small beside the spread of returns in training (less than half of it) although nothing beats the mean of
    /// each window: the windows are too short, or too quiet, to tell whether anything was learnt.
    pub(super) fn hardly_varies(&self) -> bool {
        self.left_training().is_none()
            && self.online.as_ref().is_some_and(|online| online.best_error < 0.5)
    }

    /// The share of held-out values outside of the range that was learned from, where that is most of them: such a sensor is not quiet,
    /// it is elsewhere.
    pub(super) fn left_training(&self) -> Option<f64> {
        self.outside_training.filter(|share| *share > 0.5)
    }

    /// "The best setting has NRMSE 0.97 and skill -0.02", where held-out data says so.
    pub(super) fn best_numbers(&self) -> Option<String> {
        let online = self.online.as_ref()?;
        if !online.best_error.is_finite() {
            return None;
        }
        let error = number(online.best_error);
        let skill = online.best_skill.map_or_else(String::new, |skill| {
            format!(" and a skill of {} against the mean of each window", signed(skill))
        });
        let best = &online.best;
        Some(format!(
            "The best setting, {best}, has an NRMSE of {error} against the mean of the training range{skill}."
        ))
    }

    /// The choice as one would type it.
    pub(super) fn assigned(&self) -> String {
        assigned(&self.field, &self.chosen)
    }

    /// The default, if held-out data says that it is better than the choice.
    pub(super) fn better_default(&self) -> Option<&Setting> {
        let against = self.online.as_ref()?.against_default?;
        let better = against.interval.is_some_and(|interval| interval.low > 1.0);
        self.alternative(Way::Default)?.value.as_ref().filter(|_| better)
    }

    /// The reasons, one sentence each: how it was chosen, ties, stability, Online, alternatives, agreement. Of a choice that is
    /// not to be used no more than what it was, and how it did. What is in `notes` is told elsewhere.
    pub fn reasons(&self, score: &Score) -> Vec<String> {
        let mut reasons = if self.grade == Grade::NotLearnt && self.evidence == Told::Apart {
            vec![format!("The choice of {} is {}.", self.model, self.assigned())]
        } else {
            self.reasons_of_choice(score)
        };
        match &self.online {
            None => reasons.push(
                "No held-out data was given: regret and agreement with Online are unknown."
                    .to_owned(),
            ),
            Some(online) => reasons.extend(self.reasons_of_online(online, score)),
        }
        reasons
    }

    /// How it was chosen.
    fn reasons_of_choice(&self, score: &Score) -> Vec<String> {
        if self.values == 1 {
            return vec!["There is no other value to choose from.".to_owned()];
        }
        if self.evidence == Told::Alike {
            return vec![self.alike_sentence()];
        }
        let mut reasons = vec![self.reason_sentence()];
        if self.reason == Reason::WorstRank {
            reasons.extend(self.tie_sentence(score));
        } else {
            reasons.push(self.worst_rank_sentence());
        }
        reasons.extend(self.stability_sentence());
        reasons
    }

    /// How it did on held-out data, beside other ways to choose.
    fn reasons_of_online(&self, online: &Agreement, score: &Score) -> Vec<String> {
        let mut reasons = vec![online_sentence(self, online, score)];
        if online.stands_still || self.has_all_diverged() {
            return reasons;
        }
        reasons.extend(self.simple_sentence());
        if self.simple.is_empty() {
            reasons.extend(skill_sentence(online));
        }
        if self.grade == Grade::NotLearnt || online.values == Told::Alike || self.values == 1 {
            return reasons;
        }
        reasons.extend(self.default_sentence(online));
        let others = [Way::LogReplay, Way::LatestWindow];
        reasons.extend(others.into_iter().filter_map(|way| self.alternative_sentence(way)));
        reasons.push(self.window_sentence(online));
        reasons.push(agreement_sentence(online));
        reasons
    }

    fn alike_sentence(&self) -> String {
        format!(
            "Nothing was chosen: all {} values did alike in every run that counts, so that {} stands for any of them.",
            self.values, self.chosen
        )
    }

    fn reason_sentence(&self) -> String {
        let model = &self.model;
        match self.reason {
            Reason::WorstRank => self.worst_rank_sentence(),
            Reason::MeanRank => format!("{model} ranks it best on average over its members."),
            Reason::MeanError => format!("{model} has the smallest mean error with it."),
            Reason::MeanLogError { streams } => format!(
                "{model} has the smallest mean logarithm of the error with it, over {streams} streams."
            ),
            Reason::Pooled { streams, sources } => format!(
                "Over {streams} streams of {}, its mean logarithm of the error is the smallest.",
                sources.of(model)
            ),
            Reason::LogReplay { streams } => format!(
                "Over {streams} windows of the replayed log its mean logarithm of the error is the smallest; {model} did not count."
            ),
            Reason::OneStandardError { streams, sources } => {
                let source = sources.of(model);
                let default =
                    self.alternative(Way::Default).and_then(|default| default.value.as_ref());
                if default == Some(&self.chosen) {
                    format!(
                        "It is the default, and no other value is better by more than one standard error over {streams} streams \
                         of {source}."
                    )
                } else {
                    format!(
                        "It is better than the default by more than one standard error, over {streams} streams of {source}."
                    )
                }
            }
        }
    }

    fn worst_rank_sentence(&self) -> String {
        let Self { model, worst_rank, values, members, .. } = self;
        if *members == 1 {
            return format!("{model} ranks it {} of {values} values.", ordinal(*worst_rank));
        }
        let place = match worst_rank {
            1 => format!("best of {values} values in all {members} members"),
            rank => format!(
                "never below {} of {values} values in its {members} members",
                ordinal(*rank)
            ),
        };
        format!("{model} ranks it {place}.")
    }

    fn tie_sentence(&self, score: &Score) -> Option<String> {
        let others: Vec<String> = self
            .tie_set
            .iter()
            .filter(|value| **value != self.chosen)
            .map(ToString::to_string)
            .collect();
        if others.is_empty() {
            return None;
        }
        Some(format!(
            "It ties with {} on worst rank; mean rank, then mean {}, then the order of the grid decided.",
            listed(&others),
            score.name
        ))
    }

    fn stability_sentence(&self) -> Option<String> {
        let own = self.stability.iter().find(|(value, _)| *value == self.chosen);
        let share = own.map_or(0.0, |&(_, share)| share);
        let others: Vec<String> = self
            .stability
            .iter()
            .filter(|(value, _)| *value != self.chosen)
            .take(2)
            .map(|(value, share)| format!("{value} in {}", percent(*share)))
            .collect();
        if self.stability.is_empty() {
            return None;
        }
        Some(match others.as_slice() {
            [] => {
                "Every other draw of members, runs and windows of the log would choose it as well."
                    .to_owned()
            }
            _ => format!(
                "{} resamples of members, runs and windows of the log would choose it as well{}: {}{}.",
                if share >= ALL {
                    "Nearly all".to_owned()
                } else {
                    format!("{} of", percent(share))
                },
                if share < STABLE { ", so the choice is not certain" } else { "" },
                listed(&others),
                self.stability_nearby.filter(|_| share < ALL).map_or_else(String::new, |share| {
                    format!("; it or a value next to it in {}", percent(share))
                })
            ),
        })
    }

    fn default_sentence(&self, online: &Agreement) -> Option<String> {
        let default = self.alternative(Way::Default)?;
        let value = default.value.as_ref()?;
        if *value == self.chosen {
            return Some("The default is the same value.".to_owned());
        }
        let Some(against) = online.against_default else {
            return self.alternative_sentence(Way::Default);
        };
        if !against.value.is_finite() {
            return Some(format!("The default ({value}) did not diverge."));
        }
        if against.value == 0.0 {
            return Some(format!("The default ({value}) would have diverged."));
        }
        let (less, word) = match against.value {
            ratio if ratio <= 1.0 => (1.0 - ratio, "less"),
            ratio => (ratio - 1.0, "more"),
        };
        let sure = against.interval.map_or_else(String::new, |interval| {
            let told = if interval.low <= 1.0 && interval.high >= 1.0 {
                "; the interval holds equality"
            } else {
                ""
            };
            format!(
                " (quotient {:.2}, 95 %: {:.2} to {:.2}{told})",
                against.value, interval.low, interval.high
            )
        });
        Some(format!("It has {} {word} error than the default, {value}{sure}.", percent(less)))
    }

    fn alternative_sentence(&self, way: Way) -> Option<String> {
        let Alternative { value, regret, .. } = self.alternative(way)?;
        let value = value.as_ref()?;
        let name = match way {
            Way::Default => "The default",
            Way::LogReplay => "Log replay's choice",
            _ => "The choice of the log's latest window",
        };
        if *value == self.chosen {
            return Some(format!("{name} is the same value."));
        }
        let regret = (*regret)?;
        if regret.value.is_infinite() {
            return Some(format!("{name} ({value}) would have diverged."));
        }
        Some(format!("{name} ({value}) would have had a regret of {}.", with_interval(regret)))
    }

    fn window_sentence(&self, online: &Agreement) -> String {
        let cost = |way| self.regret_of(way).map(percent);
        let Some(another) = cost(Way::AnotherWindow) else {
            let reason = match online.windows {
                0 | 1 => "only one window was held out",
                _ => "too few windows can be compared",
            };
            return format!("How much of that is the luck of a window cannot be told: {reason}.");
        };
        let hindsight = cost(Way::Hindsight)
            .map_or_else(String::new, |cost| format!(", and the best constant value {cost}"));
        let random = cost(Way::Random).map_or_else(String::new, |cost| {
            format!("; a value drawn at random costs {cost} on average")
        });
        format!("Choosing by another held-out window would have cost {another}{hindsight}{random}.")
    }
}

/// "1.20, 95 %: 1.10 to 1.31".
pub(super) fn ratio_interval(ratio: Estimate) -> Option<String> {
    let interval = ratio.interval?;
    Some(format!("{:.2}, 95 %: {:.2} to {:.2}", ratio.value, interval.low, interval.high))
}

/// "2.5 % (95 %: at most 4 %)".
pub(super) fn with_interval(regret: Bounded) -> String {
    let value = percent(regret.value);
    let bound = |upper| format!("{value} (95 %: at most {})", percent(upper));
    regret.upper.map_or_else(|| value.clone(), bound)
}

fn online_sentence(verdict: &Verdict, online: &Agreement, score: &Score) -> String {
    let Verdict { sensor, chosen, values, .. } = verdict;
    let error = number(online.chosen_error);
    let name = &score.name;
    let on = format!("{} of {}", online.part, windows(online));
    match online.regret {
        _ if online.stands_still => {
            format!(
                "On held-out data ({on}) {sensor} is constant: there is nothing to predict, so no error says anything."
            )
        }
        Some(_) if *values == 1 => format!("On held-out data ({on}) its {name} is {error}."),
        Some(_) if online.values == Told::Alike => format!(
            "On held-out data ({on}) all {values} values have the same error ({name} {error}): nothing there tells them apart."
        ),
        None => format!("On held-out data ({on}) every value diverged, so there is no best one."),
        Some(regret) if regret.value.is_infinite() => format!(
            "On held-out data ({on}) it diverged; the best value was {} ({name} {}).",
            online.best,
            number(online.best_error)
        ),
        Some(regret) if regret.value == 0.0 => {
            format!(
                "On held-out data ({on}) it is the best value in every window ({name} {error})."
            )
        }
        Some(regret) if online.best == *chosen => format!(
            "On held-out data ({on}) it is the best value over all windows ({name} {error}); its regret against the best of \
             each is {}.",
            with_interval(regret)
        ),
        Some(regret) => format!(
            "On held-out data ({on}) its regret is {}; the best value over all windows is {} ({name} {} against {error}).",
            with_interval(regret),
            online.best,
            number(online.best_error)
        ),
    }
}

/// "4 windows, 16 runs".
fn windows(online: &Agreement) -> String {
    let plural =
        |count: usize, name: &str| format!("{count} {name}{}", if count == 1 { "" } else { "s" });
    format!("{}, {}", plural(online.windows, "window"), plural(online.runs, "run"))
}

fn skill_sentence(online: &Agreement) -> Option<String> {
    let skill = online.chosen_skill?;
    let best = online.best_skill.filter(|best| best - skill > 0.005);
    let best =
        best.map_or_else(String::new, |best| format!(" The best value's is {}.", signed(best)));
    Some(if skill > 0.0 {
        format!(
            "Its skill is {}: {} less error than the mean return of each window, which nobody knows beforehand.{best} \
             NRMSE divides by the spread of returns in the training range.",
            signed(skill),
            percent(skill)
        )
    } else {
        format!(
            "Its skill is {}: it predicts no better than the mean return of each window, which nobody knows beforehand.{best} \
             NRMSE divides by the spread of returns in the training range.",
            signed(skill)
        )
    })
}

/// A skill with two decimals, and no sign of its own where they are 0.
fn signed(skill: f64) -> String {
    format!("{skill:.2}").replace("-0.00", "0.00")
}

fn agreement_sentence(online: &Agreement) -> String {
    let top = online.top_k.map_or(String::new(), |top| {
        let not = if top.hit { "" } else { "not " };
        format!(" The choice is {not}among the {} best Online.", top.k)
    });
    let Some(spearman) = online.spearman else {
        return format!(
            "Agreement with Online's ranking is undefined, because one of the two ranks all values alike.{top}"
        );
    };
    let strength = match spearman {
        rho if rho >= 0.8 => "agrees closely with",
        rho if rho >= 0.5 => "agrees roughly with",
        rho if rho >= 0.2 => "agrees only weakly with",
        rho if rho > -0.2 => "has nothing to do with",
        _ => "contradicts",
    };
    let kendall = online.kendall.map_or(String::new(), |tau| format!(", Kendall {tau:.2}"));
    format!("The ranking of all values {strength} Online's (Spearman {spearman:.2}{kendall}).{top}")
}

#[cfg(test)]
pub(super) mod tests;
