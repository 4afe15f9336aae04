//! How well a model predicts the next state on held-out data.

use anyhow::Context as _;
use calib_core::{Frames, Monitor, RowIndex, States, TransitionIndex, Transitions};
use calib_data::TimeRange;
use calib_dynamics::predict;
use calib_files::{Fingerprint, read_json, write_json};
use calib_report::{Best, Cell, Table};
use calib_stats::{Direction, StepErrors};
use serde::{Deserialize, Serialize};

use super::{
    artefact::{self, TOOL},
    model::{Model, search_place},
    model_files::OpenModel,
};
use crate::{
    output::{Printer, count, significant, table},
    study::{Study, StudyPaths},
};

/// Transitions that are predicted at most, evenly spaced over the held-out range: more would hardly change the error.
const MOST_TRANSITIONS: usize = 4000;

/// Its file, in the directory of rollouts.
const FILE: &str = "one_step.json";

const FORMAT: u32 = 2;

/// `one_step.json`: errors of predictions one step ahead, of all members taken together.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct OneStep {
    pub(super) format: u32,
    pub(super) tool: String,
    pub(super) key: String,
    /// The model's key.
    pub(super) model: String,
    /// The held-out range as the study has it.
    pub(super) window: Option<TimeRange>,
    /// Held-out transitions, and how many of them were predicted in each member.
    pub(super) held_out: usize,
    pub(super) transitions: usize,
    pub(super) members: usize,
    /// Over all columns of the states.
    pub(super) all_columns: StepError,
    pub(super) sensors: Vec<SensorError>,
}

/// One sensor.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct SensorError {
    pub(super) sensor: String,
    #[serde(flatten)]
    pub(super) error: StepError,
}

/// Normalised units.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(super) struct StepError {
    /// None if a prediction was not finite.
    pub(super) rmse: Option<f64>,
    /// Of predicting that nothing changes.
    pub(super) no_change_rmse: f64,
    /// One divided by the other; none if nothing ever changes.
    pub(super) relative: Option<f64>,
}

impl StepError {
    fn new((rmse, no_change_rmse): (f64, f64)) -> Self {
        let rmse = Some(rmse).filter(|rmse| rmse.is_finite());
        let relative = rmse.filter(|_| no_change_rmse > 0.0).map(|rmse| rmse / no_change_rmse);
        Self { rmse, no_change_rmse, relative }
    }
}

/// The one-step errors of `model` that are stored, if they are of this model and the held-out range of the study.
pub(super) fn read(study: &Study, paths: &StudyPaths, model: &str) -> Option<OneStep> {
    let stored: OneStep = read_json(&paths.rollout().join(FILE)).ok()?;
    let same = stored.model == model && stored.window == study.data.held_out;
    (stored.format == FORMAT && same).then_some(stored)
}

/// Nothing is known one step ahead.
pub(super) fn remove(paths: &StudyPaths) -> anyhow::Result<()> {
    let path = paths.rollout().join(FILE);
    match std::fs::remove_file(&path) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
            Err(error).with_context(|| format!("cannot remove {}", path.display()))
        }
        _ => Ok(()),
    }
}

/// The one-step errors on `held_out`: those that are stored if they are up to date, else new ones, stored.
/// `None`, with the reason told, where the model cannot predict states that it was not built from.
pub(super) fn ensure(
    (study, paths): (&Study, &StudyPaths),
    model: &OpenModel,
    (held_out, fingerprint): &(Frames, Fingerprint),
    sensors: &[(String, usize)],
    force: bool,
    printer: &Printer,
) -> anyhow::Result<Option<OneStep>> {
    let weights = (study.model.weights, study.model.temperature);
    let inputs = (FORMAT, MOST_TRANSITIONS, &model.manifest.key, weights, fingerprint, sensors);
    let key = artefact::key(&inputs)?;
    let stored = read(study, paths, &model.manifest.key);
    if let Some(stored) = stored.filter(|stored| stored.key == key && !force) {
        return Ok(Some(stored));
    }
    if let Err(reason) = model.in_metric(&rows_of(held_out.states(), &[])?) {
        printer.say(&format!("no one-step errors: {reason:#}"));
        return Ok(None);
    }
    let transitions = Transitions::new(held_out.segments().clone());
    let rows = spaced(&transitions);
    let progress = printer.progress();
    let errors = errors((study, paths), model, held_out, &rows, &progress)?;
    let one_step = OneStep {
        format: FORMAT,
        tool: TOOL.to_owned(),
        key,
        model: model.manifest.key.clone(),
        window: study.data.held_out.clone(),
        held_out: transitions.len(),
        transitions: rows.len(),
        members: model.model.members(),
        all_columns: StepError::new(errors.of_all()),
        sensors: sensors
            .iter()
            .map(|(sensor, column)| SensorError {
                sensor: sensor.clone(),
                error: StepError::new(errors.of_column(*column)),
            })
            .collect(),
    };
    write_json(&paths.rollout().join(FILE), &one_step)?;
    Ok(Some(one_step))
}

