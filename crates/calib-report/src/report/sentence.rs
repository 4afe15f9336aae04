//! A verdict in sentences for readers without knowledge of statistics.

use calib_agent::SimplePredictor;
use calib_core::{factor, is_many_times, number, percent};
use calib_stats::{Bounded, Estimate, Interval};

use super::{Alternative, ChoiceBaseline, Grade, HeldOutResult, Reason, Separation, Verdict};
use crate::{Setting, figures::NRMSE};

mod words;

pub(super) use words::assigned;
use words::{fields, ordinal};
pub use words::{joined, listed};

/// Choices with a smaller share of the resamples than this count as uncertain.
const STABLE: f64 = 0.8;

/// Larger shares would be rounded to 100 %.
const ALL: f64 = 0.995;

impl Verdict {
    /// Returns the verdict in one sentence.
    pub fn headline(&self) -> String {
        let Self { sensor, chosen, .. } = self;
        let choice = self.assigned();
        let field = fields(&self.field);
        match self.grade {
            _ if self.is_arbitrary() => {
                format!("No clear difference for {sensor}: all settings of {field} did alike.")
            }
            Grade::Simpler => match &self.simpler {
                Some(simpler) => self.simpler_headline(simpler),
                None => format!("Use a simple predictor for {sensor}, not an agent."),
            },
            Grade::Good | Grade::Fair => match self.frozen {
                Some(predictor) if self.may_gain_by_learning() => format!(
                    "Use {} for {sensor} for now: further learning may help, but it is not shown.",
                    predictor.label()
                ),
                Some(predictor) if self.has_few_windows() => format!(
                    "Use {} for {sensor} for now: too few held-out windows to tell whether further learning helps.",
                    predictor.label()
                ),
                Some(predictor) if self.excludes_a_gain() => format!(
                    "Use {} for {sensor}: further learning adds nothing.",
                    predictor.label()
                ),
                Some(predictor) => format!(
                    "Use {} for {sensor}: no clear gain from further learning.",
                    predictor.label()
                ),
                None if self.has_few_windows() => {
                    format!(
                        "Use {choice} for {sensor} for now: too few held-out windows to be sure."
                    )
                }
                None => format!("Use {choice} for {sensor}."),
            },
            Grade::Poor if self.has_all_diverged() => {
                format!("No setting of {field} can be deployed for {sensor}: every one diverged.")
            }
            Grade::Poor if self.elsewhere.is_some() => format!(
                "Do not deploy an agent for {sensor}: held-out values are far from all that it was trained on."
            ),
            Grade::Poor => match self.better_default() {
                Some(default) => {
                    let default = assigned(&self.field, default);
                    format!("Keep the default, {default}, for {sensor}: {chosen} is worse.")
                }
                None => format!("Do not deploy {choice} for {sensor} on this evidence."),
            },
            Grade::NotLearnt if self.is_of_log() => format!(
                "Do not deploy an agent for {sensor}: at this horizon, nothing is shown on the log to predict it better than its training mean."
            ),
            Grade::NotLearnt if self.left_training().is_some() => {
                format!("Do not deploy an agent for {sensor}: it was never trained on such values.")
            }
            Grade::NotLearnt if !self.simple.is_empty() => format!(
                "Do not deploy an agent for {sensor}: at this horizon, nothing is shown to predict it better than its training mean."
            ),
            Grade::NotLearnt if self.hardly_varies() => format!(
                "{sensor} hardly varies in the held-out windows, and no setting of {field} predicts it better than their own means would: nothing to deploy on this evidence."
            ),
            Grade::NotLearnt => {
                format!("No setting of {field} learns {sensor}: do not deploy on this evidence.")
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

    /// Whether errors are small relative to the spread of returns in training (less than half), although nothing beats the mean of
    /// each window. The windows are then too short, or too quiet, to show whether an agent learned.
    pub(super) fn hardly_varies(&self) -> bool {
        self.left_training().is_none()
            && self.online.as_ref().is_some_and(|online| online.best_error < 0.5)
    }

    /// Returns the share of held-out values outside the training range, if it is more than half. Such a sensor is not quiet: it has
    /// left its training range.
    pub(super) fn left_training(&self) -> Option<f64> {
        self.outside_training.filter(|share| *share > 0.5)
    }

    /// Returns NRMSE and skill of the best setting on held-out data, and the NRMSE of the training mean there, as far as
    /// they are known.
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
        let mut means = self.simple.iter().filter(|row| row.predictor == SimplePredictor::Mean);
        let mean = means.find(|row| row.error.is_finite()).map_or_else(String::new, |row| {
            format!(" The NRMSE of the training mean is {}.", number(row.error))
        });
        Some(format!("The best setting, {best}, has an NRMSE of {error}{skill}.{mean}"))
    }

    /// Returns the choice as it is typed.
    pub(super) fn assigned(&self) -> String {
        assigned(&self.field, &self.chosen)
    }

    /// Returns the sentence that the choice is the default.
    pub(super) fn chosen_is_default(&self) -> String {
        format!("The chosen setting, {}, is the default.", self.assigned())
    }

    /// Returns the default, if held-out data shows that it is better than the choice.
    pub(super) fn better_default(&self) -> Option<&Setting> {
        let against = self.online.as_ref()?.against_default?;
        let better = against.interval.is_some_and(|interval| interval.low > 1.0);
        self.alternative(ChoiceBaseline::Default)?.value.as_ref().filter(|_| better)
    }

    /// Returns the reasons, one sentence each: selection, ties, stability, held-out result, alternatives, agreement. A choice that must
    /// not be used has only its name and its result. `notes` are reported elsewhere.
    pub fn reasons(&self) -> Vec<String> {
        let mut reasons = if self.grade == Grade::NotLearnt && self.evidence == Separation::Apart {
            vec![format!("The choice of {} is {}.", self.model, self.assigned())]
        } else {
            self.reasons_of_choice()
        };
        match &self.online {
            None => reasons.push(
                "No data was held out, so regret and agreement with the held-out period are unknown."
                    .to_owned(),
            ),
            Some(online) => reasons.extend(self.reasons_of_online(online)),
        }
        if self.is_of_log() {
            reasons.extend(self.simple_sentence());
        }
        reasons
    }

    /// Returns the reasons for the choice.
    fn reasons_of_choice(&self) -> Vec<String> {
        if self.values == 1 {
            return vec!["There is no other setting to choose from.".to_owned()];
        }
        if self.evidence == Separation::Alike {
            return vec![self.alike_sentence()];
        }
        let mut reasons = vec![self.reason_sentence()];
        if self.reason == Reason::WorstRank {
            reasons.extend(self.tie_sentence());
        } else if self.has_model() {
            reasons.push(self.worst_rank_sentence());
        }
        reasons.extend(self.stability_sentence());
        reasons
    }

    /// Returns the result on held-out data, beside other selection methods.
    fn reasons_of_online(&self, online: &HeldOutResult) -> Vec<String> {
        let mut reasons = vec![online_sentence(self, online)];
        if online.stands_still || self.has_all_diverged() {
            return reasons;
        }
        if !self.is_of_log() {
            reasons.extend(self.simple_sentence());
        }
        if self.simple.is_empty() {
            reasons.extend(skill_sentence(online));
        }
        if self.grade == Grade::NotLearnt || online.values == Separation::Alike || self.values == 1
        {
            return reasons;
        }
        reasons.extend(self.default_sentence(online));
        let others = [ChoiceBaseline::LogReplay, ChoiceBaseline::LatestWindow];
        reasons
            .extend(others.into_iter().filter_map(|baseline| self.alternative_sentence(baseline)));
        reasons.push(self.window_sentence(online));
        reasons.push(agreement_sentence(online));
        reasons
    }

    fn alike_sentence(&self) -> String {
        format!(
            "Nothing was chosen: all {} settings did alike in every run that counts, and {} stands for any of them.",
            self.values, self.chosen
        )
    }

    fn reason_sentence(&self) -> String {
        let model = &self.model;
        match self.reason {
            Reason::WorstRank => self.worst_rank_sentence(),
            Reason::MeanRank => {
                format!("{model} ranks it best on average over its ensemble members.")
            }
            Reason::MeanError => format!("Chosen for the smallest mean error in {model}."),
            Reason::MeanLogError { streams } => format!(
                "Chosen for the smallest error, as a geometric mean over {streams} training runs in {model}."
            ),
            Reason::Pooled { streams, sources } => format!(
                "Chosen for the smallest error, as a geometric mean over {streams} training runs {}.",
                sources.within(model)
            ),
            Reason::LogReplay { streams } => {
                let other = if self.has_model() {
                    format!(" {model} did not count.")
                } else {
                    String::new()
                };
                format!(
                    "Chosen for the smallest error, as a geometric mean over {streams} windows of the replayed log.{other}"
                )
            }
            Reason::OneStandardError { streams, sources } => {
                let source = sources.within(model);
                let default = self
                    .alternative(ChoiceBaseline::Default)
                    .and_then(|default| default.value.as_ref());
                if default == Some(&self.chosen) {
                    format!(
                        "It is the default, and no other setting is better by more than one standard error over {streams} training runs {source}."
                    )
                } else {
                    format!(
                        "It is better than the default by more than one standard error, over {streams} training runs {source}."
                    )
                }
            }
        }
    }

    fn worst_rank_sentence(&self) -> String {
        let Self { model, worst_rank, values, members, .. } = self;
        if *members == 1 {
            return format!("{model} ranks it {} of {values} settings.", ordinal(*worst_rank));
        }
        match worst_rank {
            1 => format!(
                "{model} ranks it best of {values} settings in all {members} ensemble members."
            ),
            rank => format!(
                "{model} never ranks it below {} of {values} settings in its {members} ensemble members.",
                ordinal(*rank)
            ),
        }
    }

    fn tie_sentence(&self) -> Option<String> {
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
            "It ties with {} on worst rank; mean rank, then mean {NRMSE}, then the order of the grid decided.",
            listed(&others)
        ))
    }

