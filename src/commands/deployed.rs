//! What to deploy where a study has several deployments: a choice for each, and one for all of them.

use calib_report::{Cell, Table};
use calib_stats::{Direction, regret};
use calib_sweep::SensorVerdict;
use serde::Serialize;

use super::{
    compare::{Part, by_deployment},
    report,
};
use crate::output::{Printer, percent, table};

/// What one model says of one sensor in all deployments; in `summary.json`.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Deployed {
    pub(super) sensor: String,
    pub(super) model: String,
    /// The choice for each deployment, in the order of time.
    pub(super) choices: Vec<Choice>,
    /// The value whose worst rank over the members of all deployments is smallest; then the mean rank decides, then
    /// the order of the grid.
    pub(super) for_all: String,
    /// What it costs in each deployment.
    pub(super) regrets: Vec<Option<f64>>,
}

/// The choice for one deployment.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Choice {
    pub(super) deployment: String,
    /// The value.
    pub(super) chosen: String,
    /// What it costs Online.
    pub(super) regret: Option<f64>,
}

impl Deployed {
    /// Whether deployments want different values.
    fn disagrees(&self) -> bool {
        self.choices.iter().any(|choice| choice.chosen != self.choices[0].chosen)
    }
}

/// Sensor by sensor and model by model; nothing where there are no several deployments.
pub(super) fn all(parts: &[Part]) -> anyhow::Result<Vec<Deployed>> {
    let deployments = by_deployment(parts);
    if deployments.len() < 2 {
        return Ok(Vec::new());
    }
    let mut rows = Vec::new();
    for sensor in &parts[0].judged.study.sweep.sensors {
        for model in &deployments[0] {
            let own = deployments.iter().flatten().copied();
            let own: Vec<&Part> =
                own.filter(|part| part.model_name() == model.model_name()).collect();
            rows.extend(of_sensor(sensor, &own)?);
        }
    }
    Ok(rows)
}

fn of_sensor(sensor: &str, parts: &[&Part]) -> anyhow::Result<Option<Deployed>> {
    let verdict = |part: &&'_ Part| {
        let verdicts = part.judged.summary.verdicts.iter();
        verdicts.into_iter().position(|verdict| verdict.sensor == sensor)
    };
    let Some(verdicts) = parts
        .iter()
        .map(|part| Some(&part.judged.summary.verdicts[verdict(part)?]))
        .collect::<Option<Vec<&SensorVerdict>>>()
    else {
        return Ok(None);
    };
    let label =
        |index: usize| report::setting(&parts[0].judged.manifest.candidates[index]).to_string();
    let choices = parts.iter().zip(&verdicts).map(|(part, verdict)| Choice {
        deployment: part.deployment_name().to_owned(),
        chosen: label(verdict.selection.chosen),
        regret: verdict.model_agreement.as_ref().and_then(|agreement| agreement.regret),
    });
    let ranks: Vec<(&[usize], &[f64])> = verdicts
        .iter()
        .map(|of| (of.selection.worst_ranks.as_slice(), of.selection.mean_ranks.as_slice()))
        .collect();
    let for_all = best_of_all(&ranks);
    let regrets = verdicts.iter().map(|verdict| {
        let Some(online) = &verdict.online else { return Ok(None) };
        let errors: Vec<f64> = online.candidates.iter().map(|summary| summary.mean).collect();
        Ok(regret(&errors, for_all, Direction::LowerIsBetter)?)
    });
    Ok(Some(Deployed {
        sensor: sensor.to_owned(),
        model: parts[0].model_name().to_owned(),
        choices: choices.collect(),
        for_all: label(for_all),
        regrets: regrets.collect::<anyhow::Result<_>>()?,
    }))
}

/// The value with the smallest worst rank over all deployments, each with worst and mean ranks over its members.
fn best_of_all(deployments: &[(&[usize], &[f64])]) -> usize {
    let values = deployments.first().map_or(0, |(worst, _)| worst.len());
    let key = |value: usize| {
        let worst = deployments.iter().map(|(worst, _)| worst[value]).max().unwrap_or(0);
        (worst, deployments.iter().map(|(_, mean)| mean[value]).sum::<f64>())
    };
    let smaller = |a: &usize, b: &usize| {
        let ((worst, mean), (other_worst, other_mean)) = (key(*a), key(*b));
        worst.cmp(&other_worst).then(mean.total_cmp(&other_mean))
    };
    (0..values).min_by(smaller).unwrap_or(0)
}

