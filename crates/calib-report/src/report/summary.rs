//! All verdicts in a few sentences.

use super::sentence::listed;
use super::{Grade, Report, Verdict, Way};
use crate::number::percent;

/// Whether there are verdicts of several models on the same sensor.
pub(crate) fn are_of_several_models(verdicts: &[Verdict]) -> bool {
    let has_other = |verdict: &Verdict| {
        verdicts.iter().any(|of| of.sensor == verdict.sensor && of.model != verdict.model)
    };
    verdicts.iter().any(has_other)
}

/// What to do for all sensors, what it costs, and what the alternatives would have cost; what each model says where
/// there are several: a line for each sensor, or one line. None for a single verdict, which says it all.
pub(crate) fn summary(report: &Report) -> Vec<String> {
    if are_of_several_models(&report.verdicts) {
        return choices_of_models(&report.verdicts);
    }
    let verdicts: Vec<&Verdict> = report.verdicts.iter().collect();
    if verdicts.len() < 2 {
        return Vec::new();
    }
    let of = |grades: &[Grade]| -> Vec<&Verdict> {
        verdicts.iter().copied().filter(|verdict| grades.contains(&verdict.grade)).collect()
    };
    let (poor, not_learnt) = (of(&[Grade::Poor]), of(&[Grade::NotLearnt]));
    let usable = of(&[Grade::Good, Grade::Fair, Grade::Unchecked]);
    let mut sentences = Vec::new();
    if !usable.is_empty() {
        sentences.push(format!("Use {}.", choices(&usable)));
    }
    if !poor.is_empty() {
        sentences.push(format!("Do not deploy {}: held-out data contradicts it.", choices(&poor)));
    }
    if !not_learnt.is_empty() {
        let sensors: Vec<String> = not_learnt.iter().map(|of| of.sensor.clone()).collect();
        sentences.push(format!("No value learns {}.", listed(&sensors)));
    }
    let online: Vec<&Verdict> =
        verdicts.into_iter().filter(|verdict| verdict.online.is_some()).collect();
    if online.is_empty() {
        sentences
            .push("No data was held out, so nothing here is checked against Online.".to_owned());
    } else if let Some(costs) = costs(&online) {
        sentences.push(costs);
    }
    vec![sentences.join(" ")]
}

/// Sensor by sensor what each model chooses, and whose choice is best on held-out data. No model is preferred to
/// another before such data tells them apart.
fn choices_of_models(verdicts: &[Verdict]) -> Vec<String> {
    let mut sensors: Vec<&str> = Vec::new();
    for verdict in verdicts {
        if !sensors.contains(&verdict.sensor.as_str()) {
            sensors.push(&verdict.sensor);
        }
    }
    let mut lines: Vec<String> = Vec::new();
    for sensor in sensors {
        let own: Vec<&Verdict> = verdicts.iter().filter(|of| of.sensor == sensor).collect();
        lines.push(agreed(sensor, &own).unwrap_or_else(|| differing(sensor, &own)));
    }
    if verdicts.iter().all(|verdict| regret(verdict).is_none()) {
        lines.push(
            "No data was held out, so nothing here says which of the models to trust.".to_owned(),
        );
    }
    lines
}

/// What all models choose, if it is the same.
fn agreed(sensor: &str, own: &[&Verdict]) -> Option<String> {
    let (first, others) = own.split_first()?;
    let same = |of: &&Verdict| of.chosen == first.chosen && of.field == first.field;
    let Verdict { field, chosen, .. } = first;
    let cost = regret(first).map_or_else(String::new, |cost| format!(": {} regret", percent(cost)));
    others
        .iter()
        .all(same)
        .then(|| format!("{sensor}: all models choose {field} = {chosen}{cost}."))
}

/// What each model chooses, and which choice held-out data likes best.
fn differing(sensor: &str, own: &[&Verdict]) -> String {
    let choice = |verdict: &&Verdict| {
        let Verdict { model, field, chosen, .. } = verdict;
        let cost = regret(verdict)
            .map_or_else(String::new, |regret| format!(" ({} regret)", percent(regret)));
        format!("{model} chooses {field} = {chosen}{cost}")
    };
    let all: Vec<String> = own.iter().map(choice).collect();
    let all = listed(&all);
    let smallest = own.iter().filter_map(|verdict| regret(verdict)).reduce(f64::min);
    let Some(smallest) = smallest else { return format!("{sensor}: {all}.") };
    let best = own.iter().filter(|verdict| regret(verdict) == Some(smallest));
    let best: Vec<String> = best.map(|verdict| verdict.model.clone()).collect();
    if best.len() == own.len() {
        format!("{sensor}: {all}. On held-out data these choices are equally good.")
    } else {
        let best = listed(&best);
        format!("{sensor}: {all}. The smallest regret on held-out data is that of {best}.")
    }
}

fn regret(verdict: &Verdict) -> Option<f64> {
    verdict.regret()
}

/// "`learning_rate` = 1e-4 for PIT300 and 3e-5 for TIT101".
fn choices(verdicts: &[&Verdict]) -> String {
    let choice = |(place, verdict): (usize, &&Verdict)| {
        let named = place > 0 && verdicts[place - 1].field == verdict.field;
        let name = if named { String::new() } else { format!("{} = ", verdict.field) };
        format!("{name}{} for {}", verdict.chosen, verdict.sensor)
    };
    listed(&verdicts.iter().enumerate().map(choice).collect::<Vec<_>>())
}

/// Largest regrets over sensors, of the choices and of the alternatives.
fn costs(verdicts: &[&Verdict]) -> Option<String> {
    let largest = |regret: fn(&Verdict) -> Option<f64>| {
        verdicts.iter().filter_map(|verdict| regret(verdict)).reduce(f64::max)
    };
    let chosen = largest(Verdict::regret)?;
    let mut text = match chosen {
        0.0 => "On held-out data these are the best values of the grid".to_owned(),
        regret if regret.is_finite() => {
            format!(
                "On held-out data the choices are at most {} worse than the best values",
                percent(regret)
            )
        }
        _ => "On held-out data at least one choice diverged".to_owned(),
    };
    let alternatives = [
        ("the default", largest(|verdict| verdict.regret_of(Way::Default))),
        ("choosing by log replay", largest(|verdict| verdict.regret_of(Way::LogReplay))),
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
