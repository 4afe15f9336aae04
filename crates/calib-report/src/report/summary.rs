//! All verdicts in a few sentences.

use super::sentence::listed;
use super::{Grade, Report, Verdict};
use crate::number::percent;

/// The first verdict of each sensor.
pub(crate) fn recommendations(verdicts: &[Verdict]) -> Vec<&Verdict> {
    let is_first = |place: usize| {
        !verdicts[..place].iter().any(|before| before.sensor == verdicts[place].sensor)
    };
    (0..verdicts.len()).filter(|&place| is_first(place)).map(|place| &verdicts[place]).collect()
}

/// What to do for all sensors, what it costs, and what the alternatives would have cost.
/// `None` for fewer than two sensors, where the one verdict says it all.
pub(crate) fn summary(report: &Report) -> Option<String> {
    let verdicts = recommendations(&report.verdicts);
    if verdicts.len() < 2 {
        return None;
    }
    let (poor, usable): (Vec<&Verdict>, Vec<&Verdict>) =
        verdicts.iter().partition(|verdict| verdict.grade() == Grade::Poor);
    let mut sentences = Vec::new();
    if !usable.is_empty() {
        sentences.push(format!("Use {}.", choices(&usable)));
    }
    if !poor.is_empty() {
        sentences.push(format!("Do not deploy {}: held-out data contradicts it.", choices(&poor)));
    }
    let online: Vec<&Verdict> =
        verdicts.into_iter().filter(|verdict| verdict.online.is_some()).collect();
    if online.is_empty() {
        sentences
            .push("No data was held out, so nothing here is checked against Online.".to_owned());
    } else if let Some(costs) = costs(&online) {
        sentences.push(costs);
    }
    Some(sentences.join(" "))
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
    let chosen = largest(|verdict| verdict.online.as_ref().and_then(|online| online.regret))?;
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
        ("the default", largest(|verdict| verdict.default.as_ref().and_then(|other| other.regret))),
        (
            "choosing by log replay",
            largest(|verdict| verdict.log_replay.as_ref().and_then(|other| other.regret)),
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
