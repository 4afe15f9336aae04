//! All verdicts in a few sentences.

use calib_core::{number, percent};

use super::sentence::{assigned, listed};
use super::{ChoiceBaseline, Grade, Report, Verdict};

/// Whether several models have verdicts on the same sensor.
pub(crate) fn are_of_several_models(verdicts: &[Verdict]) -> bool {
    verdicts.iter().any(|verdict| {
        verdicts.iter().any(|other| other.sensor == verdict.sensor && other.model != verdict.model)
    })
}

/// Returns what to do for all sensors, its cost, and the costs of the alternatives. With several models, it gives
/// the choice of each: one line per sensor, or one line in all. Empty for a single verdict, which needs no summary.
pub(crate) fn summary(report: &Report) -> Vec<String> {
    if are_of_several_models(&report.verdicts) {
        return choices_of_models(&report.verdicts);
    }
    let verdicts: Vec<&Verdict> = report.verdicts.iter().collect();
    if verdicts.len() < 2 {
        return Vec::new();
    }
    let poor = graded(&verdicts, &[Grade::Poor]);
    let not_learnt = graded(&verdicts, &[Grade::NotLearnt]);
    let mut usable = graded(&verdicts, &[Grade::Good, Grade::Fair, Grade::Unchecked]);
    let arbitrary: Vec<&Verdict> = usable.extract_if(.., |graded| graded.is_arbitrary()).collect();
    let frozen: Vec<&Verdict> =
        usable.extract_if(.., |graded| graded.is_simpler_better()).collect();
    let mut sentences = Vec::new();
    if !usable.is_empty() {
        sentences.push(format!("Use {}.", choices(&usable)));
    }
    if !arbitrary.is_empty() {
        sentences.push(format!(
            "No clear difference for {}: all settings did alike.",
            sensors(&arbitrary)
        ));
    }
    let simpler = graded(&verdicts, &[Grade::Simpler]);
    if simpler.len() + frozen.len() > 0 {
        let each: Vec<String> =
            simpler.iter().chain(&frozen).map(|graded| graded.instead()).collect();
        sentences.push(format!("No agent is needed: use {}.", listed(&each)));
    }
    if !poor.is_empty() {
        sentences.push(format!("Do not deploy {}: held-out data contradicts it.", choices(&poor)));
    }
    if !not_learnt.is_empty() {
        let each: Vec<String> =
            not_learnt.iter().map(|verdict| verdict.sensor_and_error()).collect();
        sentences.push(format!("No setting learns {}.", listed(&each)));
    }
    let online = verdicts.iter().copied().filter(|verdict| verdict.online.is_some());
    // The cost of an agent is irrelevant where the advice is a simple predictor.
    let compared: Vec<&Verdict> =
        online.filter(|verdict| verdict.has_costs() && !verdict.is_simpler_better()).collect();
    if verdicts.iter().all(|verdict| verdict.online.is_none()) {
        sentences.push("No data was held out, so nothing here is checked.".to_owned());
    } else if let Some(costs) = costs(&compared, compared.len() == verdicts.len()) {
        sentences.push(costs);
    }
    vec![sentences.join(" ")]
}

/// Returns the verdicts with one of these grades.
fn graded<'v>(verdicts: &[&'v Verdict], grades: &[Grade]) -> Vec<&'v Verdict> {
    verdicts.iter().copied().filter(|verdict| grades.contains(&verdict.grade)).collect()
}

/// Returns, per sensor, the choice of each model, and the best choice on held-out data. No model is preferred
/// before held-out data shows a difference.
fn choices_of_models(verdicts: &[Verdict]) -> Vec<String> {
    let mut sensors: Vec<&str> = Vec::new();
    for verdict in verdicts {
        if !sensors.contains(&verdict.sensor.as_str()) {
            sensors.push(&verdict.sensor);
        }
    }
    let mut lines: Vec<String> = Vec::new();
    for sensor in sensors {
        let own: Vec<&Verdict> =
            verdicts.iter().filter(|verdict| verdict.sensor == sensor).collect();
        lines.push(agreed(sensor, &own).unwrap_or_else(|| differing(sensor, &own)));
    }
    if verdicts.iter().all(|verdict| verdict.online.is_none()) {
        lines.push(
            "No data was held out, so nothing here shows which of the models to trust.".to_owned(),
        );
    }
    lines
}

