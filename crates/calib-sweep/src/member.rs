use std::sync::{Arc, OnceLock};

use calib_core::{Seed, States};
use calib_files::Fingerprint;
use calib_model::{CalibrationModel, ModelError, ModelStart, Rolling, Trajectory, Weights};

use crate::{Environment, EnvironmentId, FittingRows, RunStream, Span, SweepError};

/// The rollouts of runs that step together, or the error that prevented them.
type LockstepRollouts = Result<Vec<Trajectory>, Arc<ModelError>>;

/// Rollouts of one ensemble member of a calibration model, with one start state per run.
///
/// A stream ends early where its states cease to be finite, and reports it. Runs that step together are rolled out once
/// and cached, because every sensor sees the same streams.
#[derive(Debug)]
pub struct MemberEnvironment<'a> {
    model: &'a dyn CalibrationModel,
    member: usize,
    states: &'a States,
    starts: Vec<ModelStart>,
    options: RolloutOptions,
    together: Vec<OnceLock<LockstepRollouts>>,
}

/// The rollout options of an ensemble member.
#[derive(Clone, Debug)]
pub struct RolloutOptions {
    /// Length of each rollout.
    pub span: Span,
    /// Weights for sampling neighbours.
    pub weights: Weights,
    /// Root of the rollout seeds. Run `r` of member `m` has the seed that [`calib_model::rollouts`] gives it.
    pub seed: Seed,
    /// Fingerprint of the model, the start states and the weights.
    pub inputs: Fingerprint,
}

impl<'a> MemberEnvironment<'a> {
    /// Creates an environment that rolls out member `member` of `model` from each of `starts`. The agent sees `states`,
    /// the normalised states of the data.
    pub fn new(
        model: &'a dyn CalibrationModel,
        member: usize,
        states: &'a States,
        starts: Vec<ModelStart>,
        options: RolloutOptions,
    ) -> Self {
        let together = (0..starts.len().div_ceil(model.lanes())).map(|_| OnceLock::new()).collect();
        Self { model, member, states, starts, options, together }
    }

    /// Rolls out one lockstep group on this thread alone. Threads of the pool may wait for this rollout, so it must not
    /// wait for the pool.
    fn roll_out(&self, lockstep: usize) -> LockstepRollouts {
        let lanes = self.model.lanes();
        let numbers = lockstep * lanes..self.starts.len().min((lockstep + 1) * lanes);
        let RolloutOptions { span, weights, seed, .. } = self.options;
        let rolling = Rolling { steps: span.states() - 1, weights, seed };
        let starts = &self.starts[numbers.clone()];
        self.model.lockstep(self.member, numbers, starts, &rolling).map_err(Arc::new)
    }

    fn stream_of(&self, trajectory: &Trajectory) -> RunStream {
        RunStream {
            stream: trajectory.stream(self.states),
            start_row: trajectory.start_row(),
            not_finite: trajectory.left_finite(),
        }
    }
}

impl Environment for MemberEnvironment<'_> {
    fn id(&self) -> EnvironmentId {
        EnvironmentId::Member(self.member)
    }

    fn runs(&self) -> usize {
        self.starts.len()
    }

    fn inputs(&self, _run: usize) -> Fingerprint {
        self.options.inputs.clone()
    }

    fn fitting_rows(&self, _run: usize) -> FittingRows {
        self.model.left_out_rows(self.member).map_or(FittingRows::All, FittingRows::Only)
    }

    fn stream(&self, run: usize) -> Result<RunStream, SweepError> {
        let lanes = self.model.lanes();
        if lanes == 1 {
            // A repeated request computes the rollout again. Rollouts of single runs are not kept.
            let alone = self.roll_out(run);
            return Ok(self.stream_of(&alone.as_ref().map_err(failed)?[0]));
        }
        let lockstep = run / lanes;
        let together = self.together[lockstep].get_or_init(|| self.roll_out(lockstep));
        Ok(self.stream_of(&together.as_ref().map_err(failed)?[run % lanes]))
    }
}

fn failed(error: &Arc<ModelError>) -> SweepError {
    SweepError::Model(Arc::clone(error))
}

#[cfg(test)]
mod tests {
    use calib_core::{Frames, RowIndex, Segments, Silent, States, Timestamp, Transitions};
    use calib_dynamics::{
        DynamicsConfig, FeedForwardTrainer, Trainer as _, Transitioning, predict,
    };
    use calib_model::{NetworkModel, RequestedStart, StartRow};

    use super::*;

    #[test]
    fn streams_are_the_rollouts_of_their_starts() {
        let values = (0..300_u16).map(|row| (f32::from(row) * 0.2).sin()).collect();
        let states = States::new(values, 300, 1).expect("finite");
        let segments = Segments::from_lengths([300]).expect("valid");
        let transitions = Transitions::new(segments.clone());
        let data = Transitioning::new(&states, &transitions, 0.1).expect("enough");
        let config = DynamicsConfig { hidden_units: 8, epochs: 2, ..DynamicsConfig::default() };
        let mut trainer = FeedForwardTrainer::new(&data, &config, Seed::new(1));
        trainer.epoch(&Silent).expect("finite");
        let network = trainer.model();
        let timestamps = (0..300).map(Timestamp::from_micros).collect();
        let frames = Frames::new(timestamps, segments.clone(), states.clone()).expect("valid");
        let rows: Vec<RowIndex> = (0..20).map(|run| RowIndex::new(run * 7)).collect();
        let starts = rows.iter().map(|&row| StartRow {
            row,
            wanted: RequestedStart::Recorded(row),
            replaced: None,
        });
        let starts = starts.map(ModelStart::Row).collect();
        let expected = predict(&network, &states, &segments, &rows, 30, &Silent).expect("it runs");
        let model = NetworkModel::new(Box::new(network), &frames).expect("fits");
        let options = RolloutOptions {
            span: Span { steps: 30, tail: 1 },
            weights: Weights::Linear,
            seed: Seed::new(1),
            inputs: Fingerprint::of(b"model"),
        };
        let environment = MemberEnvironment::new(&model, 0, &states, starts, options);
        assert_eq!((environment.runs(), environment.id()), (20, EnvironmentId::Member(0)));
        for run in [19, 0, 7, 19] {
            let RunStream { stream, start_row: start, not_finite } =
                environment.stream(run).expect("it runs");
            assert_eq!(not_finite, None);
            assert_eq!((stream.len(), start), (31, rows[run]));
            assert_eq!(stream.state(30), expected[run].state(30));
        }
    }
}
