//! The results of a sweep as tidy tables.

use std::{collections::BTreeSet, path::Path};

use calib_agent::{Part, PartScore};
use calib_base::{StepError, artefact::write_table, ensure};
use calib_data::table::Table;
use calib_sweep::{Candidate, ErrorScale, RunRow, UnitResult};
use serde_json::Value;

use crate::sweep::SweepFacts;

/// The files of runs and of learning curves.
pub(crate) const FILES: [&str; 2] = ["runs.parquet", "curves.parquet"];

/// Writes `runs.parquet`, one row per run, and `curves.parquet`, one row per point of a learning curve.
pub(crate) fn write(
    directory: &Path,
    sweep: &SweepFacts,
    results: &[UnitResult],
) -> Result<(), StepError> {
    let candidates = &sweep.candidates;
    let [runs, curves] = FILES.map(|name| directory.join(name));
    write_table(runs_table(sweep, results), &runs)?;
    write_table(curves_table(candidates, results), &curves)
}

fn runs_table(sweep: &SweepFacts, results: &[UnitResult]) -> Table {
    let rows = rows_of(results);
    let table = with_agent_columns(named(&rows), &sweep.candidates, &rows);
    with_errors(table, sweep, sweep.study.part(), &rows)
}

/// Returns the table of runs for agents of other programs. It has labels and the swept values in place of calib's
/// agent fields.
///
/// # Errors
/// Returns an error if a swept field has the name of another column.
pub(crate) fn external_runs(
    sweep: &SweepFacts,
    part: Part,
    results: &[UnitResult],
) -> Result<Table, StepError> {
    let rows = rows_of(results);
    let candidates = &sweep.candidates;
    let of_rows = || rows.iter().map(|(_, row)| &candidates[row.candidate]);
    let mut table = named(&rows)
        .with("label", of_rows().map(Candidate::label).collect())
        .with("is_default", of_rows().map(|candidate| candidate.is_default).collect());
    let fields = candidates.iter().flat_map(|candidate| &candidate.values).map(|(field, _)| field);
    for field in fields.collect::<BTreeSet<_>>() {
        let values: Vec<Option<&Value>> = of_rows()
            .map(|candidate| {
                candidate.values.iter().find_map(|(name, value)| (name == field).then_some(value))
            })
            .collect();
        ensure!(
            !(field == "gamma"
                || MEASURED.contains(&field.as_str())
                || table.values(field).is_some()),
            "a swept value cannot be called `{field}`: runs have a column of that name"
        );
        table = if values.iter().flatten().all(|value| value.is_number()) {
            table.with_optional(
                field,
                values.iter().map(|value| value.and_then(Value::as_f64)).collect(),
            )
        } else {
            let texts = values.iter().map(|value| value.map(calib_sweep::written));
            table.with_optional(field, texts.collect())
        };
    }
    let table = table.with("gamma", gammas(candidates, &rows));
    Ok(with_errors(table, sweep, part, &rows))
}

/// Columns that every table of runs has, with the measurements of each run.
pub(crate) const MEASURED: [&str; 16] = [
    "seed",
    "start_row",
    "steps",
    "updates",
    "diverged",
    "scored_steps",
    "rmse",
    "nrmse",
    "skill",
    "mean_return",
    "return_std",
    "error_scale",
    "rmse_whole_run",
    "rmse_after_first_quarter",
    "rmse_final_quarter",
    "agent",
];

type Row<'a> = (&'a UnitResult, &'a RunRow);

fn rows_of(results: &[UnitResult]) -> Vec<Row<'_>> {
    results.iter().flat_map(|result| result.rows.iter().map(move |row| (result, row))).collect()
}

