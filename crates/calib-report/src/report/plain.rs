//! Meaning of a verdict for the plant, in one or two sentences without statistics.

use calib_core::{number, percent};

use super::sentence::{assigned, chance_of_change, changed};
use super::{ChoiceBaseline, Grade, Separation, Simpler, Verdict};

impl Verdict {
    /// Returns the cost of the choice on held-out data, the cost of changing nothing, and what to do if neither is good enough.
    pub fn plain(&self) -> String {
        if let (Grade::Simpler, Some(simpler)) = (self.grade, &self.simpler) {
            return simpler.plain(self.why_of_log());
        }
        if let (Grade::NotLearnt, Some(why)) = (self.grade, self.why_of_log()) {
            return format!("{} {why}", self.not_learned());
        }
        let Some(online) = &self.online else {
            return "No data was held out, so what it would have cost at the plant is unknown."
                .to_owned();
        };
        if online.stands_still {
            return "It is constant in the held-out period, so there was nothing to predict, and the choice is not checked. Hold out a period in which it changes."
                .to_owned();
        }
        if let Some(spreads) = self.elsewhere.filter(|_| self.grade == Grade::Poor) {
            return format!(
                "Held-out values lie {} times the spread of the training range from its mean, so errors there say nothing of the agent. Did the unit \
                 or the zero of the sensor change? Correct the values, or train on a time that is like the present (data.train).",
                number(spreads)
            );
        }
        if self.grade == Grade::NotLearnt {
            return [self.best_numbers(), Some(self.not_learned())]
                .into_iter()
                .flatten()
                .collect::<Vec<_>>()
                .join(" ");
        }
        if let Some(sentence) = self.learning_off() {
            return format!("{sentence}{}", self.typical_of_predictor());
        }
        let of_choice = match online.regret {
            None => return "On held-out data no setting worked: every one diverged. Add smaller learning rates to sweep.grid.".to_owned(),
            Some(regret) if regret.value.is_infinite() => {
                format!("On held-out data it made the agent diverge; {} did best.", online.best)
            }
            Some(_) if online.values == Separation::Alike => {
                return "On held-out data all settings have the same error, so it cannot show which is better.".to_owned();
            }
            Some(_) if self.simple.is_empty() && online.is_unskilled() => self.without_skill(),
            Some(regret) if regret.value == 0.0 => {
                "On held-out data no other setting of the grid predicts better.".to_owned()
            }
            Some(regret) => format!(
                "On held-out data its predictions are {} worse than those of the best setting{}.",
                percent(regret.value),
                if online.windows > 1 { " of each window" } else { "" },
            ),
        };
        // A choice that equals a simple predictor needs no comparison with it.
        let matched = self.matched.as_ref().filter(|_| self.frozen.is_none() && !self.is_of_log());
        let best = matched.and_then(|_| self.beside_the_best());
        let matched = matched.and_then(Simpler::matched_sentence);
        let sentences = matched.into_iter().chain(best).chain([of_choice]).chain(self.of_default());
        let sentences: Vec<String> = sentences.collect();
        format!("{}{}", sentences.join(" "), self.typical_of_predictor())
    }

    /// Returns the typical error of the recommended simple predictor, if it is known.
    fn typical_of_predictor(&self) -> String {
        let predictor = self.without_learning();
        let own = self.simple.iter().find(|row| Some(row.predictor) == predictor);
        let error = own.and_then(|own| own.typical_error);
        error.map_or_else(String::new, |error| {
            format!(
                " Its typical error of the predicted mean, in the sensor's unit: {}.",
                number(error)
            )
        })
    }

    /// Returns the reason to keep a default that learns nothing after the log, although another setting was chosen.
    fn learning_off(&self) -> Option<String> {
        self.without_learning().filter(|_| !self.learns_nothing)?;
        let default = self.alternative(ChoiceBaseline::Default)?.value.as_ref()?;
        if *default == self.chosen {
            return None;
        }
        let against = self.online.as_ref()?.against_default;
        let difference = against.filter(|against| against.interval.is_some()).map_or_else(
            String::new,
            |against| {
                let change = changed(against.value);
                let chance = chance_of_change(against);
                format!(": it has {change} error than the default{chance}")
            },
        );
        Some(format!(
            "An agent that goes on learning, with {}, is not shown to do better on held-out data{difference}. So keep the default, {}.",
            self.assigned(),
            assigned(&self.field, default)
        ))
    }

    /// Returns the reason why no setting is worth deploying, and what to do about it.
    fn not_learned(&self) -> String {
        if let Some(share) = self.left_training().filter(|_| !self.is_of_log()) {
            return format!(
                "{} of the held-out values lie outside of the training range. Train on a log that has such values, or hold out \
                 data that is like the training range.",
                percent(share)
            );
        }
        if !self.simple.is_empty() {
            let simple = self.simple.iter().map(|row| row.error).filter(|error| error.is_finite());
            let simple = simple.reduce(f64::min).map_or_else(String::new, |error| {
                format!(" The best simple predictor has an NRMSE of {}.", number(error))
            });
            let neither =
                if self.is_of_log() { "On windows of the log neither" } else { "Neither" };
            return format!(
                "{neither} it nor a simple predictor is shown to have at least 2 % less error than the mean return of the training range.{simple} \
                 Deploy that mean, or nothing; or predict less far ahead (a smaller agent.gamma), give the agent more of the past \
                 (agent.traces), or predict another sensor."
            );
        }
        if self.hardly_varies() {
            return "Errors are small beside the spread in training, but so is what happens in the windows, so nothing shows whether anything was learned. Make windows longer (`sweep.steps`), or hold out livelier data."
                .to_owned();
        }
        "On held-out data even this one predicts no better than the mean return. Let agents learn for longer (`sweep.steps`), widen the grid (`sweep.grid`), or try another value function (`agent.value_function`)."
            .to_owned()
    }

    /// Returns the sentence that the choice has no skill, and names the best setting if that has some.
    fn without_skill(&self) -> String {
        let best = self.online.as_ref().and_then(|online| Some((&online.best, online.best_skill?)));
        let best = best
            .filter(|(value, skill)| **value != self.chosen && *skill > 0.0)
            .map_or_else(String::new, |(value, skill)| {
                format!("; the best setting, {value}, has {} less error than that", percent(skill))
            });
        format!("On held-out data it predicts no better than the mean return{best}.")
    }

    fn of_default(&self) -> Option<String> {
        let default = self.alternative(ChoiceBaseline::Default)?;
        let value = default.value.as_ref()?;
        if *value == self.chosen {
            return Some(self.chosen_is_default());
        }
        Some(match default.regret?.value {
            0.0 => format!("Keeping the default, {value}, would have cost nothing."),
            regret if regret.is_finite() => {
                format!("Keeping the default, {value}, would have cost {}.", percent(regret))
            }
            _ => format!("The default, {value}, would have diverged."),
        })
    }
}
