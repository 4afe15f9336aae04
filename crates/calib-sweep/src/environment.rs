use std::fmt;

use calib_core::{Frames, RowIndex, RowStream, Seed, States, Stream};
use calib_files::Fingerprint;
use calib_knn::{Member, Weights};
use calib_rollout::{StartState, rollout, rollout_seed};
use serde::{Deserialize, Serialize};

use crate::SweepError;

/// Where agents are trained.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EnvironmentId {
    /// A member of the calibration model's ensemble.
    Member(usize),
    /// The held-out log, replayed in time order: the truth that selection is judged by.
    Online,
    /// The training log, replayed: the obvious alternative to a calibration model.
    LogReplay,
}

impl fmt::Display for EnvironmentId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Member(member) => write!(f, "member:{member}"),
            Self::Online => f.write_str("online"),
            Self::LogReplay => f.write_str("log-replay"),
        }
    }
}

/// The stream of a run.
pub struct RunStream {
    /// The states; they end where the rollout did.
    pub stream: Box<dyn Stream>,
    /// The row that it starts from.
    pub start_row: RowIndex,
    /// Where the rollout left the finite numbers, if it did. Such a run trains nothing: the error of every value is +∞.
    pub not_finite: Option<NotFinite>,
}

impl RunStream {
    /// A stream of all steps that were asked for.
    pub fn complete(stream: impl Stream + 'static, start_row: RowIndex) -> Self {
        Self { stream: Box::new(stream), start_row, not_finite: None }
    }
}

/// Where a model's rollout left the finite numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct NotFinite {
    /// The step that could not be taken, counted from 1.
    pub step: usize,
    /// The first column of its state that is not finite.
    pub column: usize,
}

/// A source of streams. The stream of a run depends on the run alone, never on the agent,
/// so that all candidates see the same one.
pub trait Environment: Sync {
    /// Which environment this is.
    fn id(&self) -> EnvironmentId;

    /// Number of runs.
    fn runs(&self) -> usize;

    /// Fingerprint of what the streams are made from.
    fn inputs(&self) -> Fingerprint;

    /// The stream of `run`.
    ///
    /// # Errors
    /// If no stream can be made, such as from a start state that the model lacks.
    fn stream(&self, run: usize) -> Result<RunStream, SweepError>;
}

/// Recorded rows in time order, across segments but never through a gap.
#[derive(Debug)]
pub struct ReplayEnvironment<'a> {
    id: EnvironmentId,
    frames: &'a Frames,
    steps: usize,
    runs: usize,
    seed: Seed,
    inputs: Fingerprint,
}

impl<'a> ReplayEnvironment<'a> {
    /// Online: every run replays the first `steps` transitions of the held-out `frames`.
    /// Runs differ in the agents' seeds only. `inputs` is the fingerprint of the data.
    pub fn online(held_out: &'a Frames, steps: usize, runs: usize, inputs: Fingerprint) -> Self {
        let seed = Seed::new(0);
        Self { id: EnvironmentId::Online, frames: held_out, steps, runs, seed, inputs }
    }

    /// Log replay: every run replays a window of the training `frames` that starts at a row
    /// drawn from `seed` and the run's number.
    pub fn log_replay(
        train: &'a Frames,
        steps: usize,
        runs: usize,
        seed: Seed,
        inputs: Fingerprint,
    ) -> Self {
        Self { id: EnvironmentId::LogReplay, frames: train, steps, runs, seed, inputs }
    }

    /// First row of the window of `run`.
    fn start(&self, run: usize) -> usize {
        let length = self.length();
        match self.id {
            EnvironmentId::Online | EnvironmentId::Member(_) => 0,
            EnvironmentId::LogReplay => {
                self.seed.number(run as u64).rng().below(self.frames.rows() - length + 1)
            }
        }
    }

    /// Rows of a window: one more than steps.
    fn length(&self) -> usize {
        self.frames.rows().min(self.steps + 1)
    }
}

impl Environment for ReplayEnvironment<'_> {
    fn id(&self) -> EnvironmentId {
        self.id
    }

    fn runs(&self) -> usize {
        self.runs
    }

    fn inputs(&self) -> Fingerprint {
        self.inputs.clone()
    }

    fn stream(&self, run: usize) -> Result<RunStream, SweepError> {
        if self.length() < 2 {
            return Err(SweepError::TooShort { steps: self.length().saturating_sub(1) });
        }
        let start = self.start(run);
        let window = start..start + self.length();
        let stream =
            RowStream::window(self.frames.states().clone(), self.frames.segments(), window);
        Ok(RunStream::complete(stream, RowIndex::new(start)))
    }
}

/// Rollouts of one member of the calibration model, one start state a run.
#[derive(Debug)]
pub struct MemberEnvironment<'a> {
    member: Member<'a>,
    states: &'a States,
    starts: Vec<StartState>,
    options: RolloutOptions,
}

/// How a member is rolled out.
#[derive(Clone, Debug)]
pub struct RolloutOptions {
    /// Steps of each rollout.
    pub steps: usize,
    /// How neighbours are drawn.
    pub weights: Weights,
    /// Root of the rollouts' seeds; run `r` of member `m` is seeded as in [`calib_rollout::rollouts`].
    pub seed: Seed,
    /// Fingerprint of the model, the start states and the weights.
    pub inputs: Fingerprint,
}

impl<'a> MemberEnvironment<'a> {
    /// `member` rolled out from each of `starts`; the agent sees `states`, the normalised states of the data.
    pub fn new(
        member: Member<'a>,
        states: &'a States,
        starts: Vec<StartState>,
        options: RolloutOptions,
    ) -> Self {
        Self { member, states, starts, options }
    }
}

impl Environment for MemberEnvironment<'_> {
    fn id(&self) -> EnvironmentId {
        EnvironmentId::Member(self.member.number())
    }

    fn runs(&self) -> usize {
        self.starts.len()
    }

    fn inputs(&self) -> Fingerprint {
        self.options.inputs.clone()
    }

    fn stream(&self, run: usize) -> Result<RunStream, SweepError> {
        let RolloutOptions { steps, weights, seed, .. } = &self.options;
        let seed = rollout_seed(*seed, self.member.number(), run);
        let rollout = rollout(&self.member, &self.starts[run], *steps, *weights, seed);
        Ok(RunStream::complete(rollout.stream(self.states), rollout.rows()[0]))
    }
}
