//! What models chose in each deployment, beside each other in the terminal.

use crate::{
    output::{percent, significant, table},
    verdict::compare::{Part, by_deployment},
};

/// What each model chose, how that did Online, and how far its rollouts are from what was recorded.
pub(crate) fn choices(parts: &[Part]) -> String {
    let deployments = by_deployment(parts);
    let named = parts.iter().any(|part| part.deployment.is_some());
    let mut rows = Vec::new();
    for first in &parts[0].report.verdicts {
        for part in deployments.iter().flatten() {
            let own = part.report.verdicts.iter().find(|of| of.sensor == first.sensor);
            let Some(verdict) = own else { continue };
            let online = verdict.online.as_ref();
            let or_none = |text: Option<String>| text.unwrap_or_else(|| "–".to_owned());
            let distances = part.comparison().map_or(&[][..], |of| &of.sensors);
            let own = distances.iter().find(|of| of.sensor == first.sensor);
            let warping = own.and_then(|of| {
                let pattern = of.dtw.first()?;
                Some(pattern.normalized_distance.as_ref().unwrap_or(&pattern.distance).mean)
            });
            let deployment = named.then(|| part.deployment_name().to_owned());
            let row = [
                part.model_name().to_owned(),
                verdict.chosen.to_string(),
                verdict.grade.word().to_owned(),
            ];
            let numbers = [
                or_none(online.and_then(|online| Some(percent(online.regret?.value)))),
                or_none(online.and_then(|online| Some(format!("{:.2}", online.spearman?)))),
                or_none(warping.map(significant)),
                or_none(collapse(part, &first.sensor)),
            ];
            let row = [first.sensor.clone()].into_iter().chain(deployment).chain(row);
            rows.push(row.chain(numbers).collect());
        }
    }
    let deployment = named.then_some("deployment");
    let header: Vec<&str> = ["sensor"]
        .into_iter()
        .chain(deployment)
        .chain(["model", "choice", "grade", "regret", "Spearman", "DTW", "freezes"])
        .collect();
    table(&header, &rows)
}

/// How many rollouts stop moving, and half of them by which step.
fn collapse(part: &Part, sensor: &str) -> Option<String> {
    let collapse = &part.rollouts.as_ref()?.collapse;
    let own = collapse.sensors.iter().find(|of| of.sensor == sensor)?;
    let at = own.median_step.map_or_else(String::new, |step| format!(" at {step:.0}"));
    Some(format!("{} of {}{at}", own.collapsed, collapse.rollouts))
}
