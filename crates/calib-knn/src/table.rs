use std::{fmt, sync::Arc};

use calib_core::{Monitor, States, TransitionIndex, Transitions};

use crate::{
    Blocks, Exclusion, IndexKind, KnnError,
    distance::stored,
    index::{NeighborIndex, Queries, Sources},
};

type Shared<T> = Arc<dyn AsRef<[T]> + Send + Sync>;

/// The neighbour table of one member, owned or mapped, cheap to clone.
///
/// Row `i` belongs to transition `i` of the data. It holds the `k` transitions of the member whose source
/// states are nearest to the next state `s'_i`, nearest first (ties by row), and the distances to them.
/// Rows of transitions that are not in the member hold `u32::MAX` and `+∞`.
#[derive(Clone)]
pub struct NeighborTable {
    neighbors: Shared<u32>,
    distances: Shared<f32>,
    k: usize,
}

impl NeighborTable {
    /// A table from its arrays, each `[t, k]` row by row.
    pub(crate) fn from_shared(neighbors: Shared<u32>, distances: Shared<f32>, k: usize) -> Self {
        Self { neighbors, distances, k }
    }

    /// Number of neighbours `k`.
    pub fn k(&self) -> usize {
        self.k
    }

    /// Number of rows `t`, one a transition of the data.
    pub fn len(&self) -> usize {
        self.neighbors().len() / self.k
    }

    /// Whether there are no rows.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Neighbour transitions, `u32 [t, k]` row by row. Take this once outside a hot loop.
    pub fn neighbors(&self) -> &[u32] {
        (*self.neighbors).as_ref()
    }

    /// Distances, `f32 [t, k]` row by row, in the units of the states.
    pub fn distances(&self) -> &[f32] {
        (*self.distances).as_ref()
    }
}

impl fmt::Debug for NeighborTable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("NeighborTable")
            .field("k", &self.k)
            .field("len", &self.len())
            .finish_non_exhaustive()
    }
}

/// Build the tables of all members in one search.
///
/// Progress counts transitions. The tables do not depend on `kind` or on the number of threads.
///
/// # Errors
/// `k` is zero or exceeds the candidates of some query, the parts disagree about the number of rows, the
/// k-d tree is asked for more columns than it supports, or the monitor interrupts.
pub fn build_tables(
    states: &States,
    transitions: &Transitions,
    blocks: &Blocks,
    k: usize,
    exclusion: Exclusion,
    kind: IndexKind,
    monitor: &dyn Monitor,
) -> Result<Vec<NeighborTable>, KnnError> {
    let sources = Sources::new(states, transitions, blocks)?;
    check_candidates(&sources, k, exclusion)?;
    // Sorting the sources takes a while too, and counts for nothing in the progress.
    monitor.begin("neighbour tables", transitions.len() as u64);
    let queries = Queries::next_states(&sources, exclusion);
    let index = sources.index(kind, &queries, k)?;
    search_tables(&*index, &queries, blocks, k, monitor)
}

/// Fill the tables from one search.
fn search_tables(
    index: &dyn NeighborIndex,
    queries: &Queries<'_>,
    blocks: &Blocks,
    k: usize,
    monitor: &dyn Monitor,
) -> Result<Vec<NeighborTable>, KnnError> {
    let cells = blocks.transitions() * k;
    let mut tables: Vec<(Vec<u32>, Vec<f32>)> = (0..blocks.members())
        .map(|_| (vec![u32::MAX; cells], vec![f32::INFINITY; cells]))
        .collect();
    let mut fill = |query: usize, lists: &crate::MemberLists| {
        for &member in lists.members() {
            let (neighbors, distances) = &mut tables[member];
            let row = query * k..(query + 1) * k;
            for ((neighbor, distance), (transition, squared)) in
                neighbors[row.clone()].iter_mut().zip(&mut distances[row]).zip(lists.of(member))
            {
                *neighbor = transition.0;
                *distance = stored(squared);
            }
        }
    };
    index.search(queries, k, &mut fill, monitor)?;
    Ok(tables
        .into_iter()
        .map(|(neighbors, distances)| {
            NeighborTable::from_shared(Arc::new(neighbors), Arc::new(distances), k)
        })
        .collect())
}

/// Every query must have `k` admissible candidates in each of its members.
fn check_candidates(sources: &Sources<'_>, k: usize, exclusion: Exclusion) -> Result<(), KnnError> {
    if k == 0 {
        return Err(KnnError::NoNeighbors);
    }
    let (transitions, blocks) = (sources.transitions(), sources.blocks());
    for member in 0..blocks.members() {
        let candidates = blocks
            .transitions_of(member)
            .map(|query: TransitionIndex| {
                let forbidden = exclusion.forbidden(transitions, transitions.next(query));
                blocks.admissible(member, &forbidden)
            })
            .min()
            .unwrap_or(0);
        if candidates < k {
            return Err(KnnError::TooFewCandidates { member, candidates, k });
        }
    }
    Ok(())
}
