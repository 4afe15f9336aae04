use std::ops::Range;

use calib_core::{RowIndex, States, TransitionIndex, Transitions};

use crate::{
    Blocks, Exclusion, KnnError, bits::Bits, candidate_mask::CandidateMask, candidates::Candidates,
    classes::Classes,
};

/// The searched set: the source state of every transition.
#[derive(Clone, Copy, Debug)]
pub struct Sources<'a> {
    pub(crate) states: &'a States,
    pub(crate) transitions: &'a Transitions,
    pub(crate) blocks: &'a Blocks,
    pub(crate) candidates: Candidates<'a>,
    /// Maximum number of leaves that a join visits; 0 for no limit.
    pub(crate) leaf_budget: usize,
    /// The states that table distances are measured in, if they differ from the searched states.
    pub(crate) measured: Option<&'a States>,
    /// The classes for each of which there are lists.
    pub(crate) classes: Classes<'a>,
}

impl<'a> Sources<'a> {
    /// Creates the sources of `transitions` in `states`.
    ///
    /// # Errors
    /// If there is not a state for each row of the transitions' segments.
    pub fn new(
        states: &'a States,
        transitions: &'a Transitions,
        blocks: &'a Blocks,
    ) -> Result<Self, KnnError> {
        let rows = transitions.segments().rows();
        if states.rows() != rows {
            return Err(KnnError::Rows { states: states.rows(), segments: rows });
        }
        Ok(Self {
            states,
            transitions,
            blocks,
            candidates: Candidates::Every(1),
            leaf_budget: 0,
            measured: None,
            classes: Classes::NONE,
        })
    }

    /// Returns the same sources in `count` classes, given the class of every transition: its action, for example. One search then
    /// finds the `k` nearest sources of every class, in every member. The list of a class and a member has number
    /// `class * members + member` in [`NeighborLists`](crate::NeighborLists).
    ///
    /// # Panics
    /// If there is not a class below `count` for each transition.
    #[must_use]
    pub fn by_class(self, classes: &'a [u16], count: usize) -> Self {
        assert_eq!(classes.len(), self.len(), "a class for each transition");
        assert!(
            classes.iter().all(|&class| usize::from(class) < count),
            "a class below the number"
        );
        Self { classes: Classes::new(classes, count), ..self }
    }

    /// Returns the number of sources that can be neighbours.
    pub(crate) fn candidates_len(&self) -> usize {
        self.candidates.before(self.len() as u32) as usize
    }

    /// Returns the number of sources, one per transition.
    pub fn len(&self) -> usize {
        self.transitions.len()
    }

    /// Whether there are no sources.
    pub fn is_empty(&self) -> bool {
        self.transitions.is_empty()
    }

    /// Returns the number of columns of a state.
    pub fn columns(&self) -> usize {
        self.states.columns()
    }

    /// Returns the source state of `transition`.
    pub(crate) fn state(&self, transition: u32) -> &'a [f32] {
        self.states.row(self.transitions.sources()[transition as usize] as usize)
    }

    /// Returns the transitions.
    pub fn transitions(&self) -> &'a Transitions {
        self.transitions
    }

    /// Returns the blocks: which member contains which transition.
    pub fn blocks(&self) -> &'a Blocks {
        self.blocks
    }
}

/// The queries of a search: states, the members whose lists are requested, and the forbidden sources.
#[derive(Clone, Copy, Debug)]
pub struct Queries<'a> {
    states: &'a States,
    sources: Sources<'a>,
    kind: Kind<'a>,
    exclusion: Exclusion,
    left_out: &'a [Bits],
    nearest: bool,
}

#[derive(Clone, Copy, Debug)]
enum Kind<'a> {
    /// Query `i` is the next state of transition `i`, for every member that contains it.
    NextStates,
    /// Recorded rows, for one member.
    Rows(&'a [RowIndex], usize),
    /// States that were not recorded with the sources, for one member or for all.
    External(Option<usize>),
}

impl<'a> Queries<'a> {
    /// Creates a query for the next state of every transition, for the tables of all members.
    pub fn next_states(sources: &Sources<'a>, exclusion: Exclusion) -> Self {
        Self::with_kind(sources, Kind::NextStates, exclusion)
    }

    /// Creates queries for recorded `rows`, for one member. If sources have classes, a query requests only the class of the transition
    /// that starts from its row.
    pub fn rows(
        sources: &Sources<'a>,
        rows: &'a [RowIndex],
        member: usize,
        exclusion: Exclusion,
    ) -> Self {
        Self::with_kind(sources, Kind::Rows(rows, member), exclusion)
    }

    fn with_kind(sources: &Sources<'a>, kind: Kind<'a>, exclusion: Exclusion) -> Self {
        Self {
            states: sources.states,
            sources: *sources,
            kind,
            exclusion,
            left_out: &[],
            nearest: false,
        }
    }

    /// Creates queries for states that were not recorded with the sources, for one member or for all. Nothing is forbidden.
    ///
    /// # Errors
    /// If the states have another number of columns than the sources.
    pub fn external(
        sources: &Sources<'a>,
        states: &'a States,
        member: Option<usize>,
    ) -> Result<Self, KnnError> {
        if states.columns() != sources.columns() {
            return Err(KnnError::Columns { expected: sources.columns(), got: states.columns() });
        }
        let kind = Kind::External(member);
        Ok(Self { states, ..Self::with_kind(sources, kind, Exclusion::default()) })
    }

