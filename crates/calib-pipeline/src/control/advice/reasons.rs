//! The reasons why the log does not support a choice, in words.

use std::cmp::Reverse;

use calib_base::output::{counted, number, percent};
use calib_control::{Doubt, FEWEST_BLOCKS};

use super::{Advice, vocabulary::Vocabulary};
use crate::control::held_out_period::period_name;

const ONE_MEMBER: &str = "one ensemble member gives no interval: nothing shows that the choice is better than the default, random actions, a constant action or what was recorded";

/// Up to this number of recorded episodes, the best of them says little. Our choice.
const FEW_EPISODES: f64 = 10.0;

/// Returns the number of recorded episodes if these are few, and otherwise an empty text.
fn few_recorded(episodes: f64) -> String {
    if episodes < FEW_EPISODES {
        format!(" (the log has steps for only {} episodes)", number(episodes))
    } else {
        String::new()
    }
}

/// A reason why the log does not support a choice.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Reason {
    /// The doubt.
    pub what: String,
    /// The remedy.
    pub remedy: String,
}

impl Reason {
    /// Returns both in one line.
    pub fn whole(&self) -> String {
        format!("{}; {}", self.what, self.remedy)
    }
}

impl Advice<'_> {
    /// Returns the reasons why the log does not support the choice, each with a remedy, strongest first.
    pub fn reasons(&self) -> Vec<Reason> {
        let mut doubts: Vec<&Doubt> = self.verdict.doubts.iter().collect();
        doubts.sort_by_key(|doubt| Reverse(strength(doubt)));
        doubts.into_iter().map(|doubt| self.reason(doubt)).collect()
    }

    fn reason(&self, doubt: &Doubt) -> Reason {
        let Vocabulary { steps, runs, members, most_uncovered, fewest_terminals, .. } =
            self.vocabulary;
        let (what, remedy) = match doubt {
            Doubt::WorseThanConstant { action, constant, promised } => {
                return self.constant_gets_more(*action, *constant, *promised);
            }
            Doubt::NotBetterThanRandomActions { random, promised } => {
                return self.random_actions_may_be_as_good(*random, *promised);
            }
            Doubt::Displaced { column, mean, error } => {
                return self.displaced(*column, *mean, *error);
            }
            Doubt::HeldOutUncovered { deployment, share } => {
                return held_out_uncovered(deployment.as_deref(), *share, most_uncovered);
            }
            Doubt::FewTerminals { terminals } => {
                return few_terminals(*terminals, fewest_terminals);
            }
            Doubt::RareTerminals { in_model, in_log } => {
                return rare_terminals(*in_model, *in_log);
            }
            Doubt::Diverged => (
                "the chosen setting diverged in a model".to_owned(),
                "sweep smaller step sizes".to_owned(),
            ),
            Doubt::DefaultFailed => (
                format!(
                    "{}, so that the choice cannot be compared with it",
                    self.vocabulary.default_failed
                ),
                self.vocabulary.mend_default.to_owned(),
            ),
            Doubt::OneMember => (
                ONE_MEMBER.to_owned(),
                format!("use {FEWEST_BLOCKS} ensemble members or more ({members})"),
            ),
            Doubt::ActionNeverTaken { action } => (
                format!("{} was never taken: no model knows what it does", self.action(*action)),
                "record some steps with it".to_owned(),
            ),
            Doubt::Uncovered { share } => (
                format!(
                    "{} of the chosen setting's steps lie where the log has no such action",
                    percent(*share)
                ),
                format!("record more varied actions, or allow more with {most_uncovered}"),
            ),
            Doubt::NotToldApart => (
                "the models together show no clear difference between the settings".to_owned(),
                format!("sweep settings that differ more, or longer ({steps})"),
            ),
            Doubt::NotBetterThanDefault => (
                "over blocks of the log there is no clear difference between the chosen setting and the default"
                    .to_owned(),
                format!("keep the default, or sweep with more runs ({runs}) or longer ({steps})"),
            ),
            Doubt::BelowRecorded { promised, recorded } => (
                format!(
                    "the chosen setting gets {} per episode in the model, learning included, and the recorded behaviour got {}",
                    number(*promised),
                    number(*recorded)
                ),
                format!("keep that, or let agents learn for longer ({steps})"),
            ),
            Doubt::AboveRecorded { promised, best } => (
                format!(
                    "the model promises {} per episode, and no recorded episode got more than {}{}: nothing in the record shows that so much is possible",
                    number(*promised),
                    number(*best),
                    few_recorded(self.verdict.behaviour.episodes)
                ),
                "record better episodes, or try the choice where nothing can be harmed".to_owned(),
            ),
        };
        Reason { what, remedy }
    }

    /// Returns the doubt that jumps displace the episodes of the choice too far.
    fn displaced(&self, column: usize, mean: f64, error: f64) -> Reason {
        Reason {
            what: format!(
                "jumps between recorded rows move {} by {} times its recorded range in an episode of the chosen setting in the model (standard error {}), always to the \
                 same side: together they undo what its actions do, for example if an actuator was never recorded beyond some level",
                self.columns.get(column).map_or("?", String::as_str),
                number(mean),
                number(error)
            ),
            remedy: "record steps there, or take the change of the column for the action"
                .to_owned(),
        }
    }
}