    /// Returns the name of the evidence that is resampled for the stability of a choice.
    const fn evidence(&self) -> &'static str {
        if self.has_model() {
            "its evidence (models, runs and windows of the log)"
        } else {
            "its evidence (windows of the log)"
        }
    }

    fn stability_sentence(&self) -> Option<String> {
        if self.stability.is_empty() {
            return None;
        }
        let Self { chosen, .. } = self;
        let evidence = self.evidence();
        let own = self.stability.iter().find(|(value, _)| value == chosen);
        let share = own.map_or(0.0, |&(_, share)| share);
        let others = self.stability.iter().filter(|(value, _)| value != chosen).take(2);
        let others: Vec<String> =
            others.map(|(value, share)| format!("{value} in {}", percent(*share))).collect();
        if others.is_empty() {
            return Some(format!("When calib resamples {evidence}, {chosen} always wins."));
        }
        let when = if share < STABLE { "Not certain: when" } else { "When" };
        let wins = if share >= ALL {
            "nearly always".to_owned()
        } else {
            format!("in {}", percent(share))
        };
        let each: Vec<String> =
            [format!("{chosen} wins {wins}")].into_iter().chain(others).collect();
        let nearby =
            self.stability_nearby.filter(|_| share < ALL).map_or_else(String::new, |share| {
                format!(" It or a setting next to it wins in {}.", percent(share))
            });
        Some(format!("{when} calib resamples {evidence}, {}.{nearby}", listed(&each)))
    }

    fn default_sentence(&self, online: &HeldOutResult) -> Option<String> {
        let default = self.alternative(ChoiceBaseline::Default)?;
        let value = default.value.as_ref()?;
        if *value == self.chosen {
            return Some(self.chosen_is_default());
        }
        let Some(against) = online.against_default else {
            return self.alternative_sentence(ChoiceBaseline::Default);
        };
        if !against.value.is_finite() {
            return Some(format!("The default ({value}) did not diverge."));
        }
        if against.value == 0.0 {
            return Some(format!("The default ({value}) would have diverged."));
        }
        let may_be_equal =
            against.interval.is_some_and(|interval| interval.low <= 1.0 && interval.high >= 1.0);
        Some(format!(
            "It has {} error than the default, {value}{}{}.",
            changed(against.value),
            if may_be_equal { ", which could be chance" } else { "" },
            chance_of_change(against)
        ))
    }

    fn alternative_sentence(&self, baseline: ChoiceBaseline) -> Option<String> {
        let Alternative { value, regret, .. } = self.alternative(baseline)?;
        let value = value.as_ref()?;
        let name = match baseline {
            ChoiceBaseline::Default => "The default",
            ChoiceBaseline::LogReplay => "Log replay's choice",
            _ => "The choice of the log's latest window",
        };
        if *value == self.chosen {
            return Some(format!("{name} is the same setting."));
        }
        let regret = (*regret)?;
        if regret.value.is_infinite() {
            return Some(format!("{name} ({value}) would have diverged."));
        }
        Some(format!("{name} ({value}) would have had a regret of {}.", with_interval(regret)))
    }

    /// Formats the regret of another selection method, if it is known.
    fn cost_of(&self, baseline: ChoiceBaseline) -> Option<String> {
        self.regret_of(baseline).map(percent)
    }

    fn window_sentence(&self, online: &HeldOutResult) -> String {
        let Some(another) = self.cost_of(ChoiceBaseline::AnotherWindow) else {
            let reason = match online.windows {
                0 | 1 => "only one window was held out",
                _ => "too few windows can be compared",
            };
            return format!("How much of that is luck cannot be judged: {reason}.");
        };
        let mut each = vec![format!(
            "choosing by one other window of the held-out period would have cost {another}"
        )];
        each.extend(
            self.cost_of(ChoiceBaseline::Hindsight)
                .map(|cost| format!("the best fixed setting {cost}")),
        );
        each.extend(
            self.cost_of(ChoiceBaseline::Random)
                .map(|cost| format!("a random setting {cost} on average")),
        );
        format!("For scale: {}.", listed(&each))
    }
}

