//! What a verdict means for the plant, in one or two sentences without statistics.

use super::Verdict;
use crate::number::percent;

impl Verdict {
    /// What the choice would have cost on data that nobody had seen, and what changing nothing would have cost.
    pub fn plain(&self) -> String {
        let Some(online) = &self.online else {
            return "No data was held out, so what it would have cost in the plant is unknown."
                .to_owned();
        };
        let of_choice = match online.regret {
            None => return "On held-out data no value worked: every one diverged.".to_owned(),
            Some(0.0) => "On held-out data no other value of the grid predicts better.".to_owned(),
            Some(regret) if regret.is_finite() => format!(
                "On held-out data its predictions are {} worse than those of the best value, {}.",
                percent(regret),
                online.best
            ),
            Some(_) => "On held-out data it made the agent diverge.".to_owned(),
        };
        let of_default = self.default.as_ref().and_then(|default| {
            let value = &default.value;
            if *value == self.chosen {
                return Some("It is the default already.".to_owned());
            }
            match default.regret? {
                0.0 => Some(format!("Keeping the default, {value}, would have cost nothing.")),
                regret if regret.is_finite() => Some(format!(
                    "Keeping the default, {value}, would have cost {}.",
                    percent(regret)
                )),
                _ => Some(format!("The default, {value}, would have diverged.")),
            }
        });
        [of_choice].into_iter().chain(of_default).collect::<Vec<_>>().join(" ")
    }
}

#[cfg(test)]
mod tests {
    use crate::{Agreement, Alternative, Setting, Verdict};

    fn verdict(regret: Option<f64>, default: (f64, f64)) -> Verdict {
        Verdict {
            sensor: "PIT300".to_owned(),
            field: "learning_rate".to_owned(),
            model: "kNN".to_owned(),
            chosen: Setting::from(1e-4),
            tie_set: vec![],
            worst_rank: 2,
            values: 9,
            members: 5,
            online: Some(Agreement {
                chosen_error: 0.1,
                best: Setting::from(3e-4),
                best_error: 0.1,
                regret,
                spearman: None,
                kendall: None,
                top_k: None,
            }),
            default: Some(Alternative { value: Setting::from(default.0), regret: Some(default.1) }),
            log_replay: None,
            notes: vec![],
        }
    }

    #[test]
    fn costs_are_told_without_statistics() {
        let infinite = f64::INFINITY;
        let cases = [
            (
                Some(0.061),
                (1e-3, 0.21),
                "6.1 % worse than those of the best value, 3e-4. Keeping the default, 1e-3, would have cost 21 %.",
            ),
            (
                Some(0.0),
                (1e-4, 0.0),
                "no other value of the grid predicts better. It is the default already.",
            ),
            (
                Some(infinite),
                (1e-3, infinite),
                "it made the agent diverge. The default, 1e-3, would have diverged.",
            ),
            (None, (1e-3, infinite), "no value worked: every one diverged."),
            (Some(0.1), (1e-3, 0.0), "Keeping the default, 1e-3, would have cost nothing."),
        ];
        for (regret, default, expected) in cases {
            let plain = verdict(regret, default).plain();
            assert!(plain.ends_with(expected), "{plain}");
        }
        let unchecked = Verdict { online: None, ..verdict(None, (1e-3, 0.0)) };
        assert!(unchecked.plain().ends_with("is unknown."));
    }
}