/// Returns the common choice of all models, or the sentence that no setting is worth choosing.
fn agreed(sensor: &str, own: &[&Verdict]) -> Option<String> {
    let not_learnt = own.iter().all(|verdict| verdict.grade == Grade::NotLearnt);
    if let (true, Some(share)) =
        (not_learnt, own.iter().find_map(|verdict| verdict.left_training()))
    {
        return Some(format!(
            "{sensor}: no model was ever trained on such values ({} of the held-out ones lie outside of the training range): do not \
             deploy on this evidence.",
            percent(share)
        ));
    }
    if not_learnt && own.iter().all(|verdict| verdict.hardly_varies()) {
        return Some(format!(
            "{sensor} hardly varies in the held-out windows, and no setting predicts it better than their own means would, whichever \
             model chooses: nothing to deploy on this evidence."
        ));
    }
    if not_learnt {
        let error = own.iter().find_map(|verdict| verdict.best_error());
        let error = error.map_or_else(String::new, |error| format!(" (best {error})"));
        return Some(format!(
            "{sensor}: no setting learns it{error}, whichever model chooses: do not deploy on this evidence."
        ));
    }
    let (first, others) = own.split_first()?;
    if !others.iter().all(|verdict| verdict.chosen == first.chosen && verdict.field == first.field)
        || !others.iter().all(|verdict| verdict.grade == first.grade)
    {
        return None;
    }
    if first.is_simpler_better() {
        return Some(format!(
            "{sensor}: no agent is needed, whichever model chooses: use {}.",
            first.instead()
        ));
    }
    let choice = first.assigned();
    let poor = first.grade == Grade::Poor;
    let warning = if poor { " Do not deploy it on this evidence." } else { "" };
    Some(format!("{sensor}: all models choose {choice}{}.{warning}", standing(first)))
}

/// Formats the cost of a choice and its reliability: " (2 % regret, fair)". Without held-out data there is no cost.
fn standing(verdict: &Verdict) -> String {
    let word = verdict.grade.word();
    let Some(regret) = verdict.regret() else {
        let is_lowered = matches!(verdict.grade, Grade::Simpler | Grade::NotLearnt);
        return if is_lowered { format!(" ({word})") } else { String::new() };
    };
    if verdict.has_costs() {
        format!(" ({} regret, {word})", percent(regret))
    } else {
        format!(" ({word})")
    }
}

/// Returns the choice of each model, and the one with the best result on held-out data.
fn differing(sensor: &str, own: &[&Verdict]) -> String {
    let all: Vec<String> = own
        .iter()
        .map(|verdict| {
            format!("{} chooses {}{}", verdict.model, verdict.assigned(), standing(verdict))
        })
        .collect();
    let all = listed(&all);
    let smallest = own.iter().filter_map(|verdict| verdict.regret()).reduce(f64::min);
    let told = own.iter().any(|verdict| verdict.has_costs());
    let Some(smallest) = smallest.filter(|_| told) else { return format!("{sensor}: {all}.") };
    let best = own.iter().filter(|verdict| verdict.regret() == Some(smallest));
    let best: Vec<String> = best.map(|verdict| verdict.model.clone()).collect();
    if best.len() == own.len() {
        format!("{sensor}: {all}. On held-out data these choices are equally good.")
    } else {
        let best = listed(&best);
        format!("{sensor}: {all}. The smallest regret on held-out data is that of {best}.")
    }
}

impl Verdict {
    /// Formats the error of the best setting on held-out data: "NRMSE 1.02".
    fn best_error(&self) -> Option<String> {
        let error = self.online.as_ref()?.best_error;
        error.is_finite().then(|| format!("NRMSE {}", number(error)))
    }

    /// Formats the sensor with its best error: "PIT300 (best NRMSE 1.02)"
    fn sensor_and_error(&self) -> String {
        match self.best_error() {
            Some(error) => format!("{} (best {error})", self.sensor),
            None => self.sensor.clone(),
        }
    }
}

fn sensors(verdicts: &[&Verdict]) -> String {
    listed(&verdicts.iter().map(|verdict| verdict.sensor.clone()).collect::<Vec<_>>())
}

/// Formats the choices: "`learning_rate` = 1e-4 for PIT300 and 3e-5 for TIT101".
fn choices(verdicts: &[&Verdict]) -> String {
    listed(
        &verdicts
            .iter()
            .enumerate()
            .map(|(place, verdict)| {
                let named = place > 0 && verdicts[place - 1].field == verdict.field;
                let all = assigned(&verdict.field, &verdict.chosen);
                let value = if named { verdict.chosen.to_string() } else { all };
                format!("{value} for {}", verdict.sensor)
            })
            .collect::<Vec<_>>(),
    )
}

/// Returns the largest regrets over sensors, of the choices and of the
/// alternatives. Sensors are named unless `are_all`.
fn costs(verdicts: &[&Verdict], are_all: bool) -> Option<String> {
    let chosen = largest(verdicts, Verdict::regret)?;
    let about = if are_all { String::new() } else { format!(" for {}", sensors(verdicts)) };
    let mut text = match chosen {
        0.0 if are_all => "On held-out data these are the best settings of the grid".to_owned(),
        0.0 => format!("On held-out data the choices{about} are the best settings of the grid"),
        regret if regret.is_finite() => {
            format!(
                "On held-out data the choices{about} are at most {} worse than the best settings",
                percent(regret)
            )
        }
        _ => "On held-out data at least one choice diverged".to_owned(),
    };
    let alternatives = [
        ("the default", largest(verdicts, |verdict| verdict.regret_of(ChoiceBaseline::Default))),
        (
            "choosing by log replay",
            largest(verdicts, |verdict| verdict.regret_of(ChoiceBaseline::LogReplay)),
        ),
    ];
    let compared: Vec<String> = alternatives
        .into_iter()
        .filter_map(|(name, regret)| {
            let regret = regret?;
            Some(match regret {
                regret if regret.is_infinite() => format!("{name} would have diverged"),
                regret => format!("{name} would have cost up to {}", percent(regret)),
            })
        })
        .collect();
    if !compared.is_empty() {
        text.push_str("; ");
        text.push_str(&listed(&compared));
    }
    text.push('.');
    Some(text)
}