/// Formats a ratio of errors: "20 % less".
pub(super) fn changed(ratio: f64) -> String {
    match ratio {
        ratio if ratio.is_infinite() => "divergence".to_owned(),
        ratio if ratio <= 1.0 => format!("{} less", percent(1.0 - ratio)),
        ratio => format!("{} more", percent(ratio - 1.0)),
    }
}

/// Ratios from this one on are given as a factor in an interval: our choice.
const FACTOR: f64 = 10.0;

/// Formats an interval of ratios: "10 % to 30 % less", "9 % less to 2 % more", "5 % less to 55 times as much".
fn between(Interval { low, high }: Interval) -> String {
    match (low, high) {
        (low, high) if high >= FACTOR && high.is_finite() => {
            let low = if low >= FACTOR { factor(low) } else { changed(low) };
            format!("{low} to {} times as much", factor(high))
        }
        (low, high) if high <= 1.0 => format!("{} to {}", percent(1.0 - high), changed(low)),
        (low, high) if low >= 1.0 => format!("{} to {}", percent(low - 1.0), changed(high)),
        _ => format!("{} to {}", changed(low), changed(high)),
    }
}

/// Formats the interval of a ratio of errors: " (95 %: 10 % to 30 % less)"; empty without an interval.
pub(super) fn chance_of_change(ratio: Estimate) -> String {
    ratio.interval.map_or_else(String::new, |interval| format!(" (95 %: {})", between(interval)))
}

