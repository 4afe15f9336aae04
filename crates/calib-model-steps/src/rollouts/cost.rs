//! Expected cost of rollouts: the steps of the model, and the comparison with the record.

use calib_base::{
    StepError,
    clock::TimeTaken,
    cost::{StepCost, processor_secs},
    log::context::RunContext,
};
use calib_core::{Frames, Monitor, RowIndex};
use calib_dynamics::{LANES, predict};
use calib_files::ScratchPlace;
use calib_model::{
    Absent, CalibrationModel, ModelFamily, Rolling, Search, StartSource, rollout, start_states,
};
use calib_study::{Job, StepKind, Study};

use crate::{
    model::{build_cost::Sample, model_files::OpenModel, train_model},
    represent,
    rollouts::comparison,
};

/// Largest number of timed steps, of all rollouts that step together.
const TIMED_STEPS: usize = 256;
/// Number of rows of a model that stands in for one that is not built yet. A step takes about as long in any model.
const SAMPLE_ROWS: usize = 2_000;
/// Bytes of a row of the trajectories, besides its state, and for each sensor: the table, its copy that is written, and
/// its figure. Measured, rounded up.
const ROW_BYTES: u64 = 88;
const SENSOR_BYTES: u64 = 56;
/// Upper bound on the bytes of a row in the file of the trajectories, and for each sensor: a value in physical units
/// (f64), a normalised one (f32) and the recorded one (f64).
const ROW_FILE_BYTES: u64 = 36;
const SENSOR_FILE_BYTES: u64 = 20;

/// The number and length of a study's rollouts, and their memory.
#[derive(Clone, Copy)]
pub(super) struct RolloutSize {
    members: usize,
    rollouts: usize,
    steps: usize,
    /// Number of steps that are compared with the record.
    compared: usize,
    sensors: usize,
    /// Bytes per state of a rollout.
    state_bytes: u64,
    /// Number of rollouts that step together.
    lanes: usize,
}

impl RolloutSize {
    /// Returns the rollouts of a model that is there.
    pub(super) fn of(study: &Study, model: &dyn CalibrationModel, sensors: usize) -> Self {
        let (state_bytes, lanes) = (model.state_bytes(), model.lanes().max(1));
        Self { members: model.members(), ..Self::of_shape(study, state_bytes, lanes, sensors) }
    }

    /// Returns the rollouts of a model that is still to be built.
    fn of_shape(study: &Study, state_bytes: u64, lanes: usize, sensors: usize) -> Self {
        let config = &study.rollout;
        let (rollouts, steps) = (config.rollouts, config.steps);
        let compared = config.dtw_steps.min(steps);
        let members = study.members();
        Self { members, rollouts, steps, compared, sensors, state_bytes, lanes }
    }

    fn rows(&self) -> u64 {
        (self.members * self.rollouts * (self.steps + 1)) as u64
    }

    /// Returns the bytes of memory.
    pub(super) fn memory(&self) -> u64 {
        let row = self.state_bytes + ROW_BYTES + SENSOR_BYTES * self.sensors as u64;
        self.rows().saturating_mul(row)
    }

    /// Returns the cost, given the processor seconds of [`timed_steps`](Self::timed_steps) steps of the rollouts that
    /// step together.
    fn cost(&self, stepping: f64) -> Result<StepCost, StepError> {
        let longer = self.steps as f64 / self.timed_steps() as f64;
        let groups = self.members * self.rollouts.div_ceil(self.lanes);
        let comparing = if self.compared == 0 {
            0.0
        } else {
            let pairs = self.members * self.rollouts * self.sensors;
            pairs as f64 * comparison::secs_of_pair(self.compared)?
        };
        let row = ROW_FILE_BYTES + SENSOR_FILE_BYTES * self.sensors as u64;
        Ok(StepCost {
            processor_secs: stepping * longer * groups as f64 + comparing,
            memory: self.memory(),
            disk: self.rows().saturating_mul(row),
        })
    }

    fn timed_steps(&self) -> usize {
        self.steps.min(TIMED_STEPS / self.lanes).max(1)
    }
}

