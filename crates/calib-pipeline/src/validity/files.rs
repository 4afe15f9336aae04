//! `validity.json` and `pairs.parquet`.

use std::path::Path;

use calib_base::{StepError, artefact::write_table};
use calib_data::table::Table;
use calib_files::write_json;
use calib_validity::{Method, ModelPair, Pair, PairRegret};

use super::{JudgedStudies, Task, show::part_name};

pub(super) fn write(directory: &Path, judged: &JudgedStudies) -> Result<(), StepError> {
    write_table(pairs(judged), &directory.join("pairs.parquet"))?;
    Ok(write_json(&directory.join("validity.json"), &judged.summary())?)
}

/// A method in a pair, by one score.
struct Row<'a> {
    part: &'static str,
    task: &'a Task,
    pair: &'a Pair,
    of: &'a PairRegret,
    values: &'a [String],
}

impl Row<'_> {
    /// The model, where the method is one.
    fn model(&self) -> Option<&ModelPair> {
        let Method::Model(name) = &self.of.method else { return None };
        self.pair.models.iter().find(|model| model.model == *name)
    }
}

/// One row for each score, plant, sensor and method.
fn pairs(judged: &JudgedStudies) -> Table {
    let rows = judged.scores.iter().flat_map(|score| {
        score.validity.each.iter().filter_map(|of| {
            let pair = &score.validity.judged[of.pair];
            let plant = judged.plants.iter().find(|plant| plant.plant == pair.plant)?;
            let (part, values) = (part_name(score.part), &*score.validity.values);
            Some(Row { part, task: &plant.task, pair, of, values })
        })
    });
    let rows: Vec<Row<'_>> = rows.collect();
    let text = |of: fn(&Row<'_>) -> String| rows.iter().map(of).collect::<Vec<String>>();
    let of_model = |value: fn(&ModelPair) -> Option<f64>| -> Vec<Option<f64>> {
        rows.iter().map(|row| row.model().and_then(value)).collect()
    };
    let best = |row: &Row<'_>| row.pair.online.iter().copied().fold(f64::INFINITY, f64::min);
    let error = |row: &Row<'_>| Some(row.pair.online[row.of.value?]);
    let label = |row: &Row<'_>| Some(row.values[row.of.value?].clone());
    Table::new()
        .with("scored", text(|row| row.part.to_owned()))
        .with("plant", text(|row| row.pair.plant.clone()))
        .with("sensor", text(|row| row.pair.sensor.clone()))
        .with("method", text(|row| row.of.method.name()))
        .with("optimiser", text(|row| row.task.optimiser.to_owned()))
        .with("agent", text(|row| row.task.agent.clone()))
        .with("gamma", rows.iter().map(|row| row.task.gamma).collect::<Vec<_>>())
        .with("steps", rows.iter().map(|row| row.task.steps as u32).collect::<Vec<_>>())
        .with("batch_size", rows.iter().map(|row| row.task.batch_size as u32).collect::<Vec<_>>())
        .with_optional("candidate", rows.iter().map(|row| Some(row.of.value? as u32)).collect())
        .with_optional("value", rows.iter().map(label).collect())
        .with("regret", rows.iter().map(|row| row.of.regret).collect::<Vec<_>>())
        .with_optional("online_error", rows.iter().map(error).collect())
        .with("best_online_error", rows.iter().map(best).collect::<Vec<_>>())
        .with_optional("best_skill", rows.iter().map(|row| row.pair.skill).collect())
        .with_optional("stability", of_model(|of| of.stability))
        .with_optional("spearman", of_model(|of| of.spearman))
        .with_optional("one_step_rmse", of_model(|of| of.one_step))
        .with_optional("one_step_relative", of_model(|of| of.one_step_relative))
        .with_optional("one_step_all_columns", of_model(|of| of.one_step_all))
        .with_optional("dtw", of_model(|of| of.dtw))
}