/// Formats a regret with its bound: "2.5 % (95 %: at most 4 %)".
pub(super) fn with_interval(regret: Bounded) -> String {
    let value = percent(regret.value);
    regret.upper.map_or_else(
        || value.clone(),
        |upper| {
            let most = if is_many_times(upper) { "perhaps" } else { "at most" };
            format!("{value} (95 %: {most} {})", percent(upper))
        },
    )
}

fn online_sentence(verdict: &Verdict, online: &HeldOutResult) -> String {
    let Verdict { sensor, chosen, values, .. } = verdict;
    let error = number(online.chosen_error);
    let on = format!("{} of {}", online.part, windows(online));
    match online.regret {
        _ if online.stands_still => {
            format!(
                "On held-out data ({on}) {sensor} is constant: there is nothing to predict, and errors say nothing."
            )
        }
        Some(_) if *values == 1 => format!("On held-out data ({on}) its {NRMSE} is {error}."),
        Some(_) if online.values == Separation::Alike => format!(
            "On held-out data ({on}) all {values} settings have the same error ({NRMSE} {error}), so it shows no difference between them."
        ),
        None => format!("On held-out data ({on}) every setting diverged, so there is no best one."),
        Some(regret) if regret.value.is_infinite() => format!(
            "On held-out data ({on}) it diverged. The best setting was {} ({NRMSE} {}).",
            online.best,
            number(online.best_error)
        ),
        Some(regret) if regret.value == 0.0 => {
            format!(
                "On held-out data ({on}) it is the best setting in every window ({NRMSE} {error})."
            )
        }
        Some(regret) if online.best == *chosen => format!(
            "On held-out data ({on}) it is the best setting over all windows ({NRMSE} {error}). Its regret against the best of each is {}.",
            with_interval(regret)
        ),
        Some(regret) => format!(
            "On held-out data ({on}) its regret is {}. The best setting over all windows is {} ({NRMSE} {} against {error}).",
            with_interval(regret),
            online.best,
            number(online.best_error)
        ),
    }
}

