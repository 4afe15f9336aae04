//! `validity.json` and `pairs.parquet`.

use std::path::Path;

use calib_data::table::Table;
use calib_files::write_json;
use calib_validity::{Method, ModelPair, PairRegret, Validity};

use super::{super::artefact::write_table, Judgement};

pub(super) fn write(directory: &Path, judgement: &Judgement) -> anyhow::Result<()> {
    write_table(pairs(judgement), &directory.join("pairs.parquet"))?;
    Ok(write_json(&directory.join("validity.json"), &judgement.summary())?)
}

/// One row for each plant, sensor and method.
fn pairs(judgement: &Judgement) -> Table {
    let Judgement { pairs, validity, .. } = judgement;
    let Validity { each, values, .. } = validity;
    let model = |of: &PairRegret| -> Option<&ModelPair> {
        let Method::Model(name) = &of.method else { return None };
        pairs[of.pair].models.iter().find(|model| model.model == *name)
    };
    let number = |value: fn(&ModelPair) -> Option<f64>| -> Vec<Option<f64>> {
        each.iter().map(|of| model(of).and_then(value)).collect()
    };
    let best =
        |of: &PairRegret| pairs[of.pair].online.iter().copied().fold(f64::INFINITY, f64::min);
    let error = |of: &PairRegret| Some(pairs[of.pair].online[of.value?]);
    let rank = |of: &PairRegret| Some(model(of)?.selection.worst_ranks[of.value?] as u32);
    Table::new()
        .with("plant", each.iter().map(|of| pairs[of.pair].plant.clone()).collect::<Vec<_>>())
        .with("sensor", each.iter().map(|of| pairs[of.pair].sensor.clone()).collect::<Vec<_>>())
        .with("method", each.iter().map(|of| of.method.name()).collect::<Vec<_>>())
        .with_optional("value", each.iter().map(|of| Some(values[of.value?].clone())).collect())
        .with("regret", each.iter().map(|of| of.regret).collect::<Vec<_>>())
        .with_optional("online_error", each.iter().map(error).collect())
        .with("best_online_error", each.iter().map(best).collect::<Vec<_>>())
        .with_optional("worst_rank", each.iter().map(rank).collect())
        .with_optional("spearman", number(|of| of.spearman))
        .with_optional("one_step_rmse", number(|of| of.one_step))
        .with_optional("one_step_relative", number(|of| of.one_step_relative))
        .with_optional("one_step_all_columns", number(|of| of.one_step_all))
        .with_optional("dtw", number(|of| of.dtw))
}
