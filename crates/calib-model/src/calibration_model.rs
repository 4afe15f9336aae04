use std::{fmt, ops::Range};

use calib_core::{Frames, Monitor, RowIndex, Seed, States};
use calib_files::ScratchPlace;
use calib_knn::Weights;

use crate::{ModelError, ModelStart, StartSource, Trajectory};

/// A model of a plant that starts from recorded states and is rolled out from them, with members that differ by what they
/// were made from.
///
/// A rollout is a pure function of the model, the member, its number among the member's, its start and a [`Rolling`].
pub trait CalibrationModel: fmt::Debug + Send + Sync {
    /// Members of the ensemble; 1 of a network.
    fn members(&self) -> usize;

    /// `count` start states of each member, as `source` says.
    ///
    /// # Errors
    /// If the source has no rows or names rows that do not exist, or nothing is found; if a search has no place for its
    /// arrays, or is interrupted.
    fn starts(
        &self,
        source: StartSource<'_>,
        count: usize,
        seed: Seed,
        search: Search<'_>,
    ) -> Result<Vec<Vec<ModelStart>>, ModelError>;

    /// A rollout of `member` from each start, in parallel; the first is number 0. Progress counts steps.
    ///
    /// # Errors
    /// If the model cannot be run from such starts, or the monitor interrupts it.
    fn roll_out(
        &self,
        member: usize,
        starts: &[ModelStart],
        rolling: &Rolling,
        monitor: &dyn Monitor,
    ) -> Result<Vec<Trajectory>, ModelError>;

    /// Rollouts that step together: making one of them makes all.
    fn lanes(&self) -> usize;

    /// The rollouts with these numbers from their starts, at most [`lanes`](Self::lanes) and none that steps with others, on the
    /// calling thread alone: those of [`roll_out`](Self::roll_out), to the bit.
    ///
    /// # Errors
    /// If the model cannot be run from such starts.
    fn lockstep(
        &self,
        member: usize,
        numbers: Range<usize>,
        starts: &[ModelStart],
        rolling: &Rolling,
    ) -> Result<Vec<Trajectory>, ModelError>;

    /// The expected next states of states that it was not made from: one matrix `[rows, columns]` a member, in normalised
    /// units. +∞ where a prediction is not finite.
    ///
    /// # Errors
    /// If the model cannot be run from such states, or the search is interrupted.
    fn expected_next(
        &self,
        unseen: Unseen<'_>,
        weights: Weights,
        search: Search<'_>,
    ) -> Result<Vec<Vec<f64>>, ModelError>;

    /// Bytes that a state of a rollout takes.
    fn state_bytes(&self) -> u64;

    /// Bytes that a search for start states works in at most, on so many threads; 0 where nothing is searched.
    fn search_bytes(&self, threads: usize) -> u64;

    /// The rows that `member` was not made from, if there are any: its own block of an ensemble that leaves blocks out.
    fn left_out_rows(&self, member: usize) -> Option<Range<usize>>;
}

/// Where a search for nearest states has its large arrays, and who watches it.
#[derive(Clone, Copy)]
pub struct Search<'a> {
    /// Memory, or files in a folder.
    pub place: &'a ScratchPlace,
    /// Who watches.
    pub monitor: &'a dyn Monitor,
}

/// How rollouts are made.
#[derive(Clone, Copy, Debug)]
pub struct Rolling {
    /// Steps of each.
    pub steps: usize,
    /// How a neighbour is drawn; networks draw nothing.
    pub weights: Weights,
    /// Root of the seeds: rollout `r` of member `m` has [`rollout_seed`](crate::rollout_seed).
    pub seed: Seed,
}

/// Some recorded states that a model was not made from.
#[derive(Clone, Copy, Debug)]
pub struct Unseen<'a> {
    /// What was recorded.
    pub frames: &'a Frames,
    /// The rows in question.
    pub rows: &'a [RowIndex],
    /// Their states in the metric of the model.
    pub in_metric: &'a States,
}

impl fmt::Debug for Search<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Search").field("place", self.place).finish_non_exhaustive()
    }
}
