//! What to deploy where a study has several deployments: a choice for each, and one for all of them.

use calib_report::{Cell, Table};
use calib_stats::Selection;
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
    /// The value whose worst rank over the members of all deployments is smallest; then mean rank, mean error and
    /// the order of the grid decide, as for one deployment.
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
pub(super) fn all(parts: &[Part]) -> Vec<Deployed> {
    let deployments = by_deployment(parts);
    if deployments.len() < 2 {
        return Vec::new();
    }
    let mut rows = Vec::new();
    for sensor in &parts[0].judged.study().sweep.sensors {
        for model in &deployments[0] {
            let own = deployments.iter().flatten().copied();
            let own: Vec<&Part> =
                own.filter(|part| part.model_name() == model.model_name()).collect();
            rows.extend(of_sensor(sensor, &own));
        }
    }
    rows
}

fn of_sensor(sensor: &str, parts: &[&Part]) -> Option<Deployed> {
    let verdict = |part: &&'_ Part| {
        let verdicts = part.judged.summary.verdicts.iter();
        verdicts.into_iter().position(|verdict| verdict.sensor == sensor)
    };
    let verdicts = parts
        .iter()
        .map(|part| Some(&part.judged.summary.verdicts[verdict(part)?]))
        .collect::<Option<Vec<&SensorVerdict>>>()?;
    let label =
        |index: usize| report::setting(&parts[0].judged.manifest.candidates[index]).to_string();
    let choices = parts.iter().zip(&verdicts).map(|(part, verdict)| Choice {
        deployment: part.deployment_name().to_owned(),
        chosen: label(verdict.chosen),
        regret: verdict.truth.as_ref().and_then(|truth| Some(truth.choice.regret?.value)),
    });
    let selections: Vec<&Selection> = verdicts.iter().map(|of| &of.selection).collect();
    let for_all = best_of_all(&selections);
    let regrets = verdicts.iter().map(|verdict| {
        verdict.truth.as_ref().and_then(|truth| Some(truth.regrets.as_ref()?[for_all]))
    });
    Some(Deployed {
        sensor: sensor.to_owned(),
        model: parts[0].model_name().to_owned(),
        choices: choices.collect(),
        for_all: label(for_all),
        regrets: regrets.collect(),
    })
}

/// The rule of one deployment over the members of all: the smallest worst rank; ties go to the lower mean rank, then to
/// the lower mean error, then to the earlier value.
fn best_of_all(deployments: &[&Selection]) -> usize {
    let values = deployments.first().map_or(0, |of| of.worst_ranks.len());
    // Sums of whole numbers, so that ties are ties.
    let ranks = |value: usize| {
        deployments.iter().flat_map(move |of| of.ranks.iter().map(move |member| member[value]))
    };
    let key = |value: usize| (ranks(value).max(), ranks(value).sum::<usize>());
    let error = |value: usize| deployments.iter().map(|of| of.mean_errors[value]).sum::<f64>();
    let better = |&a: &usize, &b: &usize| key(a).cmp(&key(b)).then(error(a).total_cmp(&error(b)));
    (0..values).min_by(better).unwrap_or(0)
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
    printer.lines(&table(&header, &rows.iter().map(row).collect::<Vec<_>>()))
}

/// The same for the report.
pub(super) fn report_table(rows: &[Deployed]) -> Option<Table> {
    rows.first()?;
    let cells = |of: &Deployed| row(of).into_iter().map(Cell::Text).collect();
    Some(Table {
        title: "What to deploy".to_owned(),
        caption: "The choice for each deployment, with its regret Online in brackets. One value for all is that with \
            the smallest worst rank over the members of all deployments (then the mean rank decides, then the mean error); beside it is \
            the largest of its regrets."
            .to_owned(),
        columns: header(rows),
        rows: rows.iter().map(cells).collect(),
        best: None,
    })
}

#[cfg(test)]
mod tests {
    use calib_stats::{Direction, select};

    use super::*;

    #[test]
    fn one_value_for_all_is_bad_in_none() {
        let of = |members: &[[f64; 3]]| select(members, Direction::LowerIsBetter).expect("ranked");
        // The best of the first is the worst of the second, and the other way round.
        let (first, second) = (of(&[[0.1, 0.2, 0.3]]), of(&[[0.3, 0.2, 0.1]]));
        assert_eq!(best_of_all(&[&first, &second]), 1);
        // Worst ranks tie: the mean rank decides.
        let members = [[0.1, 0.2, 0.3], [0.3, 0.1, 0.2], [0.3, 0.2, 0.1], [0.2, 0.3, 0.1]];
        assert_eq!(of(&members).worst_ranks, [3, 3, 3]);
        assert_eq!(best_of_all(&[&of(&members)]), 2);
        // Then the mean error, as for one deployment: equal deployments want what each of them wants.
        let tied = of(&[[0.5, 0.2, 0.9], [0.5, 0.9, 0.1]]);
        assert_eq!(tied.mean_ranks, [2.0, 2.0, 2.0]);
        assert_eq!(best_of_all(&[&tied, &tied]), tied.chosen);
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
