//! Exact search for the nearest sources of states that the tables do not contain.

use std::ops::Range;

use calib_core::{Monitor, RowIndex, States, TransitionIndex};
use calib_files::ScratchPlace;

use crate::{
    IndexKind, KnnError, KnnModel, Member, MemoryNeed, ModelConfig, Neighbor,
    index::{NeighborLists, Queries, Sources},
    parts::PART_QUERIES,
};

impl KnnModel {
    /// Returns the `k` nearest sources in every member for each of `states`, which were not recorded with the sources: `[member][query]`.
    /// The search is exact. It does not find candidates that the member leaves out.
    ///
    /// One search serves all members. Its large arrays are in `place`. Lists are shorter than `k` only if the member is. Progress counts
    /// passes over the sources, then queries.
    ///
    /// # Errors
    /// If `k` is zero, the states have another number of columns than the model's, a member has no transitions, there is no place for the
    /// arrays, or the monitor interrupts.
    pub fn nearest_sources(
        &self,
        states: &States,
        k: usize,
        place: &ScratchPlace,
        monitor: &dyn Monitor,
    ) -> Result<Vec<Vec<Vec<Neighbor>>>, KnnError> {
        let sources = self.sources();
        let left_out = self.left_out_for_all();
        let queries = Queries::external(&sources, states, None)?.without(&left_out);
        search(self, &sources, &queries, 0..self.members(), k, place, monitor)
    }

    /// Returns the maximum memory of such a search for `k` sources with `threads` threads.
    ///
    /// It does not depend on how the tables were built. Other states are searched among all sources, in all columns of the metric, with the
    /// structure that suits them.
    pub fn search_need(&self, k: usize, threads: usize) -> MemoryNeed {
        let config =
            ModelConfig { members: self.members(), neighbors: k, ..ModelConfig::default() };
        MemoryNeed::predict(self.states().rows(), self.states().columns(), &config, threads)
    }
}

impl Member<'_> {
    /// Returns the `k` nearest sources in the member for each of the recorded `rows`, by exact search with large arrays in `place`.
    ///
    /// The exclusion of the model applies, as in the tables. The search does not find candidates that the member leaves out. Lists are
    /// shorter than `k`, or empty, only where fewer sources are admissible. Progress is that of [`KnnModel::nearest_sources`].
    ///
    /// # Errors
    /// If `k` is zero, the member has no transitions, there is no place for the arrays, or the monitor interrupts.
    ///
    /// # Panics
    /// If a row is not a row of the data.
    pub fn nearest_to_rows(
        &self,
        rows: &[RowIndex],
        k: usize,
        place: &ScratchPlace,
        monitor: &dyn Monitor,
    ) -> Result<Vec<Vec<Neighbor>>, KnnError> {
        let sources = self.model().sources();
        let left_out = self.model().left_out_for_all();
        let queries = Queries::rows(&sources, rows, self.number(), self.model().exclusion());
        let queries = queries.without(&left_out);
        self.search(&sources, &queries, k, place, monitor)
    }

    /// Returns the `k` nearest sources in the member for each of `states`, which were not recorded with the sources, by exact search in
    /// memory. The search does not find candidates that the member leaves out.
    ///
    /// Lists are shorter than `k` only if the member is, and never empty.
    ///
    /// # Errors
    /// If `k` is zero, the states have another number of columns than the model's, the member has no transitions, there is no memory for
    /// the lists, or the monitor interrupts.
    pub fn nearest_sources(
        &self,
        states: &States,
        k: usize,
        monitor: &dyn Monitor,
    ) -> Result<Vec<Vec<Neighbor>>, KnnError> {
        let sources = self.model().sources();
        let left_out = self.model().left_out_for_all();
        let queries = Queries::external(&sources, states, Some(self.number()))?.without(&left_out);
        self.search(&sources, &queries, k, &ScratchPlace::Memory, monitor)
    }

    fn search(
        &self,
        sources: &Sources<'_>,
        queries: &Queries<'_>,
        k: usize,
        place: &ScratchPlace,
        monitor: &dyn Monitor,
    ) -> Result<Vec<Vec<Neighbor>>, KnnError> {
        let members = self.number()..self.number() + 1;
        let mut lists = search(self.model(), sources, queries, members, k, place, monitor)?;
        Ok(lists.swap_remove(0))
    }
}

/// Returns the lists of these members, `[member][query]`.
fn search(
    model: &KnnModel,
    sources: &Sources<'_>,
    queries: &Queries<'_>,
    members: Range<usize>,
    k: usize,
    place: &ScratchPlace,
    monitor: &dyn Monitor,
) -> Result<Vec<Vec<Vec<Neighbor>>>, KnnError> {
    let lengths: Vec<usize> =
        members.clone().map(|member| model.blocks().member_len(member)).collect();
    if let Some(place) = lengths.iter().position(|&length| length == 0) {
        return Err(KnnError::EmptyMember { member: members.start + place });
    }
    let k = k.min(lengths.into_iter().max().unwrap_or(0));
    if k == 0 {
        return Err(KnnError::NoNeighbors);
    }
    let planned = sources.index(IndexKind::Auto, queries, k, place, monitor)?;
    monitor.begin("nearest states", queries.len() as u64);
    let mut lists = vec![vec![Vec::new(); queries.len()]; members.len()];
    for order in planned.order.chunks(PART_QUERIES) {
        let mut found = NeighborLists::with_room(order.len(), queries.members(), k)?;
        planned.index.search(queries, order, &mut found, monitor)?;
        for (lists, member) in lists.iter_mut().zip(members.clone()) {
            for (place, &query) in order.iter().enumerate() {
                let (sources, distances) = found.list(place, member);
                lists[query as usize] = sources
                    .iter()
                    .zip(distances)
                    .filter(|(transition, _)| **transition != u32::MAX)
                    .map(|(&transition, &distance)| Neighbor {
                        transition: TransitionIndex(transition),
                        distance,
                    })
                    .collect();
            }
        }
    }
    Ok(lists)
}