    /// Returns the same queries for next states. Each also requests the nearest source of one class in one member: if a transition starts
    /// from the query's row, of the transition's class in the member that lacks its block. The query itself does not belong to
    /// that member.
    #[must_use]
    pub fn with_nearest_outside_block(self) -> Self {
        Self { nearest: true, ..self }
    }

    /// Returns the same queries, which must not find the candidates in `left_out` of each member.
    #[must_use]
    pub(crate) fn without(self, left_out: &'a [Bits]) -> Self {
        Self { left_out, ..self }
    }

    /// Returns the sources that the queries of each member can find, apart from those that are forbidden to a single query.
    pub(crate) fn findable(&self) -> CandidateMask<'a> {
        CandidateMask::new(self.sources.blocks, self.left_out)
    }

    /// Returns the number of queries.
    pub fn len(&self) -> usize {
        match self.kind {
            Kind::NextStates => self.sources.len(),
            Kind::Rows(rows, _) => rows.len(),
            Kind::External(_) => self.states.rows(),
        }
    }

    /// Returns the classes of the sources.
    pub(crate) fn classes(&self) -> Classes<'a> {
        self.sources.classes
    }

    pub(crate) fn members(&self) -> usize {
        self.sources.blocks.members()
    }

    /// Whether there are no queries.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns the row of query `query` in [`states`](Self::states).
    pub(crate) fn row(&self, query: usize) -> usize {
        self.recorded(query).map_or(query, RowIndex::get)
    }

    /// Returns the states that contain the queries as rows.
    pub(crate) fn states(&self) -> &'a States {
        self.states
    }

    /// Returns the searched set.
    pub(crate) fn sources(&self) -> &Sources<'a> {
        &self.sources
    }

    /// Whether candidates are left out. Then lists that were found before are searched again.
    pub(crate) fn are_asked_again(&self) -> bool {
        !self.left_out.is_empty()
    }

    /// Returns the sources that query `query` must not find.
    pub(crate) fn forbidden(&self, query: usize) -> Range<u32> {
        match self.recorded(query) {
            Some(row) => self.exclusion.forbidden(self.sources.transitions, row),
            None => 0..0,
        }
    }

    /// Returns the recorded row of query `query`, if it has one.
    fn recorded(&self, query: usize) -> Option<RowIndex> {
        match self.kind {
            Kind::NextStates => Some(self.sources.transitions.next(TransitionIndex::new(query))),
            Kind::Rows(rows, _) => Some(rows[query]),
            Kind::External(_) => None,
        }
    }

    /// Returns the transition that starts from the query's row, if it can be a neighbour.
    pub(crate) fn own_source(&self, query: usize) -> Option<u32> {
        let own = self.sources.transitions.starting_at(self.recorded(query)?);
        let own = own.map(|TransitionIndex(transition)| transition);
        own.filter(|&transition| self.sources.candidates.contains(transition))
    }

    /// Returns the classes whose lists query `query` requests.
    pub(crate) fn wanted_classes(&self, query: usize) -> Range<usize> {
        let classes = self.sources.classes;
        let own = match self.kind {
            Kind::Rows(..) => self.own_source(query).map(|own| classes.class(own)),
            Kind::NextStates | Kind::External(_) => None,
        };
        own.map_or(0..classes.count(), |own| own..own + 1)
    }

    /// Returns the class and the member whose nearest source query `query` requests besides its lists.
    pub(crate) fn wanted_nearest(&self, query: usize) -> Option<(usize, usize)> {
        let own = self.own_source(query).filter(|_| self.nearest)?;
        let member = self.sources.blocks.block_of(TransitionIndex(own));
        Some((self.sources.classes.class(own), member))
    }

    /// Returns the transition that starts from the query's row, or the one that ends there.
    pub(crate) fn own_transition(&self, query: usize) -> Option<u32> {
        let row = self.recorded(query)?;
        let transitions = self.sources.transitions;
        let own = transitions.starting_at(row).or_else(|| transitions.ending_in(row));
        own.map(|TransitionIndex(transition)| transition)
    }

    /// Returns up to `2 * count` sources outside the forbidden range whose transitions are nearest in time.
    pub(crate) fn near_in_time(
        &self,
        query: usize,
        count: usize,
    ) -> impl Iterator<Item = u32> + use<'a> {
        let count = count as u32;
        let candidates = self.sources.candidates;
        let forbidden = self.forbidden(query);
        let around = match self.own_transition(query) {
            Some(_) if !forbidden.is_empty() => forbidden.clone(),
            Some(own) => own..own,
            None => 0..0,
        };
        let (before, after) = if self.own_transition(query).is_some() {
            let start = candidates.before(around.start);
            let end = candidates.before(around.end);
            let last = self.sources.candidates_len() as u32;
            (start.saturating_sub(count)..start, end..last.min(end + count))
        } else {
            (0..0, 0..0)
        };
        before.chain(after).map(move |number| candidates.nth(number))
    }

    /// Returns the members whose lists query `query` requests.
    pub(crate) fn wanted(&self, query: usize) -> impl Iterator<Item = usize> + use<'a> {
        let blocks = self.sources.blocks;
        let (members, query) = match self.kind {
            Kind::NextStates => (0..blocks.members(), Some(TransitionIndex::new(query))),
            Kind::External(None) => (0..blocks.members(), None),
            Kind::Rows(_, member) | Kind::External(Some(member)) => (member..member + 1, None),
        };
        members.filter(move |&member| query.is_none_or(|query| blocks.contains(member, query)))
    }
}
