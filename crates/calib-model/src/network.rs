use std::{ops::Range, sync::Arc};

use calib_core::{Frames, Monitor, Seed, Segments, Silent, States, Transitions};
use calib_dynamics::{
    Dynamics, DynamicsError, LANES, Noise, Prediction, ResidualNoise, Residuals, Rollouts, Start,
    predict,
};
use calib_knn::Weights;

use crate::{
    CalibrationModel, ModelError, ModelStart, Rolling, Search, StartRow, StartSource, Trajectory,
    Unseen, rollout_seed, start_rows,
};

/// One network: an ensemble of one. Its rollouts are predictions, which may differ from all recorded states.
#[derive(Debug)]
pub struct NetworkModel {
    dynamics: Box<dyn Dynamics>,
    states: States,
    segments: Segments,
    noise: Option<ResidualNoise>,
}

impl NetworkModel {
    /// Returns a model that makes rollouts of `dynamics` from rows of `frames`.
    ///
    /// # Errors
    /// If `dynamics` is for states with another number of columns.
    pub fn new(dynamics: Box<dyn Dynamics>, frames: &Frames) -> Result<Self, ModelError> {
        let (columns, states) = (dynamics.columns(), frames.states().columns());
        if columns != states {
            let reason = format!("the model has {columns} columns, the states have {states}");
            return Err(DynamicsError::Weights { reason }.into());
        }
        let states = frames.states().clone();
        let segments = frames.segments().clone();
        Ok(Self { dynamics, states, segments, noise: None })
    }

    /// Returns the same model, whose rollouts add these residuals to each prediction, and stay in the range of its states.
    #[must_use]
    pub fn with_noise(mut self, noise: Noise, residuals: Residuals) -> Self {
        self.noise = Some(ResidualNoise::new(noise, residuals, &self.states));
        self
    }

    fn rollouts(&self) -> Rollouts<'_> {
        Rollouts {
            model: &*self.dynamics,
            states: &self.states,
            segments: &self.segments,
            noise: self.noise.as_ref(),
        }
    }
}

/// Returns the rows of start states, if these belong to a network.
fn rows_of(starts: &[ModelStart]) -> Result<Vec<StartRow>, ModelError> {
    starts
        .iter()
        .map(|start| match start {
            ModelStart::Row(start) => Ok(*start),
            ModelStart::State(_) => Err(ModelError::OtherStart),
        })
        .collect()
}

/// Returns the seeded start states of rollouts that are numbered from `first` on.
fn seeded(starts: &[StartRow], first: usize, seed: Seed) -> Vec<Start> {
    starts
        .iter()
        .enumerate()
        .map(|(place, start)| Start { row: start.row, seed: rollout_seed(seed, 0, first + place) })
        .collect()
}

fn trajectories(predictions: Vec<Prediction>, starts: Vec<StartRow>) -> Vec<Trajectory> {
    predictions
        .into_iter()
        .zip(starts)
        .map(|(prediction, start)| Trajectory::Predicted {
            prediction: Arc::new(prediction),
            start,
        })
        .collect()
}

impl CalibrationModel for NetworkModel {
    fn members(&self) -> usize {
        1
    }

    fn starts(
        &self,
        source: StartSource<'_>,
        count: usize,
        seed: Seed,
        _search: Search<'_>,
    ) -> Result<Vec<Vec<ModelStart>>, ModelError> {
        let transitions = Transitions::new(self.segments.clone());
        let seed = source.seed_of(seed, 0);
        let starts = start_rows(&self.states, &transitions, source, count, seed)?;
        Ok(vec![starts.into_iter().map(ModelStart::Row).collect()])
    }

    fn roll_out(
        &self,
        _member: usize,
        starts: &[ModelStart],
        rolling: &Rolling,
        monitor: &dyn Monitor,
    ) -> Result<Vec<Trajectory>, ModelError> {
        let starts = rows_of(starts)?;
        let seeded = seeded(&starts, 0, rolling.seed);
        let all = self.rollouts().predict(&seeded, rolling.steps, monitor)?;
        Ok(trajectories(all, starts))
    }

    fn lanes(&self) -> usize {
        LANES
    }

    fn lockstep(
        &self,
        _member: usize,
        numbers: Range<usize>,
        starts: &[ModelStart],
        rolling: &Rolling,
    ) -> Result<Vec<Trajectory>, ModelError> {
        let starts = rows_of(starts)?;
        let seeded = seeded(&starts, numbers.start, rolling.seed);
        let all = self.rollouts().predict_in_lockstep(&seeded, rolling.steps, &Silent)?;
        Ok(trajectories(all, starts))
    }

    fn expected_next(
        &self,
        Unseen { frames, rows, .. }: Unseen<'_>,
        _weights: Weights,
        Search { monitor, .. }: Search<'_>,
    ) -> Result<Vec<Vec<f64>>, ModelError> {
        let states = frames.states();
        let segments = frames.segments();
        let columns = states.columns();
        let mut expected = Vec::with_capacity(rows.len() * columns);
        for prediction in predict(&*self.dynamics, states, segments, rows, 1, monitor)? {
            match prediction.steps() {
                0 => expected.extend(std::iter::repeat_n(f64::INFINITY, columns)),
                _ => expected.extend(prediction.state(1).iter().copied().map(f64::from)),
            }
        }
        Ok(vec![expected])
    }

    fn state_bytes(&self) -> u64 {
        (size_of::<f32>() * self.states.columns()) as u64
    }

    fn search_bytes(&self, _threads: usize) -> u64 {
        0
    }

    fn left_out_rows(&self, _member: usize) -> Option<Range<usize>> {
        None
    }
}
