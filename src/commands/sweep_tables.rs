//! A sweep's results as tidy tables.

use std::path::Path;

use calib_data::table::Table;
use calib_sweep::{Candidate, UnitResult};

/// `runs.parquet`, one row a run, and `curves.parquet`, one row a point of a learning curve.
pub(super) fn write(
    directory: &Path,
    candidates: &[Candidate],
    results: &[UnitResult],
) -> anyhow::Result<()> {
    runs_table(candidates, results)?.write_parquet(&directory.join("runs.parquet"))?;
    curves_table(candidates, results).write_parquet(&directory.join("curves.parquet"))?;
    Ok(())
}

fn runs_table(candidates: &[Candidate], results: &[UnitResult]) -> anyhow::Result<Table> {
    let rows: Vec<_> = results
        .iter()
        .flat_map(|result| result.rows.iter().map(move |row| (result, row)))
        .collect();
    let mut table = Table::new()
        .with("environment", rows.iter().map(|(r, _)| r.unit.environment.to_string()).collect())
        .with("sensor", rows.iter().map(|(r, _)| r.unit.sensor.clone()).collect())
        .with("run", rows.iter().map(|(r, _)| r.unit.run as u32).collect())
        .with("candidate", rows.iter().map(|(_, row)| row.candidate as u32).collect());
    table = with_agent_columns(table, candidates, &rows.iter().map(|(_, row)| row.candidate))?;
    Ok(table
        .with("seed", rows.iter().map(|(r, _)| r.seed).collect())
        .with("start_row", rows.iter().map(|(r, _)| r.start_row).collect())
        .with("steps", rows.iter().map(|(_, row)| row.steps as u32).collect())
        .with("scored_steps", rows.iter().map(|(_, row)| row.scored_steps as u32).collect())
        .with("updates", rows.iter().map(|(_, row)| row.updates).collect())
        .with("rmse", rows.iter().map(|(_, row)| row.rmse).collect())
        .with("nrmse", rows.iter().map(|(_, row)| row.nrmse).collect())
        .with("rmse_over_std", rows.iter().map(|(_, row)| row.rmse_over_std).collect())
        .with("mean_return", rows.iter().map(|(_, row)| row.mean_return).collect())
        .with("return_std", rows.iter().map(|(_, row)| row.return_std).collect())
        .with("diverged", rows.iter().map(|(_, row)| row.diverged_at.is_some()).collect()))
}

/// Every field of the agent as a column of its own.
fn with_agent_columns(
    mut table: Table,
    candidates: &[Candidate],
    rows: &(impl Iterator<Item = usize> + Clone),
) -> anyhow::Result<Table> {
    let agents: Vec<serde_json::Map<String, serde_json::Value>> = candidates
        .iter()
        .map(|candidate| Ok(serde_json::from_value(serde_json::to_value(&candidate.agent)?)?))
        .collect::<anyhow::Result<_>>()?;
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
    Ok(table)
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
