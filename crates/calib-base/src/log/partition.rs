//! Divides the training range between pre-training and the calibration model.

use std::{fmt, ops::Range, path::PathBuf};

use calib_core::{Frames, Timestamp};
use calib_data::{DataConfig, DataError, Dataset, TimeRange, format_time};
use calib_files::Fingerprint;
use calib_study::{Job, Partition, Study};

use crate::{
    Context as _, StepError, ensure,
    log::{context::RunContext, plant_of_study, prepared, prepared_log::Prepared},
};

/// A log, with a separate part of its training range for pre-training.
///
/// The normaliser is fitted on the whole training range, both parts: both are known before the deployment.
pub struct Parts {
    /// The training range of the model, and the held-out period.
    pub dataset: Dataset,
    /// The part for pre-training, if the study separates it.
    pub pretrain: Option<PretrainPart>,
    /// The file of the training states, if there is one that has exactly these states.
    pub states: Option<PathBuf>,
}

/// The data for pre-training agents.
pub struct PretrainPart {
    /// The states.
    pub frames: Frames,
    /// Fingerprint of states, timestamps and columns.
    pub fingerprint: Fingerprint,
}

/// Reads a log as [`load`] does, without a held-out period: for a deployment after the end of the log.
///
/// # Errors
/// As [`load`].
pub fn load_training(job: &Job, context: &RunContext) -> Result<Parts, StepError> {
    let data = DataConfig { held_out: None, ..plant_of_study::data_of(job)? };
    parts(job.study(), prepared::open(job, &data, None, context)?)
}

/// Reads the log of a study and divides its training range.
///
/// # Errors
/// If the log does not exist, cannot be read or has no rows in a range of the study; or the observer asks to
/// stop.
pub fn load(job: &Job, context: &RunContext) -> Result<Parts, StepError> {
    let study = job.study();
    let data = plant_of_study::data_of(job)?;
    let prepared = prepared::open(job, &data, None, context);
    // With several deployments, the deployment is the held-out period.
    let prepared = match job.deployment() {
        Some(name) => prepared.with_context(|| format!("[deployments.{name}]"))?,
        None => prepared?,
    };
    parts(study, prepared)
}

/// Whether the error means that the held-out period is outside the log, or has no transitions.
pub fn is_outside(reason: &StepError) -> bool {
    let StepError::Data(reason) = reason.root() else { return false };
    matches!(
        reason.as_ref(),
        DataError::OutsideData { key: "held_out", .. }
            | DataError::NoTransitions { key: "held_out", .. }
    )
}

/// Divides the training range of a log that was read.
///
/// # Errors
/// If a part has no rows.
pub fn parts(study: &Study, prepared: Prepared) -> Result<Parts, StepError> {
    let Prepared { mut dataset, mut states } = prepared;
    let Division { pretrain, model } = divide(&study.partition(), dataset.train.timestamps())?;
    let pretrain = pretrain.map(|rows| {
        let frames = dataset.train.slice(rows);
        let fingerprint = dataset.fingerprint_of(&frames);
        PretrainPart { frames, fingerprint }
    });
    if model.len() < dataset.train.rows() {
        dataset.train = dataset.train.slice(model);
        dataset.fingerprint = dataset.fingerprint_of(&dataset.train);
        states = None;
    }
    Ok(Parts { dataset, pretrain, states })
}

/// Returns the rows of the training states that are for the model.
///
/// # Errors
/// If there are no such rows.
pub fn model_rows(study: &Study, times: &[Timestamp]) -> Result<Range<usize>, StepError> {
    Ok(divide(&study.partition(), times)?.model)
}

/// The rows of the training range, divided into parts.
#[derive(Debug, PartialEq, Eq)]
struct Division {
    /// Rows for pre-training, if there are any.
    pretrain: Option<Range<usize>>,
    /// Rows for the model.
    model: Range<usize>,
}

fn divide(partition: &Partition, times: &[Timestamp]) -> Result<Division, StepError> {
    match partition {
        Partition::Model(None) => Ok(Division { pretrain: None, model: 0..times.len() }),
        Partition::Model(Some(period)) => {
            let model = Span::of_all(times).given(period).rows("model.period", times)?;
            Ok(Division { pretrain: None, model })
        }
        Partition::Divided { fraction, pretrain, model } => {
            in_two(*fraction, [pretrain.as_ref(), model.as_ref()], times)
        }
    }
}

/// A half-open span of time in microseconds, without its end.
#[derive(Clone, Copy, Debug)]
struct Span {
    start: i64,
    end: i64,
}

impl Span {
    fn of_all(times: &[Timestamp]) -> Self {
        Self { start: times[0].as_micros(), end: times[times.len() - 1].as_micros() + 1 }
    }

    /// Returns the range of the study. Ends that it does not give are those of this span.
    fn given(self, range: &TimeRange) -> Self {
        Self {
            start: micros_or(range.start.as_ref(), self.start),
            end: micros_or(range.end.as_ref(), self.end),
        }
    }

    /// Returns the rows in the span that `key` of the study asks for.
    fn rows(self, key: &str, times: &[Timestamp]) -> Result<Range<usize>, StepError> {
        let [first, end] = [self.start, self.end.max(self.start)]
            .map(|limit| times.partition_point(|time| time.as_micros() < limit));
        let rows = first..end;
        ensure!(
            rows.len() > 1,
            "{key} ({self}) has {} states of the training range, which runs from {}; \
             change it, or data.train",
            rows.len(),
            Self::of_all(times)
        );
        Ok(rows)
    }
}

