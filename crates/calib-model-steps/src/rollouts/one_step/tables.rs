//! One-step errors for people: on the terminal, in the report, and for every two models.

use calib_base::{
    Context as _, StepError,
    output::{Printer, count, number, table},
};
use calib_report::{Best, Cell, Table};
use calib_stats::{ErrorRatio, Interval};
use calib_study::{Job, StepKind};
use schemars::JsonSchema;
use serde::Serialize;

use super::{OneStep, PredictionError, read, steps::SquaredErrors};
use crate::rollouts::{self, every_two};

/// A model with its one-step errors.
pub struct OneStepModel {
    name: String,
    one_step: OneStep,
    steps: SquaredErrors,
}

/// Two models compared, in the summary of several models: RMSE of the first / RMSE of the second.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub struct PairedErrors {
    models: [String; 2],
    all_columns: Option<ErrorRatio>,
    sensors: Vec<SensorRatio>,
}

/// The quotient for one sensor.
#[derive(Clone, Debug, Serialize, JsonSchema)]
struct SensorRatio {
    sensor: String,
    /// The quotient; none where it is undefined.
    ratio: Option<ErrorRatio>,
}

/// Prints them, beside those of no change.
pub(crate) fn show(one_step: &OneStep, printer: &Printer) -> Result<(), StepError> {
    printer.result("")?;
    printer.result(&format!(
        "one-step error on held-out data, RMSE of {} transitions, normalised; a quotient above 1 is normal for a model that recombines the log",
        count(one_step.transitions)
    ))?;
    let rows: Vec<Vec<String>> = named(one_step)
        .map(|(name, error)| {
            let no_change = number(error.no_change_rmse);
            let range = error.relative_interval.map(|interval| format!(" ({})", range(interval)));
            let relative = number_text(error.relative) + &range.unwrap_or_default();
            vec![label(name), number_text(error.rmse), no_change, relative]
        })
        .collect();
    printer.lines(&table(&["sensor", "model", "no change", "model / no change (95 %)"], &rows))
}

/// Iterates over the sensors, then all columns together, which have no name.
fn named(one_step: &OneStep) -> impl Iterator<Item = (Option<&str>, &PredictionError)> {
    let sensors = one_step
        .sensors
        .iter()
        .map(|predicted| (Some(predicted.sensor.as_str()), &predicted.error));
    sensors.chain([(None, &one_step.all_columns)])
}

fn label(sensor: Option<&str>) -> String {
    sensor.unwrap_or("all columns").to_owned()
}

/// Formats the number, or a dash.
fn number_text(value: Option<f64>) -> String {
    value.map_or_else(|| "–".to_owned(), number)
}

fn range(interval: Interval) -> String {
    format!("{} to {}", number(interval.low), number(interval.high))
}

/// Compares every two of the models.
///
/// # Errors
/// If an interval cannot be computed.
pub fn all_pairs(models: &[&OneStepModel]) -> Result<Vec<PairedErrors>, StepError> {
    every_two(models)
        .map(|(one, other)| {
            let sensors = one.one_step.sensors.iter().map(|predicted| {
                let ratio = one.steps.beside(&other.steps, Some(&predicted.sensor))?;
                Ok(SensorRatio { sensor: predicted.sensor.clone(), ratio })
            });
            Ok(PairedErrors {
                models: [one, other].map(|model| model.name.clone()),
                all_columns: one.steps.beside(&other.steps, None)?,
                sensors: sensors.collect::<Result<_, StepError>>()?,
            })
        })
        .collect()
}

/// Returns tables for the report: the models side by side, then every two models. If there are several models, the best
/// of a row is bold, and so are all without a clear difference from it.
///
/// # Errors
/// If an interval cannot be computed.
pub fn report_tables(models: &[&OneStepModel]) -> Result<Vec<Table>, StepError> {
    let Some(first) = models.first() else { return Ok(Vec::new()) };
    let several = models.len() > 1;
    let mut rows = Vec::new();
    let mut bold = Vec::new();
    for (place, (sensor, error)) in named(&first.one_step).enumerate() {
        let mut row = vec![Cell::Text(label(sensor))];
        row.extend(models.iter().flat_map(|model| cells(model.error(sensor))));
        row.push(Cell::Text(number(error.no_change_rmse)));
        rows.push(row);
        let best = if several { not_worse(models, sensor)? } else { Vec::new() };
        bold.extend(best.into_iter().map(|model| (place, 1 + 3 * model)));
    }
    let mut columns = vec!["sensor".to_owned()];
    for OneStepModel { name, .. } in models {
        columns.extend([name.clone(), format!("{name} / no change"), "95 %".to_owned()]);
    }
    columns.push("no change".to_owned());
    let marked = if several {
        " Bold: the smallest error of a row, and every other without a clear difference from it, because the 95 % interval of \
         their quotient contains 1 or there is none."
    } else {
        ""
    };
    let caption = format!(
        "RMSE of predictions of the next state, normalised units, over {} of {} held-out transitions in each ensemble member. \
         Neighbours predict the mean of what a step would draw. No change predicts that the plant stays as it is; \
         a model above 1 beside it predicts worse than that, and may recombine the log well all the same. \
         Intervals are over stretches of time.{marked}",
        count(first.one_step.transitions),
        count(first.one_step.held_out)
    );
    let title = "One-step error".to_owned();
    let side_by_side = Table { title, caption, columns, rows, best: Some(Best::Cells(bold)) };
    Ok([side_by_side].into_iter().chain(quotients(models)?).collect())
}