/// Source rows of at most [`MOST_TRANSITIONS`] transitions, evenly spaced.
fn spaced(transitions: &Transitions) -> Vec<RowIndex> {
    let (all, taken) = (transitions.len(), transitions.len().min(MOST_TRANSITIONS));
    let place = |number: usize| TransitionIndex::new(number * all / taken);
    (0..taken).map(|number| transitions.source(place(number))).collect()
}

fn errors(
    (study, paths): (&Study, &StudyPaths),
    model: &OpenModel,
    held_out: &Frames,
    rows: &[RowIndex],
    monitor: &dyn Monitor,
) -> anyhow::Result<StepErrors> {
    let states = held_out.states();
    let columns = states.columns();
    let mut errors = StepErrors::new(columns);
    let mut add = |predicted: &[f64], row: RowIndex| {
        errors.add(predicted, states.row(row.get()), states.row(row.get() + 1));
    };
    match &model.model {
        Model::Knn(knn) => {
            let weights = study.model.weights()?;
            let queries = model.in_metric(&rows_of(states, rows)?)?;
            let place = search_place(&model.model, &paths.rollout());
            let recorded = model.frames.states();
            for expected in knn.expected_next(&queries, recorded, weights, &place, monitor)? {
                for (predicted, &row) in expected.chunks_exact(columns).zip(rows) {
                    add(predicted, row);
                }
            }
        }
        Model::Parametric(network) => {
            monitor.begin("one-step errors", 1);
            let all = predict(&**network, states, held_out.segments(), rows, 1, monitor)?;
            for (prediction, &row) in all.iter().zip(rows) {
                let predicted: Vec<f64> = match prediction.steps() {
                    0 => vec![f64::INFINITY; columns],
                    _ => prediction.state(1).iter().copied().map(f64::from).collect(),
                };
                add(&predicted, row);
            }
        }
    }
    Ok(errors)
}

/// Some rows of the states.
fn rows_of(states: &States, rows: &[RowIndex]) -> anyhow::Result<States> {
    let values: Vec<f32> = rows.iter().flat_map(|row| states.row(row.get())).copied().collect();
    States::new(values, rows.len(), states.columns()).context("held-out states")
}

/// The columns of the sensors, as far as the model has them.
pub(super) fn show(one_step: &OneStep, printer: &Printer) -> anyhow::Result<()> {
    printer.result("")?;
    printer.result(&format!(
        "one-step error on held-out data, RMSE of {} transitions, normalised",
        count(one_step.transitions)
    ))?;
    let rows: Vec<Vec<String>> = named(one_step)
        .map(|(name, error)| {
            let or_none = |value: Option<f64>| value.map_or_else(|| "–".to_owned(), significant);
            let no_change = significant(error.no_change_rmse);
            vec![name.to_owned(), or_none(error.rmse), no_change, or_none(error.relative)]
        })
        .collect();
    printer.result(&table(&["sensor", "model", "no change", "model / no change"], &rows))
}

/// All columns together, then sensors.
fn named(one_step: &OneStep) -> impl Iterator<Item = (&str, &StepError)> {
    let sensors = one_step.sensors.iter().map(|of| (of.sensor.as_str(), &of.error));
    sensors.chain([("all columns", &one_step.all_columns)])
}

/// A table for the report: the models side by side, the best of a row in bold where there are several.
pub(super) fn report_table(models: &[(&str, &OneStep)]) -> Option<Table> {
    let (_, first) = models.first()?;
    let several = models.len() > 1;
    let own = |of: &StepError| {
        let cell = |value: Option<f64>| value.map_or(Cell::Missing, Cell::Number);
        [cell(of.rmse), cell(of.relative)]
    };
    let rows = named(first).map(|(name, error)| {
        let mut row = vec![Cell::Text(name.to_owned())];
        for (_, of) in models {
            let found = named(of).find(|(other, _)| *other == name);
            row.extend(found.map_or([Cell::Missing, Cell::Missing], |(_, error)| own(error)));
        }
        row.push(Cell::Text(significant(error.no_change_rmse)));
        row
    });
    let mut columns = vec!["sensor".to_owned()];
    for (name, _) in models {
        columns.extend([name.to_string(), format!("{name} / no change")]);
    }
    columns.push("no change".to_owned());
    Some(Table {
        title: "One-step error".to_owned(),
        caption: format!(
            "RMSE of predictions of the next state, normalised units, over {} of {} held-out transitions in each member. \
             Neighbours predict the mean of what a step would draw. No change predicts that the plant stays as it is; \
             a model above 1 beside it predicts worse than that, and may recombine the log well all the same.",
            count(first.transitions),
            count(first.held_out)
        ),
        columns,
        rows: rows.collect(),
        best: several.then_some(Best::OfRow(Direction::LowerIsBetter)),
    })
}
