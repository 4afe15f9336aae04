//! Rollouts that freeze at a fixed point, or become non-finite.

use calib_base::{
    StepError,
    output::{Printer, count},
};
use calib_core::States;
use calib_model::{NotFinite, Trajectory};
use calib_report::{Cell, Table};
use calib_stats::{collapse_step, median};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{model::model_files::OpenModel, rollouts::truth::Record};

/// Number of rollouts that freeze, by sensor, and of rollouts that end early; in the manifest of the
/// rollouts.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Collapse {
    /// Number of rollouts of all ensemble members.
    pub rollouts: usize,
    /// One entry for each sensor.
    pub sensors: Vec<SensorCollapse>,
    /// Rollouts that ended because a state was not finite.
    pub(crate) ended: Vec<EndedEarly>,
}

/// Rollouts in which one sensor freezes.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct SensorCollapse {
    /// Name of the sensor.
    pub sensor: String,
    /// Number of rollouts in which the sensor has less than a tenth of the data's spread over the last
    /// quarter.
    pub collapsed: usize,
    /// The step from which on the sensor stays near its final value, the median over these rollouts.
    pub median_step: Option<f64>,
    /// Number of recorded stretches after the same start states, as long as the rollouts; the next field
    /// counts those that freeze.
    pub(crate) recorded: usize,
    pub(crate) recorded_collapsed: usize,
    /// Number of rollouts that end outside the range of the training data by more than the width of this
    /// range.
    pub(crate) escaped: usize,
}

/// A rollout that ended before its last step.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub(crate) struct EndedEarly {
    pub(crate) member: usize,
    pub(crate) rollout: usize,
    /// The step whose state would not have been finite.
    pub(crate) step: usize,
    /// The first column that would not.
    pub(crate) column: String,
}

/// Searches every rollout and sensor for collapse.
pub(crate) fn of(
    model: &OpenModel,
    record: Record<'_>,
    all: &[Vec<Trajectory>],
    sensors: &[(String, usize)],
) -> Result<Collapse, StepError> {
    let states = model.frames.states();
    let rollouts: Vec<&Trajectory> = all.iter().flatten().collect();
    let columns = model.manifest.normaliser.columns();
    let mut ended = Vec::new();
    for (member, rollouts) in all.iter().enumerate() {
        for (number, rollout) in rollouts.iter().enumerate() {
            if let Some(NotFinite { step, column }) = rollout.left_finite() {
                let column = columns[column].name.clone();
                ended.push(EndedEarly { member, rollout: number, step, column });
            }
        }
    }
    let sensors =
        sensors.iter().map(|(name, column)| sensor(record, &rollouts, name, *column, states));
    let sensors = sensors.collect::<Result<_, StepError>>()?;
    Ok(Collapse { rollouts: rollouts.len(), sensors, ended })
}

fn sensor(
    record: Record<'_>,
    rollouts: &[&Trajectory],
    name: &str,
    column: usize,
    states: &States,
) -> Result<SensorCollapse, StepError> {
    let data = Spread::of(states, column);
    let mut steps = Vec::new();
    let mut recorded = 0;
    let mut recorded_collapsed = 0;
    let mut escaped = 0;
    for rollout in rollouts {
        let values = rollout.values(states, column, rollout.steps() + 1);
        let values: Vec<f64> = values.into_iter().map(f64::from).collect();
        escaped += usize::from(data.is_far_out(values[values.len() - 1]));
        steps.extend(collapse_step(&values, data.variance)?.map(|step| step as f64));
        let truth = record.after(rollout.start().0, rollout.steps());
        if truth.len() == values.len() {
            recorded += 1;
            let truth: Vec<f64> = truth.values(column).map(f64::from).collect();
            recorded_collapsed += usize::from(collapse_step(&truth, data.variance)?.is_some());
        }
    }
    Ok(SensorCollapse {
        sensor: name.to_owned(),
        collapsed: steps.len(),
        median_step: if steps.is_empty() { None } else { Some(median(&steps)?) },
        recorded,
        recorded_collapsed,
        escaped,
    })
}

/// The spread of a column of the training data.
struct Spread {
    variance: f64,
    low: f64,
    high: f64,
}

impl Spread {
    fn of(states: &States, column: usize) -> Self {
        let values = (0..states.rows()).map(|row| f64::from(states.row(row)[column]));
        let n = states.rows() as f64;
        let mean = values.clone().sum::<f64>() / n;
        Self {
            variance: values.clone().map(|value| (value - mean).powi(2)).sum::<f64>() / n,
            low: values.clone().fold(f64::INFINITY, f64::min),
            high: values.fold(f64::NEG_INFINITY, f64::max),
        }
    }

    fn is_far_out(&self, value: f64) -> bool {
        let width = self.high - self.low;
        value < self.low - width || value > self.high + width
    }
}

/// Prints the findings, or nothing if there are none.
pub(crate) fn show(collapse: &Collapse, printer: &Printer) -> Result<(), StepError> {
    let all = collapse.rollouts;
    for ended in &collapse.ended {
        printer.warn(&format!(
            "rollout {} of ensemble member {} ends before step {}: {} would not be finite there; train the network for longer or with a smaller dynamics.learning_rate, or use model.kind = \"knn\"",
            ended.rollout,
            ended.member,
            count(ended.step),
            ended.column
        ));
    }
    for sensor in &collapse.sensors {
        if let Some(step) = sensor.median_step {
            let recorded = match sensor.recorded {
                0 => String::new(),
                recorded => {
                    format!(
                        ", and in {} of {recorded} recorded stretches",
                        sensor.recorded_collapsed
                    )
                }
            };
            printer.result(&format!(
                "  {} freezes in {} of {all} rollouts, from step {} on (median){recorded}",
                sensor.sensor,
                sensor.collapsed,
                count(step as usize),
            ))?;
        }
        if sensor.escaped > 0 {
            printer.result(&format!(
                "  {} ends far outside the range of the data in {} of {all} rollouts",
                sensor.sensor, sensor.escaped
            ))?;
        }
    }
    Ok(())
}

/// Returns a table for the report, or `None` without findings.
pub fn report_table(model: &str, collapse: &Collapse) -> Option<Table> {
    if collapse.ended.is_empty()
        && !collapse.sensors.iter().any(|sensor| sensor.collapsed > 0 || sensor.escaped > 0)
    {
        return None;
    }
    let ended = match collapse.ended.len() {
        0 => String::new(),
        number => format!(" {number} rollouts ended early because a state was not finite."),
    };
    let rows = collapse.sensors.iter().map(|sensor| {
        vec![
            Cell::Text(sensor.sensor.clone()),
            Cell::Count(sensor.collapsed as u64),
            sensor.median_step.map_or(Cell::Missing, |step| Cell::Count(step as u64)),
            Cell::Text(format!("{} of {}", sensor.recorded_collapsed, sensor.recorded)),
            Cell::Count(sensor.escaped as u64),
        ]
    });
    let columns = ["sensor", "frozen", "from step (median)", "recorded ones", "far outside"];
    Some(Table {
        title: "Rollouts that freeze".to_owned(),
        caption: format!(
            "{model}, {} rollouts. A sensor freezes if over the last quarter of a rollout it has less than a tenth of the data's spread. It does so from the step after which it stays within a fifth of that spread. The log after the same start states is judged alike. Far outside: beyond the data's range by more than its width, at the end.{ended}",
            collapse.rollouts
        ),
        columns: columns.map(str::to_owned).to_vec(),
        rows: rows.collect(),
        best: None,
    })
}