impl OneStepModel {
    /// Reads the stored one-step errors of `model`, if they are of this model and the held-out range of the study.
    ///
    /// # Errors
    /// If the errors of single transitions, which are in a table of their own, cannot be read.
    pub fn read(name: &str, job: &Job, model: &str) -> Result<Option<Self>, StepError> {
        let Some(one_step) = read(job, model) else { return Ok(None) };
        let steps = SquaredErrors::read(&job.layout().rollout())
            .with_context(|| format!("run `{} --force`", job.command(StepKind::Rollout)))?;
        Ok(Some(Self { name: name.to_owned(), one_step, steps }))
    }

    fn error(&self, sensor: Option<&str>) -> Option<&PredictionError> {
        named(&self.one_step).find(|(name, _)| *name == sensor).map(|(_, error)| error)
    }
}

fn cells(error: Option<&PredictionError>) -> [Cell; 3] {
    let interval = error.and_then(|error| error.relative_interval);
    [
        error.and_then(|error| error.rmse).into(),
        error.and_then(|error| error.relative).into(),
        interval.map_or(Cell::Missing, |interval| Cell::Text(range(interval))),
    ]
}

/// Returns the model with the smallest error, and all without a clear difference from it.
fn not_worse(models: &[&OneStepModel], sensor: Option<&str>) -> Result<Vec<usize>, StepError> {
    let own = models.iter().enumerate();
    let known = own.filter_map(|(place, model)| Some((place, model.error(sensor)?.rmse?)));
    rollouts::not_worse(&known.collect::<Vec<_>>(), |place, best| {
        let ratio = models[place].steps.beside(&models[best].steps, sensor)?;
        Ok(ratio.is_some_and(|ratio| ratio.is_told()))
    })
}

/// Returns the ratios of the errors of every two models, if there are several.
fn quotients(models: &[&OneStepModel]) -> Result<Option<Table>, StepError> {
    let pairs: Vec<(&&OneStepModel, &&OneStepModel)> = every_two(models).collect();
    let Some((first, _)) = pairs.first() else { return Ok(None) };
    let mut rows = Vec::new();
    let mut bold = Vec::new();
    for (sensor, _) in named(&first.one_step) {
        let mut row = vec![Cell::Text(label(sensor))];
        for (one, other) in &pairs {
            let ratio = one.steps.beside(&other.steps, sensor)?;
            if ratio.is_some_and(|ratio| ratio.is_told()) {
                bold.push((rows.len(), row.len()));
            }
            row.extend(of_two(ratio));
        }
        rows.push(row);
    }
    let headings = pairs.iter().flat_map(|(one, other)| {
        let one = &one.name;
        let other = &other.name;
        [format!("{one} / {other}"), format!("nearer, {one} : {other}")]
    });
    Ok(Some(Table {
        title: "One-step error, models two by two".to_owned(),
        caption: "RMSE of the first model / RMSE of the second over the same transitions, with its 95 % interval over stretches of time; \
                  below 1 the first is more accurate. Bold: the interval does not contain 1. Then at how many transitions the first \
                  is nearer and at how many the second, each by the mean square over its ensemble members."
            .to_owned(),
        columns: ["sensor".to_owned()].into_iter().chain(headings).collect(),
        rows,
        best: Some(Best::Cells(bold)),
    }))
}

fn of_two(ratio: Option<ErrorRatio>) -> [Cell; 2] {
    let Some(ratio) = ratio else { return [Cell::Missing, Cell::Missing] };
    let range =
        ratio.interval.map(|interval| format!(" ({})", range(interval))).unwrap_or_default();
    let [one, other] = ratio.smaller;
    [
        Cell::Text(format!("{}{range}", number(ratio.ratio))),
        Cell::Text(format!("{} : {}", count(one), count(other))),
    ]
}
