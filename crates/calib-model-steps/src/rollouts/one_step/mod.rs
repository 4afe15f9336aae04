//! Errors of a model's one-step predictions on held-out data.

mod steps;
mod tables;

use calib_base::{
    Context as _, StepError,
    artefact::{self, Below, DirectoryLock, TOOL},
    output::Printer,
};
use calib_core::{Frames, Monitor, RowIndex, States, TransitionIndex, Transitions};
use calib_data::TimeRange;
use calib_files::{
    Fingerprint, fingerprint_file, read_sealed_json, remove_file, write_sealed_json,
};
use calib_model::{Search, Unseen};
use calib_stats::{Interval, StepErrors};
use calib_study::{Job, Layout};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::model::{
    kinds::search_place,
    model_files::{self, OpenModel},
};

use steps::SquaredErrors;
pub(crate) use tables::show;
pub use tables::{OneStepModel, PairedErrors, all_pairs, report_tables};

/// Maximum number of predicted transitions, evenly spaced over the held-out range. More would hardly change the
/// error.
const MOST_TRANSITIONS: usize = 4000;

/// The file in the directory of rollouts.
const FILE: &str = "one_step.json";

const FORMAT: u32 = 4;

/// `one_step.json`: one-step prediction errors, over all ensemble members together.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct OneStep {
    pub(crate) format: u32,
    pub(crate) tool: String,
    pub(crate) key: String,
    /// Fingerprint of the model.
    pub(crate) model: String,
    /// The held-out range, as in the study.
    pub(crate) window: Option<TimeRange>,
    /// Number of held-out transitions; the next two fields are the number predicted in each ensemble member and
    /// the number of ensemble members.
    pub(crate) held_out: usize,
    pub(crate) transitions: usize,
    pub(crate) members: usize,
    /// Error over all columns of the states.
    pub all_columns: PredictionError,
    /// One entry for each sensor.
    pub sensors: Vec<SensorError>,
    /// Fingerprint of the error of every transition.
    steps: Fingerprint,
}

/// One-step prediction error of one sensor.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct SensorError {
    /// Name of the sensor.
    pub sensor: String,
    /// Error of its predictions.
    #[serde(flatten)]
    pub error: PredictionError,
}

/// One-step prediction error, in normalised units.
#[derive(Clone, Copy, Debug, Serialize, Deserialize, JsonSchema)]
pub struct PredictionError {
    /// Root mean squared error; none if a prediction was not finite.
    pub rmse: Option<f64>,
    /// RMSE of predicting that nothing changes.
    pub(crate) no_change_rmse: f64,
    /// `rmse` divided by `no_change_rmse`; none if nothing ever changes.
    pub relative: Option<f64>,
    /// 95 % interval of this quotient, over blocks of time.
    pub(crate) relative_interval: Option<Interval>,
}

impl PredictionError {
    /// Returns the errors for a sensor, or for all columns.
    fn new(
        (rmse, no_change_rmse): (f64, f64),
        steps: &SquaredErrors,
        sensor: Option<&str>,
    ) -> Result<Self, StepError> {
        let rmse = Some(rmse).filter(|rmse| rmse.is_finite());
        let relative = rmse.filter(|_| no_change_rmse > 0.0).map(|rmse| rmse / no_change_rmse);
        let beside = steps.beside_no_change(sensor)?.filter(|_| relative.is_some());
        let relative_interval = beside.and_then(|ratio| ratio.interval);
        Ok(Self { rmse, no_change_rmse, relative, relative_interval })
    }
}

/// Reads the stored one-step errors of `model`. `None` unless they are of this model and the held-out range of the
/// study, and undamaged.
pub fn read(job: &Job, model: &str) -> Option<OneStep> {
    let study = job.study();
    let paths = job.layout();
    let stored: OneStep = read_sealed_json(&paths.rollout().join(FILE)).ok()?;
    let steps = fingerprint_file(&SquaredErrors::file(&paths.rollout())).ok()?;
    let same =
        stored.model == model && stored.window == study.data.held_out && stored.steps == steps;
    (stored.format == FORMAT && same).then_some(stored)
}

/// Whether there are one-step errors that cannot be used: they are of another model or range, or damaged.
pub fn is_stale(job: &Job, model: &str) -> bool {
    let directory = job.layout().rollout();
    let is_there = directory.join(FILE).exists() || SquaredErrors::file(&directory).exists();
    is_there && read(job, model).is_none()
}

/// Removes the one-step errors, because nothing is known one step ahead.
pub(crate) fn remove(paths: &Layout) -> Result<(), StepError> {
    for path in [paths.rollout().join(FILE), SquaredErrors::file(&paths.rollout())] {
        remove_file(&path)?;
    }
    Ok(())
}