/// Returns the columns that identify the run of each row.
fn named(rows: &[Row<'_>]) -> Table {
    Table::new()
        .with("environment", rows.iter().map(|(r, _)| r.unit.environment.to_string()).collect())
        .with("sensor", rows.iter().map(|(r, _)| r.unit.sensor.clone()).collect())
        .with("run", rows.iter().map(|(r, _)| r.unit.run as u32).collect())
        .with("candidate", rows.iter().map(|(_, row)| row.candidate as u32).collect())
}

/// Adds the results of each run.
fn with_errors(table: Table, sweep: &SweepFacts, part: Part, rows: &[Row<'_>]) -> Table {
    let candidates = &sweep.candidates;
    let table = table
        .with("seed", rows.iter().map(|(r, _)| r.seed).collect())
        .with("start_row", rows.iter().map(|(r, _)| r.start_row).collect())
        .with("steps", rows.iter().map(|(_, row)| row.steps as u32).collect())
        .with("updates", rows.iter().map(|(_, row)| row.updates).collect())
        .with("diverged", rows.iter().map(|(_, row)| row.diverged_at.is_some()).collect());
    let scale = |(result, row): &Row<'_>| {
        ErrorScale::find(&sweep.scales, &result.unit.sensor, &candidates[row.candidate])
    };
    let scores = |measure: &dyn Fn(&PartScore) -> f64, part| -> Vec<Option<f64>> {
        rows.iter().map(|(_, row)| row.scores.of(part).as_ref().map(measure)).collect()
    };
    let rmse = |part| -> Vec<f64> {
        rows.iter().map(|(_, row)| row.rmse(part).unwrap_or(f64::NAN)).collect()
    };
    let errors = rmse(part);
    let nrmse = errors.iter().zip(rows).map(|(rmse, row)| rmse / scale(row)).collect();
    let skill = errors.iter().zip(rows).map(|(rmse, (_, row))| {
        let std = row.scores.of(part)?.return_std;
        (std > 0.0 && rmse.is_finite()).then(|| 1.0 - rmse / std)
    });
    let steps =
        rows.iter().map(|(_, row)| row.scores.of(part).map_or(0, |score| score.scored_steps));
    let mut table = table
        .with("scored_steps", steps.map(|steps| steps as u32).collect())
        .with("rmse", errors.clone())
        .with("nrmse", nrmse)
        .with_optional("skill", skill.collect())
        .with_optional("mean_return", scores(&|score| score.mean_return, part))
        .with_optional("return_std", scores(&|score| score.return_std, part))
        .with("error_scale", rows.iter().map(scale).collect());
    for (name, part) in PARTS {
        table = table.with(name, rmse(part));
    }
    table
}

/// The error columns for each part of a run, whichever is scored.
const PARTS: [(&str, Part); 3] = [
    ("rmse_whole_run", Part::WholeRun),
    ("rmse_after_first_quarter", Part::AfterFirstQuarter),
    ("rmse_final_quarter", Part::FinalQuarter),
];

/// Adds every field of the agent as a column, with the discount factor of the sensor.
fn with_agent_columns(mut table: Table, candidates: &[Candidate], rows: &[Row<'_>]) -> Table {
    let agents: Vec<_> = candidates.iter().map(|candidate| candidate.agent.fields()).collect();
    let fields: Vec<String> =
        agents.first().map_or_else(Vec::new, |agent| agent.keys().cloned().collect());
    for field in fields {
        if field == "gamma" {
            table = table.with(&field, gammas(candidates, rows));
            continue;
        }
        let values = rows.iter().map(|(_, row)| &agents[row.candidate][&field]);
        table = if agents.iter().all(|agent| agent[&field].is_number()) {
            table.with(&field, values.map(|value| value.as_f64().unwrap_or(f64::NAN)).collect())
        } else {
            let values = values.map(calib_sweep::written);
            table.with(&field, values.collect::<Vec<String>>())
        };
    }
    table
}

/// Returns the discount factor of each row's sensor.
fn gammas(candidates: &[Candidate], rows: &[Row<'_>]) -> Vec<f64> {
    let gammas = rows
        .iter()
        .map(|(result, row)| candidates[row.candidate].agent.gamma_for(&result.unit.sensor));
    gammas.collect()
}

/// Returns a table with one row per point of a learning curve.
pub(crate) fn curves_table(candidates: &[Candidate], results: &[UnitResult]) -> Table {
    let labels: Vec<String> = candidates.iter().map(Candidate::label).collect();
    let mut points = Vec::new();
    for result in results {
        for row in &result.rows {
            points.extend(row.curve.iter().map(|point| (result, row.candidate, *point)));
        }
    }
    Table::new()
        .with("environment", points.iter().map(|(r, ..)| r.unit.environment.to_string()).collect())
        .with("sensor", points.iter().map(|(r, ..)| r.unit.sensor.clone()).collect())
        .with("run", points.iter().map(|(r, ..)| r.unit.run as u32).collect())
        .with("candidate", points.iter().map(|(_, candidate, _)| *candidate as u32).collect())
        .with("label", points.iter().map(|(_, candidate, _)| labels[*candidate].clone()).collect())
        .with("step", points.iter().map(|(.., point)| point.step as u32).collect())
        .with("rmse", points.iter().map(|(.., point)| point.rmse).collect())
}
