//! The training range, divided between pre-training and the calibration model.

use std::ops::Range;

use anyhow::{Context as _, ensure};
use calib_core::{Frames, Timestamp};
use calib_data::{Dataset, TimeRange, format_time};
use calib_files::Fingerprint;

use super::plant_of_study;
use crate::{
    output::Printer,
    study::{Partition, Study, StudyPaths},
};

/// A log, with the part of its training range that is for pre-training apart.
///
/// The normaliser is fitted on the whole training range, both parts: both are known before the deployment.
pub(super) struct Parts {
    /// What the model is built from, as the training range; and what is held out.
    pub(super) dataset: Dataset,
    pub(super) pretrain: Option<PretrainPart>,
}

/// What agents are pre-trained on.
pub(super) struct PretrainPart {
    pub(super) frames: Frames,
    pub(super) fingerprint: Fingerprint,
}

/// Read the log of a study and divide its training range if agents are pre-trained.
pub(super) fn load(study: &Study, paths: &StudyPaths, printer: &Printer) -> anyhow::Result<Parts> {
    let data = plant_of_study::data(study, paths)?;
    let dataset = calib_data::load(&data, &study.preprocess, &printer.progress());
    // What is held out is the deployment, where the study has several.
    let dataset = match paths.deployment() {
        Some(name) => dataset.with_context(|| format!("[deployments.{name}]"))?,
        None => dataset?,
    };
    parts(study, dataset)
}

/// Divide the training range of a log that was read, if agents are pre-trained.
pub(super) fn parts(study: &Study, mut dataset: Dataset) -> anyhow::Result<Parts> {
    let Some(partition) = study.pretrain.partition() else {
        return Ok(Parts { dataset, pretrain: None });
    };
    let (pretrain, model) = divide(&partition, dataset.train.timestamps())?;
    let frames = dataset.train.slice(pretrain);
    let fingerprint = dataset.fingerprint_of(&frames);
    dataset.train = dataset.train.slice(model);
    dataset.fingerprint = dataset.fingerprint_of(&dataset.train);
    Ok(Parts { dataset, pretrain: Some(PretrainPart { frames, fingerprint }) })
}

/// The training states of a log that are for the model, which are all unless agents are pre-trained.
pub(super) fn model_rows(study: &Study, times: &[Timestamp]) -> anyhow::Result<Range<usize>> {
    match study.pretrain.partition() {
        Some(partition) => Ok(divide(&partition, times)?.1),
        None => Ok(0..times.len()),
    }
}

/// Rows for pre-training and rows for the model.
fn divide(
    partition: &Partition,
    times: &[Timestamp],
) -> anyhow::Result<(Range<usize>, Range<usize>)> {
    let micros = |row: usize| times[row].as_micros();
    let (first, end) = (micros(0), micros(times.len() - 1) + 1);
    let instant = |at: Option<&calib_data::Moment>, otherwise: i64| {
        at.map_or(otherwise, |at| at.instant().as_micros())
    };
    let given =
        |range: &TimeRange| instant(range.start.as_ref(), first)..instant(range.end.as_ref(), end);
    let (period, model) = match (&partition.period, &partition.model_period) {
        (None, None) => {
            let boundary = first + ((end - first) as f64 * partition.fraction).round() as i64;
            (first..boundary, boundary..end)
        }
        (Some(period), None) => (given(period), given(period).end..end),
        (None, Some(model)) => (first..given(model).start, given(model)),
        (Some(period), Some(model)) => (given(period), given(model)),
    };
    let told = |range: &Range<i64>| {
        let at = |micros| format_time(Timestamp::from_micros(micros));
        format!("{} .. {}", at(range.start), at(range.end))
    };
    ensure!(
        period.end <= model.start || model.end <= period.start,
        "pretrain.period ({}) and pretrain.model_period ({}) overlap: agents must not be pre-trained on the data \
         of the calibration model; move one of them",
        told(&period),
        told(&model)
    );
    let rows = |key: &str, range: &Range<i64>| {
        let before = |limit: i64| times.partition_point(|time| time.as_micros() < limit);
        let rows = before(range.start)..before(range.end.max(range.start));
        ensure!(
            rows.len() > 1,
            "{key} ({}) has {} states of the training range, which runs from {}; \
             change [pretrain] or data.train",
            told(range),
            rows.len(),
            told(&(first..end))
        );
        Ok(rows)
    };
    let keys = match (&partition.period, &partition.model_period) {
        (None, None) => ["the part for pre-training", "the part for the calibration model"],
        _ => ["pretrain.period", "pretrain.model_period"],
    };
    Ok((rows(keys[0], &period)?, rows(keys[1], &model)?))
}

/// The time from the first to the last state of a part, for people.
pub(super) fn span(frames: &Frames) -> anyhow::Result<String> {
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
        let moment = |text: &str| (!text.is_empty()).then(|| Moment::new(text).expect("a time"));
        TimeRange { start: moment(start), end: moment(end) }
    }

    fn partition(period: Option<TimeRange>, model_period: Option<TimeRange>) -> Partition {
        Partition { fraction: 0.5, period, model_period }
    }

    #[test]
    fn the_first_part_is_for_pre_training() {
        let (pretrain, model) = divide(&partition(None, None), &times()).expect("valid");
        assert_eq!((pretrain, model), (0..50, 50..100));
        let quarter = Partition { fraction: 0.25, ..partition(None, None) };
        assert_eq!(divide(&quarter, &times()).expect("valid"), (0..25, 25..100));
    }

    #[test]
    fn one_period_leaves_the_rest_to_the_other() {
        let day = range("1970-01-01", "1970-01-02");
        let divided = divide(&partition(Some(day.clone()), None), &times());
        assert_eq!(divided.expect("valid"), (0..24, 24..100));
        let late = range("1970-01-04", "");
        assert_eq!(
            divide(&partition(None, Some(late)), &times()).expect("valid"),
            (0..72, 72..100)
        );
        let last = range("1970-01-03", "1970-01-04");
        let divided = divide(&partition(Some(last), Some(day)), &times());
        assert_eq!(divided.expect("valid"), (48..72, 0..24), "the model may come first");
    }

    #[test]
    fn overlaps_and_empty_parts_are_refused() {
        let refused = |period, model| {
            divide(&partition(period, model), &times()).expect_err("refused").to_string()
        };
        let overlap = refused(
            Some(range("1970-01-01", "1970-01-03")),
            Some(range("1970-01-02", "1970-01-04")),
        );
        assert!(
            overlap.contains("(1970-01-01 00:00:00 .. 1970-01-03 00:00:00)")
                && overlap.contains("(1970-01-02 00:00:00 .. 1970-01-04 00:00:00) overlap"),
            "{overlap}"
        );
        let nothing = refused(Some(range("1970-01-01", "")), None);
        assert!(nothing.starts_with("pretrain.model_period") && nothing.contains("0 states"));
    }
}
