//! A verdict in sentences that need no statistics to be understood.

use std::cmp::Ordering;

use super::{Agreement, Alternative, Grade, Verdict};
use crate::number::{number, percent};
use crate::{Score, Setting};

impl Verdict {
    /// The verdict in one sentence.
    pub fn headline(&self) -> String {
        let Self { sensor, field, chosen, .. } = self;
        match self.grade() {
            Grade::Good | Grade::Fair => format!("Use {field} = {chosen} for {sensor}."),
            Grade::Poor => {
                format!("Do not deploy {field} = {chosen} for {sensor} on this evidence.")
            }
            Grade::Unchecked => {
                format!("Use {field} = {chosen} for {sensor}, as far as the logs can tell.")
            }
        }
    }

    /// The reasons, one sentence each: worst rank and ties, Online, alternatives, agreement.
    pub fn reasons(&self, score: &Score) -> Vec<String> {
        let mut reasons = vec![self.worst_rank_sentence()];
        reasons.extend(self.tie_sentence(score));
        match &self.online {
            None => reasons.push(
                "No held-out data was given: regret and agreement with Online are unknown."
                    .to_owned(),
            ),
            Some(online) => {
                reasons.push(online_sentence(&self.chosen, online, score));
                let alternatives =
                    [("The default", &self.default), ("Log replay's choice", &self.log_replay)];
                for (name, alternative) in alternatives {
                    let Some(alternative) = alternative else { continue };
                    reasons.extend(self.alternative_sentence(name, alternative, online.regret));
                }
                reasons.push(agreement_sentence(online));
            }
        }
        reasons.extend(self.notes.iter().cloned());
        reasons
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

    fn alternative_sentence(
        &self,
        name: &str,
        alternative: &Alternative,
        chosen_regret: Option<f64>,
    ) -> Option<String> {
        let value = &alternative.value;
        if *value == self.chosen {
            return Some(format!("{name} is the same value."));
        }
        let regret = alternative.regret?;
        if !regret.is_finite() {
            return Some(format!("{name} ({value}) would have diverged."));
        }
        let cost = percent(regret);
        Some(match regret.partial_cmp(&chosen_regret?)? {
            Ordering::Greater => {
                format!("{name} ({value}) would have cost {cost} against the best value.")
            }
            Ordering::Equal => format!("{name} ({value}) would have been just as good."),
            Ordering::Less if regret == 0.0 => {
                format!("{name} ({value}) would have been better: it is the best value.")
            }
            Ordering::Less => {
                format!("{name} ({value}) would have been better: it costs only {cost}.")
            }
        })
    }
}

fn online_sentence(chosen: &Setting, online: &Agreement, score: &Score) -> String {
    let error = number(online.chosen_error);
    let name = &score.name;
    match online.regret {
        Some(0.0) => {
            format!("On held-out data it is the best value of the grid ({name} {error}).")
        }
        // An alternative outside the grid can be better than all of it.
        Some(regret) if online.best == *chosen => format!(
            "On held-out data it is the best value of the grid ({name} {error}), yet {} worse than the best \
             alternative outside it.",
            percent(regret)
        ),
        Some(regret) if regret.is_finite() => format!(
            "On held-out data it is {} worse than the best value, {} ({name} {error} against {}).",
            percent(regret),
            online.best,
            number(online.best_error)
        ),
        Some(_) => format!(
            "On held-out data it diverged; the best value was {} ({name} {}).",
            online.best,
            number(online.best_error)
        ),
        None => "On held-out data every value diverged, so there is no best one.".to_owned(),
    }
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

/// "2nd".
fn ordinal(rank: usize) -> String {
    let suffix = match (rank % 10, rank % 100) {
        (1, tens) if tens != 11 => "st",
        (2, tens) if tens != 12 => "nd",
        (3, tens) if tens != 13 => "rd",
        _ => "th",
    };
    format!("{rank}{suffix}")
}

/// "a", "a and b", "a, b and c".
pub(super) fn listed(items: &[String]) -> String {
    match items {
        [] => String::new(),
        [one] => one.clone(),
        [first @ .., last] => format!("{} and {last}", first.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TopK;

    fn verdict() -> Verdict {
        Verdict {
            sensor: "PIT300".to_owned(),
            field: "learning_rate".to_owned(),
            model: "kNN".to_owned(),
            chosen: Setting::from(1e-4),
            tie_set: [3e-5, 1e-4, 3e-4].map(Setting::from).to_vec(),
            worst_rank: 2,
            values: 9,
            members: 5,
            online: Some(Agreement {
                chosen_error: 0.123,
                best: Setting::from(3e-4),
                best_error: 0.12,
                regret: Some(0.025),
                spearman: Some(0.93),
                kendall: Some(0.83),
                top_k: Some(TopK { k: 3, hit: true }),
            }),
            default: Some(Alternative { value: Setting::from(1e-3), regret: Some(0.54) }),
            log_replay: Some(Alternative { value: Setting::from(3e-4), regret: Some(0.0) }),
            notes: vec![],
        }
    }

    fn text(verdict: &Verdict) -> String {
        let mut lines = vec![verdict.headline()];
        lines.extend(verdict.reasons(&Score::nrmse()));
        lines.join("\n")
    }

    #[test]
    fn a_good_verdict() {
        insta::assert_snapshot!(text(&verdict()), @r"
Use learning_rate = 1e-4 for PIT300.
kNN ranks it never below 2nd of 9 values in its 5 members.
It ties with 3e-5 and 3e-4 on worst rank; mean rank, then mean NRMSE, then the order of the grid decided.
On held-out data it is 2.5 % worse than the best value, 3e-4 (NRMSE 0.123 against 0.12).
The default (1e-3) would have cost 54 % against the best value.
Log replay's choice (3e-4) would have been better: it is the best value.
The ranking of all values agrees closely with Online's (Spearman 0.93, Kendall 0.83). The choice is among the 3 best Online.
");
    }

    #[test]
    fn a_verdict_without_online() {
        let verdict = Verdict {
            online: None,
            tie_set: vec![Setting::from(1e-4)],
            worst_rank: 1,
            ..verdict()
        };
        assert_eq!(verdict.grade(), Grade::Unchecked);
        insta::assert_snapshot!(text(&verdict), @r"
Use learning_rate = 1e-4 for PIT300, as far as the logs can tell.
kNN ranks it best of 9 values in all 5 members.
No held-out data was given: regret and agreement with Online are unknown.
");
    }

    #[test]
    fn a_choice_that_diverged() {
        let mut verdict = verdict();
        let online = verdict.online.as_mut().unwrap();
        online.chosen_error = f64::INFINITY;
        online.regret = Some(f64::INFINITY);
        online.spearman = Some(-0.4);
        online.top_k = Some(TopK { k: 3, hit: false });
        verdict.default.as_mut().unwrap().regret = Some(f64::INFINITY);
        assert_eq!(verdict.grade(), Grade::Poor);
        insta::assert_snapshot!(text(&verdict), @r"
Do not deploy learning_rate = 1e-4 for PIT300 on this evidence.
kNN ranks it never below 2nd of 9 values in its 5 members.
It ties with 3e-5 and 3e-4 on worst rank; mean rank, then mean NRMSE, then the order of the grid decided.
On held-out data it diverged; the best value was 3e-4 (NRMSE 0.12).
The default (1e-3) would have diverged.
Log replay's choice (3e-4) would have been better: it is the best value.
The ranking of all values contradicts Online's (Spearman -0.40, Kendall 0.83). The choice is not among the 3 best Online.
");
    }

    #[test]
    fn a_default_outside_the_grid_can_be_best() {
        let mut verdict = verdict();
        let online = verdict.online.as_mut().unwrap();
        online.best = verdict.chosen.clone();
        let reasons = verdict.reasons(&Score::nrmse()).join("\n");
        assert!(
            reasons.contains("the best value of the grid (NRMSE 0.123), yet 2.5 % worse"),
            "{reasons}"
        );
    }

    #[test]
    fn everything_diverged() {
        let mut verdict = verdict();
        let online = verdict.online.as_mut().unwrap();
        online.regret = None;
        online.spearman = None;
        online.top_k = None;
        verdict.default = None;
        verdict.log_replay = Some(Alternative { value: Setting::from(1e-4), regret: None });
        insta::assert_snapshot!(text(&verdict), @r"
Do not deploy learning_rate = 1e-4 for PIT300 on this evidence.
kNN ranks it never below 2nd of 9 values in its 5 members.
It ties with 3e-5 and 3e-4 on worst rank; mean rank, then mean NRMSE, then the order of the grid decided.
On held-out data every value diverged, so there is no best one.
Log replay's choice is the same value.
Agreement with Online's ranking is undefined, because one of the two ranks all values alike.
");
    }

    #[test]
    fn grades_follow_regret() {
        let graded = |regret| {
            let mut verdict = verdict();
            verdict.online.as_mut().unwrap().regret = Some(regret);
            verdict.grade()
        };
        assert_eq!(
            (graded(0.05), graded(0.2), graded(0.21)),
            (Grade::Good, Grade::Fair, Grade::Poor)
        );
    }

    #[test]
    fn ordinals() {
        assert_eq!(
            [1, 2, 3, 4, 11, 12, 13, 21, 112].map(ordinal).join(" "),
            "1st 2nd 3rd 4th 11th 12th 13th 21st 112th"
        );
    }
}