/// Returns the one-step errors on `held_out`: stored ones if they are up to date, otherwise new ones, which are
/// stored. `None`, with the reason reported, if the model cannot predict states that it was not built from.
pub(crate) fn ensure(
    job: &Job,
    model: &OpenModel,
    (held_out, fingerprint): &(Frames, Fingerprint),
    sensors: &[(String, usize)],
    printer: &Printer,
) -> Result<Option<OneStep>, StepError> {
    let study = job.study();
    let paths = job.layout();
    let weights = (study.model.weights, study.model.temperature);
    let content = model_files::content(&model.manifest)?;
    let inputs = (FORMAT, MOST_TRANSITIONS, &content, weights, fingerprint, sensors);
    let key = artefact::key(&inputs)?;
    let stored = read(job, &content);
    if let Some(stored) = stored.filter(|stored| stored.key == key && !job.policy().redoes()) {
        return Ok(Some(stored));
    }
    if let Err(reason) = model.in_metric(&rows_of(held_out.states(), &[])?) {
        printer.say(&format!("no one-step errors: {reason}"));
        return Ok(None);
    }
    let transitions = Transitions::new(held_out.segments().clone());
    let rows = spaced(&transitions);
    let progress = printer.progress();
    let (errors, steps) = errors(job, model, held_out, &rows, sensors, &progress)?;
    // This removes the half-written files of a killed process.
    let _lock = DirectoryLock::new(&paths.rollout(), Below::Unknown)?;
    steps.write(&paths.rollout())?;
    let one_step = OneStep {
        format: FORMAT,
        tool: TOOL.to_owned(),
        key,
        model: content,
        window: study.data.held_out.clone(),
        held_out: transitions.len(),
        transitions: rows.len(),
        members: model.model.members(),
        all_columns: PredictionError::new(errors.of_all(), &steps, None)?,
        sensors: sensors
            .iter()
            .map(|(sensor, column): &(String, usize)| {
                let error = PredictionError::new(errors.of_column(*column), &steps, Some(sensor))?;
                Ok(SensorError { sensor: sensor.clone(), error })
            })
            .collect::<Result<_, StepError>>()?,
        steps: fingerprint_file(&SquaredErrors::file(&paths.rollout()))?,
    };
    write_sealed_json(&paths.rollout().join(FILE), &one_step)?;
    Ok(Some(one_step))
}

/// Returns the source rows of at most [`MOST_TRANSITIONS`] transitions, evenly spaced.
fn spaced(transitions: &Transitions) -> Vec<RowIndex> {
    let all = transitions.len();
    let taken = transitions.len().min(MOST_TRANSITIONS);
    (0..taken)
        .map(|number| transitions.source(TransitionIndex::new(number * all / taken)))
        .collect()
}

fn errors(
    job: &Job,
    model: &OpenModel,
    held_out: &Frames,
    rows: &[RowIndex],
    sensors: &[(String, usize)],
    monitor: &dyn Monitor,
) -> Result<(StepErrors, SquaredErrors), StepError> {
    let states = held_out.states();
    let columns = states.columns();
    let mut errors = StepErrors::new(columns);
    let times = rows.iter().map(|row| held_out.timestamps()[row.get()]).collect();
    let mut steps = SquaredErrors::new(times, sensors.iter().map(|(name, _)| name));
    let of_sensors: Vec<usize> = sensors.iter().map(|(_, column)| *column).collect();
    let members = model.model.members();
    let in_metric = model.in_metric(&rows_of(states, rows)?)?;
    let unseen = Unseen { frames: held_out, rows, in_metric: &in_metric };
    let place = search_place(&*model.model, &job.layout().rollout());
    let search = Search { place: &place, monitor };
    let weights = job.study().model.weights()?;
    for expected in model.model.expected_next(unseen, weights, search)? {
        let predictions = expected.chunks_exact(columns).zip(rows);
        for (step, (predicted, row)) in predictions.enumerate() {
            let [from, to] = [0, 1].map(|after| states.row(row.get() + after));
            errors.add(predicted, from, to);
            steps.add(step, members, predicted, [from, to], &of_sensors);
        }
    }
    Ok((errors, steps))
}

/// Returns some rows of the states.
fn rows_of(states: &States, rows: &[RowIndex]) -> Result<States, StepError> {
    let values: Vec<f32> = rows.iter().flat_map(|row| states.row(row.get())).copied().collect();
    States::new(values, rows.len(), states.columns()).context("held-out states")
}