/// "1e-4 (2.3 %)": a value and what it costs.
fn with_cost(value: &str, regret: Option<f64>) -> String {
    regret.map_or_else(|| value.to_owned(), |regret| format!("{value} ({})", percent(regret)))
}

/// The largest cost, if all are known.
fn largest(regrets: &[Option<f64>]) -> Option<f64> {
    let all: Option<Vec<f64>> = regrets.iter().copied().collect();
    all?.into_iter().reduce(f64::max)
}

fn header(rows: &[Deployed]) -> Vec<String> {
    let deployments = rows[0].choices.iter().map(|choice| choice.deployment.clone());
    let leading = ["sensor", "model"].map(str::to_owned);
    leading.into_iter().chain(deployments).chain(["for all".to_owned()]).collect()
}

fn row(of: &Deployed) -> Vec<String> {
    let choices = of.choices.iter().map(|choice| with_cost(&choice.chosen, choice.regret));
    let worst = largest(&of.regrets).map_or_else(
        || of.for_all.clone(),
        |regret| format!("{} (at most {})", of.for_all, percent(regret)),
    );
    [of.sensor.clone(), of.model.clone()].into_iter().chain(choices).chain([worst]).collect()
}

/// Print the choices side by side; nothing where there are no several deployments.
pub(super) fn show(rows: &[Deployed], printer: &Printer) -> anyhow::Result<()> {
    if rows.is_empty() {
        return Ok(());
    }
    let disagree = rows.iter().filter(|of| of.disagrees()).count();
    printer.result("")?;
    printer.result(&match disagree {
        0 => "what to deploy (regret Online): every choice is the same for all deployments"
            .to_owned(),
        _ => "what to deploy (regret Online): choices differ between deployments".to_owned(),
    })?;
    let header = header(rows);
    let header: Vec<&str> = header.iter().map(String::as_str).collect();
    printer.result(&table(&header, &rows.iter().map(row).collect::<Vec<_>>()))
}

/// The same for the report.
pub(super) fn report_table(rows: &[Deployed]) -> Option<Table> {
    rows.first()?;
    let cells = |of: &Deployed| row(of).into_iter().map(Cell::Text).collect();
    Some(Table {
        title: "What to deploy".to_owned(),
        caption: "The choice for each deployment, with its regret Online in brackets. One value for all is that with \
            the smallest worst rank over the members of all deployments (then the mean rank decides); beside it is \
            the largest of its regrets."
            .to_owned(),
        columns: header(rows),
        rows: rows.iter().map(cells).collect(),
        best: None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_value_for_all_is_bad_in_none() {
        // The best of the first is the worst of the second, and the other way round.
        let first: (&[usize], &[f64]) = (&[1, 2, 3], &[1.0, 2.0, 3.0]);
        let second: (&[usize], &[f64]) = (&[3, 2, 1], &[3.0, 2.0, 1.0]);
        assert_eq!(best_of_all(&[first, second]), 1);
        // Worst ranks tie: the mean rank decides, then the order.
        let tied: (&[usize], &[f64]) = (&[3, 3, 3], &[2.5, 1.5, 2.0]);
        assert_eq!(best_of_all(&[tied]), 1);
        let equal: (&[usize], &[f64]) = (&[2, 2], &[1.5, 1.5]);
        assert_eq!(best_of_all(&[equal]), 0);
    }

    #[test]
    fn costs_stand_beside_values() {
        let choice = |deployment: &str, chosen: &str, regret| Choice {
            deployment: deployment.to_owned(),
            chosen: chosen.to_owned(),
            regret,
        };
        let of = Deployed {
            sensor: "PIT300".to_owned(),
            model: "year".to_owned(),
            choices: vec![choice("april", "1e-4", Some(0.0)), choice("july", "1e-3", None)],
            for_all: "1e-4".to_owned(),
            regrets: vec![Some(0.0), Some(0.25)],
        };
        assert!(of.disagrees());
        assert_eq!(row(&of), ["PIT300", "year", "1e-4 (0 %)", "1e-3", "1e-4 (at most 25 %)"]);
        assert_eq!(header(&[of]), ["sensor", "model", "april", "july", "for all"]);
    }
}