/// Returns the time of a moment in microseconds, or `otherwise` without a moment.
fn micros_or(at: Option<&calib_data::Moment>, otherwise: i64) -> i64 {
    at.map_or(otherwise, |at| at.instant().as_micros())
}

impl fmt::Display for Span {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [start, end] =
            [self.start, self.end].map(|micros| format_time(Timestamp::from_micros(micros)));
        write!(f, "{start} .. {end}")
    }
}

/// Returns the rows for pre-training and for the model, by their periods, or otherwise by a share of the time.
fn in_two(
    fraction: f64,
    periods: [Option<&TimeRange>; 2],
    times: &[Timestamp],
) -> Result<Division, StepError> {
    let all = Span::of_all(times);
    let (pretrain, model) = match periods.map(|period| period.map(|period| all.given(period))) {
        [None, None] => {
            let boundary = all.start + ((all.end - all.start) as f64 * fraction).round() as i64;
            (Span { end: boundary, ..all }, Span { start: boundary, ..all })
        }
        [Some(pretrain), None] => (pretrain, Span { start: pretrain.end, ..all }),
        [None, Some(model)] => (Span { end: model.start, ..all }, model),
        [Some(pretrain), Some(model)] => (pretrain, model),
    };
    ensure!(
        pretrain.end <= model.start || model.end <= pretrain.start,
        "pretrain.period ({pretrain}) and model.period ({model}) overlap: agents must not be pre-trained on the data \
         that their settings are chosen on; move one of them"
    );
    let keys = match periods {
        [None, None] => [
            "the part for pre-training, by pretrain.fraction,",
            "the part that is not for pre-training, by pretrain.fraction,",
        ],
        _ => ["pretrain.period", "model.period"],
    };
    Ok(Division {
        pretrain: Some(pretrain.rows(keys[0], times)?),
        model: model.rows(keys[1], times)?,
    })
}

/// Returns the time from the first to the last state of a part, as text.
///
/// # Errors
/// If it has no states.
pub fn span(frames: &Frames) -> Result<String, StepError> {
    let times = frames.timestamps();
    let (first, last) = times.first().zip(times.last()).context("a part has states")?;
    Ok(format!("{} .. {}", format_time(*first), format_time(*last)))
}

#[cfg(test)]
mod tests {
    use calib_data::Moment;

    use super::*;

    const DAY: i64 = 86_400_000_000;

    fn times() -> Vec<Timestamp> {
        (0..100).map(|hour| Timestamp::from_micros(hour * DAY / 24)).collect()
    }

    fn range(start: &str, end: &str) -> TimeRange {
        TimeRange { start: moment(start), end: moment(end) }
    }

    /// Returns the time in `text`, if it is not empty.
    fn moment(text: &str) -> Option<Moment> {
        (!text.is_empty()).then(|| Moment::new(text).expect("a time"))
    }

    fn divided(
        fraction: f64,
        pretrain: Option<TimeRange>,
        model: Option<TimeRange>,
    ) -> Result<(Range<usize>, Range<usize>), StepError> {
        let partition = Partition::Divided { fraction, pretrain, model };
        let Division { pretrain, model } = divide(&partition, &times())?;
        Ok((pretrain.context("agents are pre-trained")?, model))
    }

    fn divided_for_model(period: Option<TimeRange>) -> Result<Division, StepError> {
        divide(&Partition::Model(period), &times())
    }

    #[test]
    fn a_model_may_have_a_part_of_the_training_range() {
        assert_eq!(
            divided_for_model(None).expect("all"),
            Division { pretrain: None, model: 0..100 }
        );
        let day = divided_for_model(Some(range("1970-01-02", "1970-01-03"))).expect("a day");
        assert_eq!(day, Division { pretrain: None, model: 24..48 });
        let late =
            divided_for_model(Some(range("1970-02-01", ""))).expect_err("too late").to_string();
        assert!(late.starts_with("model.period") && late.contains("has 0 states"), "{late}");
    }

    #[test]
    fn the_first_part_is_for_pre_training() {
        assert_eq!(divided(0.5, None, None).expect("valid"), (0..50, 50..100));
        assert_eq!(divided(0.25, None, None).expect("valid"), (0..25, 25..100));
    }

    #[test]
    fn one_period_leaves_the_rest_to_the_other() {
        let day = range("1970-01-01", "1970-01-02");
        assert_eq!(divided(0.5, Some(day.clone()), None).expect("valid"), (0..24, 24..100));
        let late = range("1970-01-04", "");
        assert_eq!(divided(0.5, None, Some(late)).expect("valid"), (0..72, 72..100));
        let last = range("1970-01-03", "1970-01-04");
        let first = divided(0.5, Some(last), Some(day)).expect("valid");
        assert_eq!(first, (48..72, 0..24), "the model may come first");
    }

    /// Returns the message with which these periods are refused.
    fn refusal(pretrain: Option<TimeRange>, model: Option<TimeRange>) -> String {
        divided(0.5, pretrain, model).expect_err("refused").to_string()
    }

    #[test]
    fn overlaps_and_empty_parts_are_refused() {
        let overlap = refusal(
            Some(range("1970-01-01", "1970-01-03")),
            Some(range("1970-01-02", "1970-01-04")),
        );
        assert!(
            overlap.contains("(1970-01-01 00:00:00 .. 1970-01-03 00:00:00)")
                && overlap.contains("(1970-01-02 00:00:00 .. 1970-01-04 00:00:00) overlap"),
            "{overlap}"
        );
        let nothing = refusal(Some(range("1970-01-01", "")), None);
        assert!(nothing.starts_with("model.period") && nothing.contains("0 states"));
    }
}
