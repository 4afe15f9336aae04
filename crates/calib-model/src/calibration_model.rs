use std::{fmt, ops::Range};

use calib_core::{Frames, Monitor, RowIndex, Seed, States};
use calib_files::ScratchPlace;
use calib_knn::Weights;

use crate::{ModelError, ModelStart, StartSource, Trajectory};

/// A model of a plant for rollouts from recorded states. The ensemble members differ in the part of the log that they
/// were made from.
///
/// A rollout is a pure function of the model, the member, its number among the member's rollouts, its start state and a
/// [`Rolling`].
pub trait CalibrationModel: fmt::Debug + Send + Sync {
    /// Returns the number of ensemble members; 1 for a network.
    fn members(&self) -> usize;

    /// Returns `count` start states of each member, from `source`.
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

    /// Makes a rollout of `member` from each start state, in parallel; the first is number 0. Progress counts steps.
    ///
    /// # Errors
    /// If the model cannot be run from such start states, or the monitor interrupts it.
    fn roll_out(
        &self,
        member: usize,
        starts: &[ModelStart],
        rolling: &Rolling,
        monitor: &dyn Monitor,
    ) -> Result<Vec<Trajectory>, ModelError>;

    /// Returns the number of rollouts that step together: making one of them makes all.
    fn lanes(&self) -> usize;

    /// Makes the rollouts with these numbers from their start states. There are at most [`lanes`](Self::lanes), and
    /// none steps with others. They run on the calling thread alone and equal those of [`roll_out`](Self::roll_out), to
    /// the bit.
    ///
    /// # Errors
    /// If the model cannot be run from such start states.
    fn lockstep(
        &self,
        member: usize,
        numbers: Range<usize>,
        starts: &[ModelStart],
        rolling: &Rolling,
    ) -> Result<Vec<Trajectory>, ModelError>;

    /// Returns the expected next states of states that the model was not made from: one matrix `[rows, columns]` per
    /// member, in normalised units. +∞ where a prediction is not finite.
    ///
    /// # Errors
    /// If the model cannot be run from such states, or the search is interrupted.
    fn expected_next(
        &self,
        unseen: Unseen<'_>,
        weights: Weights,
        search: Search<'_>,
    ) -> Result<Vec<Vec<f64>>, ModelError>;

    /// Returns the bytes per state of a rollout.
    fn state_bytes(&self) -> u64;

    /// Returns the maximum working memory of a search for start states on `threads` threads, in bytes; 0 where nothing
    /// is searched.
    fn search_bytes(&self, threads: usize) -> u64;

    /// Returns the rows that `member` was not made from, if there are any: its own block of an ensemble that leaves
    /// blocks out.
    fn left_out_rows(&self, member: usize) -> Option<Range<usize>>;
}

/// The place of the large arrays of a search for nearest states, and its monitor.
#[derive(Clone, Copy)]
pub struct Search<'a> {
    /// Memory, or files in a folder.
    pub place: &'a ScratchPlace,
    /// The monitor of the search.
    pub monitor: &'a dyn Monitor,
}

/// The settings of rollouts.
#[derive(Clone, Copy, Debug)]
pub struct Rolling {
    /// Steps per rollout.
    pub steps: usize,
    /// Weights for drawing a neighbour. Networks draw nothing.
    pub weights: Weights,
    /// Root of the seeds: rollout `r` of member `m` has [`rollout_seed`](crate::rollout_seed).
    pub seed: Seed,
}

/// Recorded states that a model was not made from.
#[derive(Clone, Copy, Debug)]
pub struct Unseen<'a> {
    /// The recorded frames.
    pub frames: &'a Frames,
    /// The selected rows.
    pub rows: &'a [RowIndex],
    /// Their states in the metric of the model.
    pub in_metric: &'a States,
}

impl fmt::Debug for Search<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Search").field("place", self.place).finish_non_exhaustive()
    }
}
