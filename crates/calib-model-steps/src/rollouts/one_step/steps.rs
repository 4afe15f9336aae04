//! Squared one-step errors, transition by transition, for comparing models.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use calib_base::{StepError, artefact::write_table, ensure};
use calib_core::Timestamp;
use calib_data::table::{Table, read_parquet};
use calib_stats::{ErrorRatio, error_ratio};

/// The file in the directory of rollouts.
const FILE: &str = "one_step.parquet";

/// Squared errors of every predicted transition, in time order.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct SquaredErrors {
    /// Time of the state that each prediction starts from.
    times: Vec<Timestamp>,
    /// Errors of each sensor, then the mean over all columns.
    series: Vec<SensorSquaredErrors>,
}

/// Squared errors of one sensor.
#[derive(Clone, Debug, PartialEq)]
struct SensorSquaredErrors {
    /// `None` for all columns together.
    sensor: Option<String>,
    /// Mean over ensemble members.
    squares: Vec<f64>,
    /// Squared errors of predicting no change.
    of_no_change: Vec<f64>,
}

impl SquaredErrors {
    /// Returns the path of the file.
    pub(super) fn file(directory: &Path) -> PathBuf {
        directory.join(FILE)
    }

    /// Returns errors of 0 at these times, for the sensors and for all columns.
    pub(super) fn new<'a>(
        times: Vec<Timestamp>,
        sensors: impl Iterator<Item = &'a String>,
    ) -> Self {
        let series = sensors
            .cloned()
            .map(Some)
            .chain([None])
            .map(|sensor| SensorSquaredErrors {
                sensor,
                squares: vec![0.0; times.len()],
                of_no_change: vec![0.0; times.len()],
            })
            .collect();
        Self { times, series }
    }

    /// Adds one of `members` predictions of the successor of the state `from`, which was `to`, all `[columns]`.
    /// `sensors` are the columns of the sensors.
    pub(super) fn add(
        &mut self,
        step: usize,
        members: usize,
        predicted: &[f64],
        [from, to]: [&[f32]; 2],
        sensors: &[usize],
    ) {
        let squares: Vec<(f64, f64)> = (0..to.len())
            .map(|column| {
                let to = f64::from(to[column]);
                ((predicted[column] - to).powi(2), (f64::from(from[column]) - to).powi(2))
            })
            .collect();
        let sum =
            squares.iter().fold((0.0, 0.0), |sum, squares| (sum.0 + squares.0, sum.1 + squares.1));
        let columns = squares.len() as f64;
        let of_all = (sum.0 / columns, sum.1 / columns);
        let own = sensors.iter().map(|&column| squares[column]).chain([of_all]);
        for (series, (square, of_no_change)) in self.series.iter_mut().zip(own) {
            series.squares[step] += square / members as f64;
            series.of_no_change[step] += of_no_change / members as f64;
        }
    }

    /// Returns RMSE of the model / RMSE of no change, for a sensor or all columns.
    pub(super) fn beside_no_change(
        &self,
        sensor: Option<&str>,
    ) -> Result<Option<ErrorRatio>, StepError> {
        let Some(own) = self.series(sensor).filter(|series| !series.squares.is_empty()) else {
            return Ok(None);
        };
        Ok(error_ratio(&own.squares, &own.of_no_change)?)
    }

    /// Returns RMSE of this model / RMSE of `other`, over the transitions that both predicted.
    pub(super) fn beside(
        &self,
        other: &Self,
        sensor: Option<&str>,
    ) -> Result<Option<ErrorRatio>, StepError> {
        let Some((own, others)) = self.series(sensor).zip(other.series(sensor)) else {
            return Ok(None);
        };
        let of_other: BTreeMap<&Timestamp, &f64> =
            other.times.iter().zip(&others.squares).collect();
        let shared = self.times.iter().zip(&own.squares);
        let shared = shared.filter_map(|(time, square)| Some((*square, **of_other.get(time)?)));
        let (x, y): (Vec<f64>, Vec<f64>) = shared.unzip();
        if x.is_empty() {
            return Ok(None);
        }
        Ok(error_ratio(&x, &y)?)
    }

    fn series(&self, sensor: Option<&str>) -> Option<&SensorSquaredErrors> {
        self.series.iter().find(|series| series.sensor.as_deref() == sensor)
    }

    /// Writes one row per transition and sensor. An empty sensor stands for all columns.
    pub(super) fn write(&self, directory: &Path) -> Result<(), StepError> {
        let squares = self.series.iter().flat_map(|series| &series.squares).copied();
        let of_no_change = self.series.iter().flat_map(|series| &series.of_no_change).copied();
        let times = self.series.iter().flat_map(|_| &self.times).copied();
        let table = Table::new()
            .with("timestamp", times.collect::<Vec<Timestamp>>())
            .with_optional(
                "sensor",
                self.series
                    .iter()
                    .flat_map(|series| vec![series.sensor.clone(); self.times.len()])
                    .collect(),
            )
            .with("squared_error", squares.collect::<Vec<f64>>())
            .with("no_change_squared_error", of_no_change.collect::<Vec<f64>>());
        write_table(table, &Self::file(directory))
    }

    /// Reads the errors that were written to `directory`.
    pub(super) fn read(directory: &Path) -> Result<Self, StepError> {
        let table = read_parquet(&Self::file(directory))?;
        let times = table.column::<Timestamp>("timestamp")?;
        let sensors = table.optional::<String>("sensor")?;
        let squares = table.column::<f64>("squared_error")?;
        let of_no_change = table.column::<f64>("no_change_squared_error")?;
        let mut series: Vec<SensorSquaredErrors> = Vec::new();
        for (row, sensor) in sensors.iter().enumerate() {
            if series.last().is_none_or(|last| last.sensor != *sensor) {
                let sensor = sensor.clone();
                series.push(SensorSquaredErrors {
                    sensor,
                    squares: Vec::new(),
                    of_no_change: Vec::new(),
                });
            }
            if let Some(last) = series.last_mut() {
                last.squares.push(squares[row]);
                last.of_no_change.push(of_no_change[row]);
            }
        }
        let steps = series.first().map_or(0, |first| first.squares.len());
        ensure!(
            series.iter().all(|series| series.squares.len() == steps),
            "sensors have different numbers of transitions in {}",
            Self::file(directory).display()
        );
        Ok(Self { times: times[..steps].to_vec(), series })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns errors of one sensor in two columns, at these seconds.
    fn steps(errors: &[(i64, f64)]) -> SquaredErrors {
        let times = errors.iter().map(|(second, _)| Timestamp::from_micros(second * 1_000_000));
        let sensor = "PIT300".to_owned();
        let mut steps = SquaredErrors::new(times.collect(), [&sensor].into_iter());
        for (step, (_, error)) in errors.iter().enumerate() {
            for sign in [1.0, -1.0] {
                let predicted = [0.0, 5.0 + sign * error];
                steps.add(step, 2, &predicted, [&[0.0, 4.0], &[0.0, 5.0]], &[1]);
            }
        }
        steps
    }

    #[test]
    fn errors_are_means_over_members() {
        let told = steps(&[(1, 0.5), (2, 2.0)]);
        assert_eq!(told.series(Some("PIT300")).expect("there").squares, [0.25, 4.0]);
        let all = told.series(None).expect("there");
        assert_eq!((&all.squares[..], &all.of_no_change[..]), (&[0.125, 2.0][..], &[0.5, 0.5][..]));
        let ratio = told.beside_no_change(Some("PIT300")).expect("valid").expect("defined");
        assert!((ratio.ratio - (4.25_f64 / 2.0).sqrt()).abs() < 1e-12);
    }

    #[test]
    fn models_are_compared_where_both_predicted() {
        let one = steps(&[(1, 1.0), (2, 1.0), (3, 9.0)]);
        let other = steps(&[(0, 7.0), (1, 2.0), (2, 2.0)]);
        let ratio = one.beside(&other, None).expect("valid").expect("defined");
        assert_eq!((ratio.ratio, ratio.steps, ratio.smaller), (0.5, 2, [2, 0]));
        assert_eq!(one.beside(&steps(&[(9, 1.0)]), None).expect("valid"), None);
        assert_eq!(one.beside(&other, Some("TIT101")).expect("valid"), None);
    }

    #[test]
    fn what_is_written_is_read() {
        let directory = tempfile::tempdir().expect("a directory");
        let written = steps(&[(1, 1.0), (2, f64::INFINITY)]);
        written.write(directory.path()).expect("writable");
        assert_eq!(SquaredErrors::read(directory.path()).expect("readable"), written);
        assert!(SquaredErrors::read(&directory.path().join("none")).is_err());
    }
}