/// Reports the expected cost of the rollouts of a model that is there.
pub(super) fn expect(
    job: &Job,
    model: &OpenModel,
    size: RolloutSize,
    context: &RunContext,
) -> Result<(), StepError> {
    let study = job.study();
    let model = &*model.model;
    let monitor = context.silent().progress();
    let seed = study.seed_of_rollouts();
    let search = Search { place: &ScratchPlace::Memory, monitor: &monitor };
    // A network with a hidden state would first process the states before a later row.
    let first = [RowIndex::new(0)];
    let source = if size.lanes == 1 {
        StartSource::Random
    } else {
        StartSource::Rows { rows: &first, absent: Absent::Replace }
    };
    let starts = model.starts(source, size.lanes.min(size.rollouts), seed, search)?;
    let rolling = Rolling { steps: size.timed_steps(), weights: study.model.weights()?, seed };
    let stepping =
        processor_secs(&monitor, |monitor| model.roll_out(0, &starts[0], &rolling, monitor))?;
    let Some(stepping) = stepping else { return Ok(()) };
    context.tell_cost(StepKind::Rollout, job, size.cost(stepping)?);
    Ok(())
}

/// Reports the expected cost of the rollouts of a model that is still to be built from `train`, by the shape of the
/// model.
pub(super) fn expect_before_model(
    job: &Job,
    train: &Frames,
    sensors: usize,
    context: &RunContext,
) -> Result<(), StepError> {
    let study = job.study();
    let monitor = context.silent().progress();
    let columns = train.states().columns();
    let (state_bytes, lanes) = match study.model.kind.family() {
        ModelFamily::Network => (4 * columns as u64, LANES),
        // A rollout is a list of rows.
        ModelFamily::Neighbors | ModelFamily::None => (4, 1),
    };
    let size = RolloutSize::of_shape(study, state_bytes, lanes, sensors);
    let steps = size.timed_steps();
    let stepping = match study.model.kind.family() {
        ModelFamily::Network => network_secs(study, train, steps, &monitor)?,
        ModelFamily::Neighbors | ModelFamily::None => {
            let every = context.stands_in().unwrap_or(1);
            let columns = represent::width(study, job.layout(), columns).coordinates(columns);
            let sample = Sample { states: train.states(), every, columns };
            neighbors_secs(study, sample, steps, &monitor)?
        }
    };
    let Some(stepping) = stepping else { return Ok(()) };
    context.tell_cost(StepKind::Rollout, job, size.cost(stepping)?);
    Ok(())
}

/// Returns the processor seconds in which as many rollouts of a network as step together make so many steps. `None` if
/// its shape is not known, or no step is made while they are timed.
fn network_secs(
    study: &Study,
    train: &Frames,
    steps: usize,
    monitor: &dyn Monitor,
) -> Result<Option<f64>, StepError> {
    let states = train.states();
    let Some(network) = train_model::untrained(study, states.columns())? else { return Ok(None) };
    let starts = [RowIndex::new(0); LANES];
    processor_secs(monitor, |monitor| {
        predict(&*network, states, train.segments(), &starts, steps, monitor)
    })
}

/// Returns the seconds of a rollout of so many steps in a model of a part of the states. `None` if they make no model.
fn neighbors_secs(
    study: &Study,
    sample: Sample<'_>,
    steps: usize,
    monitor: &dyn Monitor,
) -> Result<Option<f64>, StepError> {
    let model = match sample.model(SAMPLE_ROWS, &study.model, monitor) {
        Ok(model) => model,
        Err(reason) if reason.was_cancelled() => return Err(reason),
        Err(_) => return Ok(None),
    };
    let seed = study.seed_of_rollouts();
    let weights = study.model.weights()?;
    let member = model.member(0);
    let starts = start_states(&member, StartSource::Random, 1, seed)?;
    let (_, taken) = TimeTaken::by(|| rollout(&member, &starts[0], steps, weights, seed));
    Ok(Some(taken.secs))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn size(compared: usize, lanes: usize) -> RolloutSize {
        let (members, rollouts, steps) = (5, 20, 10 * TIMED_STEPS);
        RolloutSize { members, rollouts, steps, compared, sensors: 2, state_bytes: 4, lanes }
    }

    #[test]
    fn rollouts_that_step_together_count_once() {
        let [alone, together] =
            [1, 16].map(|lanes| size(0, lanes).cost(0.5).expect("no comparison"));
        assert_eq!(alone.processor_secs, 0.5 * 10.0 * 100.0);
        // 16 rollouts, and the other 4; a sixteenth of the steps is timed.
        assert_eq!(together.processor_secs, 0.5 * 160.0 * 10.0);
        let rows = 100 * (10 * TIMED_STEPS as u64 + 1);
        assert_eq!(alone.memory, rows * (4 + 88 + 2 * 56));
        assert_eq!(alone.disk, rows * (36 + 2 * 20));
    }

    #[test]
    fn comparisons_take_time() {
        let compared = size(500, 1).cost(0.0).expect("comparable");
        assert!(compared.processor_secs > 0.0, "{compared:?}");
    }
}
