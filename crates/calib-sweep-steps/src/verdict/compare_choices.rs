//! The choices of models in each deployment, side by side in the terminal.

use calib_base::output::{number, percent, table};

use crate::verdict::judged_model::{JudgedModel, by_deployment};

/// Returns a table of each model's choice, its error Online, and the distance of its rollouts from the recorded log.
/// Without a model it has the choice in each deployment.
pub(crate) fn choices(parts: &[JudgedModel]) -> String {
    let deployments = by_deployment(parts);
    let has_models = parts.iter().any(|part| part.judged.study().has_model());
    let named = parts.iter().any(|part| part.deployment.is_some());
    let mut rows = Vec::new();
    for first in &parts[0].report.verdicts {
        for part in deployments.iter().flatten() {
            let own = part.report.verdicts.iter().find(|verdict| verdict.sensor == first.sensor);
            let Some(verdict) = own else { continue };
            let online = verdict.online.as_ref();
            let distances = part.comparison().map_or(&[][..], |comparison| &comparison.sensors);
            let own = distances.iter().find(|compared| compared.sensor == first.sensor);
            let warping = own.and_then(|compared| {
                let pattern = compared.dtw.first()?;
                Some(pattern.normalized_distance.as_ref().unwrap_or(&pattern.distance).mean)
            });
            let deployment = named.then(|| part.deployment_name().to_owned());
            let model = has_models.then(|| part.model_name().to_owned());
            let chosen = [
                verdict.chosen.to_string(),
                verdict.grade.word().to_owned(),
                or_dash(online.and_then(|online| Some(percent(online.regret?.value)))),
                or_dash(online.and_then(|online| Some(format!("{:.2}", online.spearman?)))),
            ];
            let of_rollouts = [warping.map(number), collapse(part, &first.sensor)];
            let of_rollouts = of_rollouts.map(or_dash).into_iter().filter(|_| has_models);
            let row = [first.sensor.clone()].into_iter().chain(deployment).chain(model);
            rows.push(row.chain(chosen).chain(of_rollouts).collect());
        }
    }
    let of_rollouts = ["DTW", "freezes"].into_iter().filter(|_| has_models);
    let header: Vec<&str> = ["sensor"]
        .into_iter()
        .chain(named.then_some("deployment"))
        .chain(has_models.then_some("model"))
        .chain(["choice", "grade", "regret", "order agrees (at most 1)"])
        .chain(of_rollouts)
        .collect();
    table(&header, &rows)
}

/// Returns how many rollouts freeze, and the median step at which they do.
fn collapse(part: &JudgedModel, sensor: &str) -> Option<String> {
    let collapse = &part.rollouts.as_ref()?.collapse;
    let own = collapse.sensors.iter().find(|known| known.sensor == sensor)?;
    let at = own.median_step.map_or_else(String::new, |step| format!(" at {step:.0}"));
    Some(format!("{} of {}{at}", own.collapsed, collapse.rollouts))
}

fn or_dash(text: Option<String>) -> String {
    text.unwrap_or_else(|| "–".to_owned())
}
