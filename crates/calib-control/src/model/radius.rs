use calib_core::{Monitor, RowIndex, TransitionIndex};
use calib_files::ScratchPlace;
use calib_knn::{Exclusion, IndexKind, NeighborIndex, NeighborLists, Queries, Sources};
use calib_stats::quantile;

use crate::{ControlError, Decisions};

/// The distances from recorded states to the nearest recorded state outside their block, with the same action if actions are given.
///
/// States that are near in time are near each other whether the log covers the place or not. Blocks are the times that ensemble
/// members leave out, so these are the distances at which a member predicts what it has not seen.
pub(super) struct Outside<'a> {
    sources: Sources<'a>,
    actions: Option<&'a Decisions>,
    /// One per transition; NaN where it was not searched yet, infinite where there is no such state.
    distances: Vec<f32>,
}

impl<'a> Outside<'a> {
    /// Creates distances that are not searched yet. `sources` has the actions of the log as classes.
    pub(super) fn new(sources: Sources<'a>, log: &'a Decisions) -> Self {
        Self { sources, actions: Some(log), distances: vec![f32::NAN; sources.len()] }
    }

    /// Finds all distances, among the states with the same action if `actions` are given.
    pub(super) fn all(
        sources: Sources<'a>,
        actions: Option<&'a Decisions>,
        monitor: &dyn Monitor,
    ) -> Result<Self, ControlError> {
        let sources = match actions {
            Some(log) => sources.by_class(log.actions(), log.levels()),
            None => sources,
        };
        let queries = Queries::next_states(&sources, Exclusion::default());
        let place = ScratchPlace::Memory;
        let planned = sources.index(IndexKind::Auto, &queries, 1, &place, monitor)?;
        let mut outside = Self { sources, actions, distances: vec![f32::NAN; sources.len()] };
        outside.add_others(&*planned.index, monitor)?;
        Ok(outside)
    }

    /// Returns the action of a transition, or 0 if the action does not matter.
    fn action(&self, transition: TransitionIndex) -> usize {
        self.actions.map_or(0, |log| usize::from(log.actions()[transition.get()]))
    }

    /// Adds the distance of the transition that starts where `transition` ends, from the lists of that state.
    pub(super) fn add_next_of(&mut self, transition: TransitionIndex, lists: ActionLists<'_>) {
        let transitions = self.sources.transitions();
        if let Some(own) = transitions.starting_at(transitions.next(transition)) {
            let member = self.sources.blocks().block_of(own);
            self.distances[own.get()] = lists.list(self.action(own), member).1[0];
        }
    }

    /// Finds the distances that are not known yet.
    pub(super) fn add_others(
        &mut self,
        index: &dyn NeighborIndex,
        monitor: &dyn Monitor,
    ) -> Result<(), ControlError> {
        let transitions = self.sources.transitions();
        let members = self.sources.blocks().members();
        let actions = self.actions.map_or(1, Decisions::levels);
        for member in 0..members {
            let own = self.sources.blocks().own(member).map(TransitionIndex);
            let missing: Vec<TransitionIndex> =
                own.filter(|transition| self.distances[transition.get()].is_nan()).collect();
            if missing.is_empty() {
                continue;
            }
            let rows: Vec<RowIndex> = missing.iter().map(|&own| transitions.source(own)).collect();
            let queries = Queries::rows(&self.sources, &rows, member, Exclusion::default());
            let order = index.order(&queries);
            let mut found = NeighborLists::new(rows.len(), actions * members, 1);
            index.search(&queries, &order, &mut found, monitor)?;
            for (at, &query) in order.iter().enumerate() {
                let transition = missing[query as usize];
                let lists = ActionLists { found: &found, at, members };
                let nearest = lists.list(self.action(transition), member).1[0];
                self.distances[transition.get()] = nearest;
            }
        }
        Ok(())
    }

    /// Returns the radius of coverage: the quantile `share` of the distances, over all transitions that have one. It is infinite if there
    /// is none.
    pub(super) fn radius(&self, share: f64) -> Result<f32, ControlError> {
        let finite = self.distances.iter().filter(|distance| distance.is_finite());
        let distances: Vec<f64> = finite.map(|&distance| f64::from(distance)).collect();
        if distances.is_empty() {
            return Ok(f32::INFINITY);
        }
        Ok(quantile(&distances, share)? as f32)
    }
}

/// The lists of one query for every action.
#[derive(Clone, Copy)]
pub(super) struct ActionLists<'a> {
    pub(super) found: &'a NeighborLists,
    /// The position of the query.
    pub(super) at: usize,
    pub(super) members: usize,
}

impl<'a> ActionLists<'a> {
    /// Returns the neighbours with an action in a member, and their distances.
    pub(super) fn list(self, action: usize, member: usize) -> (&'a [u32], &'a [f32]) {
        self.found.list(self.at, action * self.members + member)
    }
}
