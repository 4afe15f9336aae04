use std::sync::{Arc, OnceLock};

use calib_core::{Frames, RowIndex, Silent};
use calib_dynamics::{
    Dynamics, DynamicsError, Ended, LANES, PredictedStream, Prediction, predict_in_lockstep,
};
use calib_files::Fingerprint;

use crate::{Environment, EnvironmentId, NotFinite, RunStream, Span, SweepError};

/// The rollouts of runs that step together, or why there are none.
type Predicted = Result<Vec<Arc<Prediction>>, Arc<DynamicsError>>;

/// Rollouts of a parametric model, one start row a run. It is an ensemble of one: member 0.
///
/// A stream ends early where predictions cease to be finite, and says so. Runs that step together are predicted once and kept,
/// because every sensor sees the same streams.
#[derive(Debug)]
pub struct PredictedEnvironment<'a> {
    model: &'a dyn Dynamics,
    frames: &'a Frames,
    starts: Vec<RowIndex>,
    span: Span,
    inputs: Fingerprint,
    together: Vec<OnceLock<Predicted>>,
}

impl<'a> PredictedEnvironment<'a> {
    /// `model` rolled out from each of `starts`, rows of `frames`, for the states of `span`. `inputs` is the fingerprint of the
    /// model and the start rows.
    ///
    /// # Errors
    /// If the model does not fit the states.
    pub fn new(
        model: &'a dyn Dynamics,
        frames: &'a Frames,
        starts: Vec<RowIndex>,
        span: Span,
        inputs: Fingerprint,
    ) -> Result<Self, SweepError> {
        let (columns, states) = (model.columns(), frames.states().columns());
        if columns != states {
            let reason = format!("the model has {columns} columns, the states have {states}");
            return Err(SweepError::Dynamics(Arc::new(DynamicsError::Weights { reason })));
        }
        let together = (0..starts.len().div_ceil(LANES)).map(|_| OnceLock::new()).collect();
        Ok(Self { model, frames, starts, span, inputs, together })
    }
}

impl Environment for PredictedEnvironment<'_> {
    fn id(&self) -> EnvironmentId {
        EnvironmentId::Member(0)
    }

    fn runs(&self) -> usize {
        self.starts.len()
    }

    fn inputs(&self, _run: usize) -> Fingerprint {
        self.inputs.clone()
    }

    fn stream(&self, run: usize) -> Result<RunStream, SweepError> {
        let lockstep = run / LANES;
        // On this thread alone: work that waits here must not wait for the pool that waits for it.
        let predicted = self.together[lockstep].get_or_init(|| {
            let first = lockstep * LANES;
            let starts = &self.starts[first..self.starts.len().min(first + LANES)];
            let (states, segments) = (self.frames.states(), self.frames.segments());
            predict_in_lockstep(
                self.model,
                states,
                segments,
                starts,
                self.span.states() - 1,
                &Silent,
            )
            .map(|rollouts| rollouts.into_iter().map(Arc::new).collect())
            .map_err(Arc::new)
        });
        let predicted = predicted.as_ref().map_err(|error| SweepError::Dynamics(error.clone()))?;
        let prediction = predicted[run % LANES].clone();
        let not_finite = match prediction.ended() {
            Ended::Complete => None,
            Ended::NotFinite { step, column } => Some(NotFinite { step, column }),
        };
        let stream = Box::new(PredictedStream::new(prediction));
        Ok(RunStream { stream, start_row: self.starts[run], not_finite })
    }
}

#[cfg(test)]
mod tests {
    use calib_core::{Seed, Segments, States, Timestamp};
    use calib_dynamics::{
        DynamicsConfig, FeedForwardTrainer, Trainer as _, Transitioning, predict,
    };

    use super::*;

    #[test]
    fn streams_are_the_rollouts_of_their_starts() {
        let values = (0..300_u16).map(|row| (f32::from(row) * 0.2).sin()).collect();
        let states = States::new(values, 300, 1).expect("finite");
        let segments = Segments::from_lengths([300]).expect("valid");
        let transitions = calib_core::Transitions::new(segments.clone());
        let data = Transitioning::new(&states, &transitions, 0.1).expect("enough");
        let config = DynamicsConfig { hidden_units: 8, epochs: 2, ..DynamicsConfig::default() };
        let mut trainer = FeedForwardTrainer::new(&data, &config, Seed::new(1));
        trainer.epoch(&Silent).expect("finite");
        let model = trainer.model();
        let timestamps = (0..300).map(Timestamp::from_micros).collect();
        let frames = Frames::new(timestamps, segments.clone(), states.clone()).expect("valid");
        let starts: Vec<RowIndex> = (0..20).map(|run| RowIndex::new(run * 7)).collect();
        let inputs = Fingerprint::of(b"model");
        let span = Span { steps: 30, tail: 1 };
        let environment =
            PredictedEnvironment::new(&model, &frames, starts.clone(), span, inputs).expect("fits");
        let expected = predict(&model, &states, &segments, &starts, 30, &Silent).expect("it runs");
        assert_eq!((environment.runs(), environment.id()), (20, EnvironmentId::Member(0)));
        for run in [19, 0, 7, 19] {
            let RunStream { stream, start_row: start, not_finite } =
                environment.stream(run).expect("it runs");
            assert_eq!(not_finite, None);
            assert_eq!((stream.len(), start), (31, starts[run]));
            assert_eq!(stream.state(30), expected[run].state(30));
        }
    }
}
