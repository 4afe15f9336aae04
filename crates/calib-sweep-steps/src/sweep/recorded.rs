//! Recorded values of the predicted sensors in each period. The sweep, which reads the log, thins them out for the
//! report, which does not.

use std::path::Path;

use calib_base::{Context as _, StepError, artefact::write_table, log::partition::PretrainPart};
use calib_core::{Frames, Normalised, Timestamp};
use calib_data::{Dataset, ShownClock, table::Table, table::read_parquet};
use calib_report::{PeriodUse, RecordedFigure, RecordedPeriod, min_max_in_time};

/// The file in the directory of a sweep.
pub(crate) const RECORDED: &str = "recorded.parquet";

/// Number of intervals of a period. The smallest and the largest value of each are kept.
const BUCKETS: usize = 600;

/// Names of periods in the file.
const PRETRAINING: &str = "pre-training";
const TRAINING: &str = "training";
const HELD_OUT: &str = "held-out";

/// Writes `recorded.parquet` for `sensors` (name and state column), with each part of the log that was read.
pub(crate) fn write(
    directory: &Path,
    dataset: &Dataset,
    pretrain: Option<&PretrainPart>,
    sensors: &[(String, usize)],
) -> Result<(), StepError> {
    let pretrain = pretrain.map(|part| (PRETRAINING, &part.frames));
    let held_out = dataset.held_out.as_ref().map(|frames| (HELD_OUT, frames));
    let periods = pretrain.into_iter().chain([(TRAINING, &dataset.train)]).chain(held_out);
    let mut rows = Vec::new();
    for (period, frames) in periods {
        for (sensor, column) in sensors {
            let points = thinned(dataset, frames, *column);
            rows.extend(points.into_iter().map(|point| (period, sensor, point)));
        }
    }
    let table = Table::new()
        .with("period", rows.iter().map(|(period, ..)| (*period).to_owned()).collect())
        .with("sensor", rows.iter().map(|(_, sensor, _)| (*sensor).clone()).collect())
        .with("timestamp", rows.iter().map(|(.., (time, _))| *time).collect())
        .with_optional("value", rows.iter().map(|(.., (_, value))| *value).collect());
    write_table(table, &directory.join(RECORDED))
}

/// Returns values of a column in physical units. `None` marks a break in the line, at the time of the value before.
fn thinned(dataset: &Dataset, frames: &Frames, column: usize) -> Vec<(Timestamp, Option<f64>)> {
    let times = frames.timestamps();
    let secs = without_long_gaps(times.iter().map(|&time| seconds(time)), dataset.period.as_secs());
    let values: Vec<f64> = (0..frames.rows())
        .map(|row: usize| {
            dataset.normaliser.physical(column, Normalised(frames.states().row(row)[column])).0
        })
        .collect();
    let mut points: Vec<(Timestamp, Option<f64>)> = Vec::new();
    for place in min_max_in_time(&secs, &values, BUCKETS, 2.0 * dataset.period.as_secs()) {
        let point = match place {
            Some(row) => (times[row], Some(values[row])),
            None => (points.last().map_or(times[0], |(time, _)| *time), None),
        };
        points.push(point);
    }
    points
}

/// Shortens long gaps in `times`, so that no intervals are spent on them. Gaps stay longer than an interval.
fn without_long_gaps(times: impl Iterator<Item = f64>, period: f64) -> Vec<f64> {
    let times: Vec<f64> = times.collect();
    let steps = times.windows(2).map(|pair| pair[1] - pair[0]);
    let recorded: f64 = steps.clone().filter(|step| *step <= 2.0 * period).sum();
    // Our choice: the figure cuts gaps longer than a tenth of the recorded time, to a hundredth of it.
    let long = recorded / 10.0;
    let short = recorded / 100.0;
    let mut at = times.first().copied().unwrap_or_default();
    let mut shortened: Vec<f64> = times.first().copied().into_iter().collect();
    for step in steps {
        at += if step > long.max(2.0 * period) { short.max(3.0 * period) } else { step };
        shortened.push(at);
    }
    shortened
}

/// Returns the seconds since 1970.
fn seconds(time: Timestamp) -> f64 {
    time.as_micros() as f64 / 1e6
}

/// Names for periods without a name of their own.
#[derive(Clone, Copy)]
pub(crate) struct Periods<'a> {
    /// The use of the training range, if another part is used for pre-training.
    pub(crate) beside_pretraining: &'static str,
    pub(crate) held_out: &'a str,
    /// The clock that times are shown on.
    pub(crate) clock: &'a ShownClock,
}

/// Returns one figure per sensor, from the values that the sweep in `directory` stored.
pub(crate) fn figures(
    directory: &Path,
    sensors: &[String],
    names: Periods<'_>,
) -> Result<Vec<RecordedFigure>, StepError> {
    let path = directory.join(RECORDED);
    let table = read_parquet(&path).with_context(|| path.display().to_string())?;
    let rows = Rows {
        periods: table.column::<String>("period")?,
        sensors: table.column::<String>("sensor")?,
        times: table.column::<Timestamp>("timestamp")?,
        values: table.optional::<f64>("value")?,
    };
    Ok(sensors
        .iter()
        .map(|sensor| RecordedFigure {
            sensor: sensor.clone(),
            unit: None,
            periods: [PRETRAINING, TRAINING, HELD_OUT]
                .into_iter()
                .filter_map(|period| rows.period(period, sensor, names))
                .collect(),
        })
        .collect())
}

/// The table of recorded values.
struct Rows<'a> {
    periods: &'a [String],
    sensors: &'a [String],
    times: &'a [Timestamp],
    values: Vec<Option<f64>>,
}

impl Rows<'_> {
    /// Returns one sensor in one period. `None` if the period has no values.
    fn period(&self, period: &str, sensor: &str, names: Periods<'_>) -> Option<RecordedPeriod> {
        let own: Vec<usize> = (0..self.times.len())
            .filter(|&row| self.periods[row] == period && self.sensors[row] == sensor)
            .collect();
        let first = *own.first()?;
        let last = *own.last()?;
        let (name, used_for) = match period {
            HELD_OUT => (names.held_out, PeriodUse::Deployment),
            // With pre-training, settings are chosen on only part of the training range.
            TRAINING if self.periods.iter().any(|period| period == PRETRAINING) => {
                (names.beside_pretraining, PeriodUse::Learning)
            }
            learned => (learned, PeriodUse::Learning),
        };
        Some(RecordedPeriod {
            name: name.to_owned(),
            used_for,
            times: [first, last].map(|row| names.clock.shown(self.times[row])),
            points: own
                .iter()
                .map(|&row| (seconds(self.times[row]), self.values[row].unwrap_or(f64::NAN)))
                .collect(),
        })
    }
}