/// Returns the doubt that the log has few terminals. `key` allows fewer.
fn few_terminals(terminals: usize, key: &str) -> Reason {
    Reason {
        what: format!(
            "only {} {} in a terminal, and choices depend on what leads there",
            counted(terminals, "episode"),
            if terminals == 1 { "ends" } else { "end" }
        ),
        remedy: format!("record more, or allow fewer with {key}"),
    }
}

/// Returns the doubt that a held-out period has left the training range. `key` allows more of its decisions to.
fn held_out_uncovered(deployment: Option<&str>, share: f64, key: &str) -> Reason {
    // A period without a name may be the rest after the fraction.
    let training = match deployment {
        Some(_) => "data.train",
        None => "data.train or data.train_fraction",
    };
    Reason {
        what: format!(
            "{} of the decisions of the {} were made in states that the training range does not cover: no model knows what actions do there",
            percent(share),
            period_name(deployment)
        ),
        remedy: format!("let {training} have such states, or allow more with {key}"),
    }
}

/// Returns the doubt that the choice reaches a terminal much less often than the log.
fn rare_terminals(in_model: f64, in_log: f64) -> Reason {
    Reason {
        what: format!(
            "{} of the chosen setting's steps in the model end an episode in a terminal, and {} of the recorded ones: its agents go where the log hardly shows what ends an episode",
            percent(in_model),
            percent(in_log)
        ),
        remedy: "record steps there".to_owned(),
    }
}

/// Returns how strongly a doubt speaks against the choice. In descending order: the plant would do worse than now,
/// nothing was learned, too little is known, and predictions may not hold. Our choice.
fn strength(doubt: &Doubt) -> usize {
    match doubt {
        Doubt::Diverged => 13,
        Doubt::DefaultFailed => 12,
        Doubt::OneMember => 11,
        Doubt::BelowRecorded { .. } => 10,
        Doubt::WorseThanConstant { .. } => 9,
        Doubt::NotBetterThanRandomActions { .. } => 8,
        Doubt::ActionNeverTaken { .. } => 7,
        Doubt::Uncovered { .. } | Doubt::HeldOutUncovered { .. } => 6,
        Doubt::NotToldApart => 5,
        Doubt::NotBetterThanDefault => 4,
        Doubt::Displaced { .. } => 3,
        Doubt::RareTerminals { .. } => 2,
        Doubt::FewTerminals { .. } => 1,
        Doubt::AboveRecorded { .. } => 0,
    }
}
