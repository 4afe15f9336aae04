//! A sweep's results as tidy tables.

use std::path::Path;

use calib_agent::{Part, PartScore};
use calib_data::table::Table;
use calib_sweep::{Candidate, ErrorScale, RunRow, UnitResult};

use crate::{base::artefact::write_table, sweep::SweepManifest};

/// Where runs and learning curves are written.
pub(crate) const FILES: [&str; 2] = ["runs.parquet", "curves.parquet"];

/// `runs.parquet`, one row a run, and `curves.parquet`, one row a point of a learning curve.
pub(crate) fn write(
    directory: &Path,
    sweep: &SweepManifest,
    results: &[UnitResult],
) -> anyhow::Result<()> {
    let candidates = &sweep.candidates;
    let [runs, curves] = FILES.map(|name| directory.join(name));
    write_table(runs_table(sweep, results), &runs)?;
    write_table(curves_table(candidates, results), &curves)
}

fn runs_table(sweep: &SweepManifest, results: &[UnitResult]) -> Table {
    let SweepManifest { candidates, study, .. } = sweep;
    let part = study.part();
    let rows: Vec<_> = results
        .iter()
        .flat_map(|result| result.rows.iter().map(move |row| (result, row)))
        .collect();
    let mut table = Table::new()
        .with("environment", rows.iter().map(|(r, _)| r.unit.environment.to_string()).collect())
        .with("sensor", rows.iter().map(|(r, _)| r.unit.sensor.clone()).collect())
        .with("run", rows.iter().map(|(r, _)| r.unit.run as u32).collect())
        .with("candidate", rows.iter().map(|(_, row)| row.candidate as u32).collect());
    table = with_agent_columns(table, candidates, &rows.iter().map(|(_, row)| row.candidate));
    let table = table
        .with("seed", rows.iter().map(|(r, _)| r.seed).collect())
        .with("start_row", rows.iter().map(|(r, _)| r.start_row).collect())
        .with("steps", rows.iter().map(|(_, row)| row.steps as u32).collect())
        .with("updates", rows.iter().map(|(_, row)| row.updates).collect())
        .with("diverged", rows.iter().map(|(_, row)| row.diverged_at.is_some()).collect());
    let scale = |(result, row): &(&UnitResult, &RunRow)| {
        ErrorScale::find(&sweep.scales, &result.unit.sensor, &candidates[row.candidate])
    };
    let scores = |of: &dyn Fn(&PartScore) -> f64, part| -> Vec<Option<f64>> {
        rows.iter().map(|(_, row)| row.scores.of(part).as_ref().map(of)).collect()
    };
    let rmse = |part| -> Vec<f64> {
        rows.iter().map(|(_, row)| row.rmse(part).unwrap_or(f64::NAN)).collect()
    };
    let errors = rmse(part);
    let nrmse = errors.iter().zip(&rows).map(|(rmse, of)| rmse / scale(of)).collect();
    let skill = errors.iter().zip(&rows).map(|(rmse, (_, row))| {
        let std = row.scores.of(part)?.return_std;
        (std > 0.0 && rmse.is_finite()).then(|| 1.0 - rmse / std)
    });
    let steps = rows.iter().map(|(_, row)| row.scores.of(part).map_or(0, |of| of.scored_steps));
    let mut table = table
        .with("scored_steps", steps.map(|steps| steps as u32).collect())
        .with("rmse", errors.clone())
        .with("nrmse", nrmse)
        .with_optional("skill", skill.collect())
        .with_optional("mean_return", scores(&|of| of.mean_return, part))
        .with_optional("return_std", scores(&|of| of.return_std, part))
        .with("error_scale", rows.iter().map(scale).collect());
    for (name, part) in PARTS {
        table = table.with(name, rmse(part));
    }
    table
}

/// The error of each part of a run, whichever is scored.
const PARTS: [(&str, Part); 3] = [
    ("rmse_whole_run", Part::WholeRun),
    ("rmse_after_first_quarter", Part::AfterFirstQuarter),
    ("rmse_final_quarter", Part::FinalQuarter),
];

/// Every field of the agent as a column of its own.
fn with_agent_columns(
    mut table: Table,
    candidates: &[Candidate],
    rows: &(impl Iterator<Item = usize> + Clone),
) -> Table {
    let agents: Vec<_> = candidates.iter().map(|candidate| candidate.agent.fields()).collect();
    let fields: Vec<String> =
        agents.first().map_or_else(Vec::new, |agent| agent.keys().cloned().collect());
    for field in fields {
        let of = |candidate: usize| &agents[candidate][&field];
        table = if agents.iter().all(|agent| agent[&field].is_number()) {
            let values = rows.clone().map(|row| of(row).as_f64().unwrap_or(f64::NAN));
            table.with(&field, values.collect())
        } else {
            let values = rows.clone().map(|row| calib_sweep::written(of(row)));
            table.with(&field, values.collect::<Vec<String>>())
        };
    }
    table
}

fn curves_table(candidates: &[Candidate], results: &[UnitResult]) -> Table {
    let mut points = Vec::new();
    for result in results {
        for row in &result.rows {
            points.extend(row.curve.iter().map(|point| (result, row.candidate, *point)));
        }
    }
    let label = |candidate: usize| candidates[candidate].label();
    Table::new()
        .with("environment", points.iter().map(|(r, ..)| r.unit.environment.to_string()).collect())
        .with("sensor", points.iter().map(|(r, ..)| r.unit.sensor.clone()).collect())
        .with("run", points.iter().map(|(r, ..)| r.unit.run as u32).collect())
        .with("candidate", points.iter().map(|(_, candidate, _)| *candidate as u32).collect())
        .with("label", points.iter().map(|(_, candidate, _)| label(*candidate)).collect())
        .with("step", points.iter().map(|(.., point)| point.step as u32).collect())
        .with("rmse", points.iter().map(|(.., point)| point.rmse).collect())
}
