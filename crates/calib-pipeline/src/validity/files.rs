//! Writes `validity.json` and `pairs.parquet`.

use std::path::Path;

use calib_base::{StepError, artefact::write_table};
use calib_data::table::Table;
use calib_files::write_json;
use calib_validity::{Method, ModelPair, Pair, PairRegret};

use super::{answer::JudgedStudies, task::Task};

pub(super) fn write(directory: &Path, judged: &JudgedStudies) -> Result<(), StepError> {
    write_table(pairs(judged), &directory.join("pairs.parquet"))?;
    Ok(write_json(&directory.join("validity.json"), &judged.summary())?)
}

/// A method in a pair, by one score.
struct Row<'a> {
    part: &'static str,
    task: &'a Task,
    pair: &'a Pair,
    regret: &'a PairRegret,
    values: &'a [String],
}

impl Row<'_> {
    /// Returns the model, if the method is one.
    fn model(&self) -> Option<&ModelPair> {
        let Method::Model(name) = &self.regret.method else { return None };
        self.pair.models.iter().find(|model| model.model == *name)
    }

    /// Returns the setting that the method chose, if it chose one.
    fn setting(&self) -> Option<String> {
        Some(self.values[self.regret.value?].clone())
    }

    /// Returns the error of the choice on held-out data.
    fn online_error(&self) -> Option<f64> {
        Some(self.pair.online[self.regret.value?])
    }

    /// Returns the smallest error of all settings on held-out data.
    fn best_online_error(&self) -> f64 {
        self.pair.online.iter().copied().fold(f64::INFINITY, f64::min)
    }
}

/// Returns a table with one row per score, plant, sensor and method.
fn pairs(judged: &JudgedStudies) -> Table {
    let rows = judged.scores.iter().flat_map(|score| {
        score.validity.each.iter().filter_map(|regret| {
            let pair = &score.validity.judged[regret.pair];
            let plant = judged.plants.iter().find(|plant| plant.plant == pair.plant)?;
            let part = score.part.name();
            let values = &*score.validity.values;
            Some(Row { part, task: &plant.task, pair, regret, values })
        })
    });
    let rows: Vec<Row<'_>> = rows.collect();
    Table::new()
        .with("scored", texts(&rows, |row| row.part.to_owned()))
        .with("plant", texts(&rows, |row| row.pair.plant.clone()))
        .with("sensor", texts(&rows, |row| row.pair.sensor.clone()))
        .with("method", texts(&rows, |row| row.regret.method.name()))
        .with("optimiser", texts(&rows, |row| row.task.optimiser.to_owned()))
        .with("agent", texts(&rows, |row| row.task.agent.clone()))
        .with("gamma", rows.iter().map(|row| row.task.gamma).collect::<Vec<_>>())
        .with("steps", rows.iter().map(|row| row.task.steps as u32).collect::<Vec<_>>())
        .with("batch_size", rows.iter().map(|row| row.task.batch_size as u32).collect::<Vec<_>>())
        .with_optional("candidate", rows.iter().map(|row| Some(row.regret.value? as u32)).collect())
        .with_optional("value", rows.iter().map(Row::setting).collect())
        .with("regret", rows.iter().map(|row| row.regret.regret).collect::<Vec<_>>())
        .with_optional("online_error", rows.iter().map(Row::online_error).collect())
        .with("best_online_error", rows.iter().map(Row::best_online_error).collect::<Vec<_>>())
        .with_optional("best_skill", rows.iter().map(|row| row.pair.skill).collect())
        .with_optional("stability", of_models(&rows, |model| model.stability))
        .with_optional("spearman", of_models(&rows, |model| model.spearman))
        .with_optional("one_step_rmse", of_models(&rows, |model| model.one_step))
        .with_optional("one_step_relative", of_models(&rows, |model| model.one_step_relative))
        .with_optional("one_step_all_columns", of_models(&rows, |model| model.one_step_all))
        .with_optional("dtw", of_models(&rows, |model| model.dtw))
}

fn texts(rows: &[Row<'_>], cell: fn(&Row<'_>) -> String) -> Vec<String> {
    rows.iter().map(cell).collect()
}

/// Returns a value of the model in each row that has one.
fn of_models(rows: &[Row<'_>], value: fn(&ModelPair) -> Option<f64>) -> Vec<Option<f64>> {
    rows.iter().map(|row| row.model().and_then(value)).collect()
}