/// Formats the evidence: "4 windows, 16 runs".
fn windows(online: &HeldOutResult) -> String {
    format!("{}, {}", counted(online.windows, "window"), counted(online.runs, "run"))
}

/// Formats a count with its noun: "1 run", "4 runs".
fn counted(count: usize, name: &str) -> String {
    format!("{count} {name}{}", if count == 1 { "" } else { "s" })
}

fn skill_sentence(online: &HeldOutResult) -> Option<String> {
    let skill = online.chosen_skill?;
    let best = online.best_skill.filter(|best| best - skill > 0.005);
    let best =
        best.map_or_else(String::new, |best| format!(" The best setting's is {}.", signed(best)));
    Some(if skill > 0.0 {
        format!(
            "Its skill is {}: {} less error than the mean return of each window, which is only known afterwards.{best} \
             NRMSE divides by the spread of returns in the training range.",
            signed(skill),
            percent(skill)
        )
    } else {
        format!(
            "Its skill is {}: it predicts no better than the mean return of each window, which is only known afterwards.{best} \
             NRMSE divides by the spread of returns in the training range.",
            signed(skill)
        )
    })
}

/// Formats a skill with two decimals, without a sign if they are 0.
fn signed(skill: f64) -> String {
    format!("{skill:.2}").replace("-0.00", "0.00")
}

fn agreement_sentence(online: &HeldOutResult) -> String {
    let top = online.top_k.map_or(String::new(), |top| {
        let not = if top.hit { "" } else { "not " };
        format!(" The choice is {not}among the {} best there.", top.k)
    });
    let Some(spearman) = online.spearman else {
        return format!(
            "Agreement with the ranking on held-out data is undefined, because one of the two ranks all settings alike.{top}"
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
    format!(
        "The ranking of all settings {strength} the one on held-out data (Spearman {spearman:.2}{kendall}).{top}"
    )
}

#[cfg(test)]
pub(super) mod tests;
