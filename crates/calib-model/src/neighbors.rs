use std::ops::Range;

use calib_core::{Monitor, Seed, States, TransitionIndex};
use calib_knn::{KnnModel, Weights};

use crate::{
    CalibrationModel, ModelError, ModelStart, Rolling, Search, StartSource, StartState, Trajectory,
    Unseen, rollout, rollout_seed, rollouts, start_states_of_all,
};

/// An ensemble of neighbour tables: its rollouts visit recorded rows, and never leave the data.
#[derive(Debug)]
pub struct NeighborModel {
    knn: KnnModel,
    recorded: States,
}

impl NeighborModel {
    /// Returns the model of the tables `knn` over the recorded states. `knn` compares these states or a
    /// representation of them.
    pub fn new(knn: KnnModel, recorded: States) -> Self {
        Self { knn, recorded }
    }

    /// Returns the tables.
    pub fn knn(&self) -> &KnnModel {
        &self.knn
    }
}

/// Returns the start state, if it belongs to a neighbour model.
fn searched(start: &ModelStart) -> Result<&StartState, ModelError> {
    match start {
        ModelStart::State(start) => Ok(start),
        ModelStart::Row(_) => Err(ModelError::OtherStart),
    }
}

impl CalibrationModel for NeighborModel {
    fn members(&self) -> usize {
        self.knn.members()
    }

    fn starts(
        &self,
        source: StartSource<'_>,
        count: usize,
        seed: Seed,
        Search { place, monitor }: Search<'_>,
    ) -> Result<Vec<Vec<ModelStart>>, ModelError> {
        let all = start_states_of_all(&self.knn, source, count, seed, place, monitor)?;
        Ok(all
            .into_iter()
            .map(|starts| starts.into_iter().map(ModelStart::State).collect())
            .collect())
    }

    fn roll_out(
        &self,
        member: usize,
        starts: &[ModelStart],
        rolling: &Rolling,
        monitor: &dyn Monitor,
    ) -> Result<Vec<Trajectory>, ModelError> {
        let &Rolling { steps, weights, seed } = rolling;
        let starts: Vec<StartState> =
            starts.iter().map(|start| searched(start).cloned()).collect::<Result<_, _>>()?;
        let member = self.knn.member(member);
        let all = rollouts(&member, &starts, steps, weights, seed, monitor)?;
        Ok(all.into_iter().map(Trajectory::Recorded).collect())
    }

    fn lanes(&self) -> usize {
        1
    }

    fn lockstep(
        &self,
        member: usize,
        numbers: Range<usize>,
        starts: &[ModelStart],
        &Rolling { steps, weights, seed }: &Rolling,
    ) -> Result<Vec<Trajectory>, ModelError> {
        let member = self.knn.member(member);
        numbers
            .zip(starts)
            .map(|(number, start): (usize, &ModelStart)| {
                let seed = rollout_seed(seed, member.number(), number);
                Ok(Trajectory::Recorded(rollout(&member, searched(start)?, steps, weights, seed)))
            })
            .collect()
    }

    fn expected_next(
        &self,
        unseen: Unseen<'_>,
        weights: Weights,
        Search { place, monitor }: Search<'_>,
    ) -> Result<Vec<Vec<f64>>, ModelError> {
        let expected =
            self.knn.expected_next(unseen.in_metric, &self.recorded, weights, place, monitor)?;
        Ok(expected.collect())
    }

    fn state_bytes(&self) -> u64 {
        size_of::<calib_core::RowIndex>() as u64 + size_of::<TransitionIndex>() as u64
    }

    fn search_bytes(&self, threads: usize) -> u64 {
        self.knn.search_need(self.knn.k(), threads).working
    }

    fn left_out_rows(&self, member: usize) -> Option<Range<usize>> {
        let block = self.knn.blocks().own(member);
        // A member with the whole log leaves nothing out.
        if block.is_empty() || self.knn.members() == 1 {
            return None;
        }
        let [first, last] = [block.start, block.end - 1]
            .map(|transition| self.knn.transitions().source(TransitionIndex(transition)).get());
        Some(first..last + 2)
    }
}