/// Returns the largest of these regrets over sensors, as far as they are known.
fn largest(verdicts: &[&Verdict], regret: fn(&Verdict) -> Option<f64>) -> Option<f64> {
    verdicts.iter().filter_map(|verdict| regret(verdict)).reduce(f64::max)
}

#[cfg(test)]
mod tests {
    use calib_agent::SimplePredictor;

    use super::super::{HeldOutResult, Separation, sentence::tests::verdict};
    use super::*;

    fn of_model(model: &str, change: impl Fn(&mut Verdict, &mut HeldOutResult)) -> Verdict {
        let mut verdict = Verdict { model: model.to_owned(), ..verdict() };
        let mut online = verdict.online.take().unwrap();
        change(&mut verdict, &mut online);
        Verdict { online: Some(online), ..verdict }
    }

    #[test]
    fn what_no_model_learns_is_not_recommended() {
        fn not_learnt(verdict: &mut Verdict, online: &mut HeldOutResult) {
            verdict.grade = Grade::NotLearnt;
            online.chosen_skill = Some(-0.1);
            online.best_error = 0.9;
        }

        let own = [of_model("a", not_learnt), of_model("b", not_learnt)];
        assert_eq!(
            choices_of_models(&own),
            [
                "PIT300: no setting learns it (best NRMSE 0.9), whichever model chooses: do not deploy on this evidence."
            ]
        );
    }

    #[test]
    fn a_sensor_that_left_its_training_range_does_not_hardly_vary() {
        fn elsewhere(verdict: &mut Verdict, online: &mut HeldOutResult) {
            verdict.grade = Grade::NotLearnt;
            verdict.outside_training = Some(0.93);
            online.best_error = 0.2;
        }

        let verdict = of_model("a", elsewhere);
        assert!(verdict.headline().contains("never trained on such values"), "{verdict:?}");
        assert!(
            verdict.plain().contains("NRMSE of 0.2") && verdict.plain().contains("93 % of the")
        );
        let told = choices_of_models(&[verdict, of_model("b", elsewhere)]);
        assert!(told[0].contains("ever trained on such values (93 %"), "{told:?}");
    }

    #[test]
    fn what_hardly_varies_is_told_from_what_is_not_learnt() {
        fn quiet(verdict: &mut Verdict, online: &mut HeldOutResult) {
            verdict.grade = Grade::NotLearnt;
            online.best_error = 0.2;
        }

        let told = choices_of_models(&[of_model("a", quiet), of_model("b", quiet)]);
        assert!(told[0].starts_with("PIT300 hardly varies in the held-out windows"), "{told:?}");
    }

    #[test]
    fn models_whose_agents_need_not_learn_on_agree_that_none_is_needed() {
        fn frozen(verdict: &mut Verdict, _: &mut HeldOutResult) {
            verdict.frozen = Some(SimplePredictor::Ridge);
        }

        assert_eq!(
            choices_of_models(&[of_model("a", frozen), of_model("b", frozen)]),
            [
                "PIT300: no agent is needed, whichever model chooses: use ridge regression for PIT300."
            ]
        );
    }

    #[test]
    fn choices_stand_beside_how_far_they_can_be_relied_on() {
        fn good(_: &mut Verdict, _: &mut HeldOutResult) {}

        fn unskilled(verdict: &mut Verdict, online: &mut HeldOutResult) {
            verdict.grade = Grade::Poor;
            online.chosen_skill = Some(-0.1);
        }

        fn alike(verdict: &mut Verdict, online: &mut HeldOutResult) {
            verdict.grade = Grade::Unchecked;
            online.values = Separation::Alike;
        }

        let own = [of_model("a", good), of_model("b", good)];
        assert_eq!(
            choices_of_models(&own),
            ["PIT300: all models choose learning_rate = 1e-4 (2.5 % regret, good)."]
        );
        let own = [of_model("a", unskilled), of_model("b", unskilled)];
        assert_eq!(
            choices_of_models(&own),
            [
                "PIT300: all models choose learning_rate = 1e-4 (2.5 % regret, poor). Do not deploy it on this evidence."
            ]
        );
        let own = [of_model("a", good), of_model("b", unskilled)];
        let told = choices_of_models(&own);
        assert!(told[0].contains("(2.5 % regret, good) and b chooses"), "{told:?}");
        let own = [of_model("a", alike), of_model("b", alike)];
        assert_eq!(
            choices_of_models(&own),
            ["PIT300: all models choose learning_rate = 1e-4 (not checked)."]
        );
    }
}
