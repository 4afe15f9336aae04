use std::{
    fmt,
    sync::{Arc, mpsc},
    thread,
};

use calib_core::{Monitor, States, TransitionIndex, Transitions};
use calib_files::{Scratch, ScratchPlace};
use rayon::prelude::*;

use crate::{
    Blocks, Exclusion, IndexKind, KnnError, Parts,
    candidates::Candidates,
    index::{NeighborLists, Planned, Queries, Sources},
    parts::PART_QUERIES,
};

type Shared<T> = Arc<dyn AsRef<[T]> + Send + Sync>;

/// The neighbour table of one member, owned or mapped, and cheap to clone.
///
/// Row `i` belongs to transition `i` of the data. It contains the `k` transitions of the member whose source states are
/// nearest to the next state `s'_i`, nearest first (ties by row), and their distances. Rows of transitions outside the
/// member contain `u32::MAX` and `+∞`.
#[derive(Clone)]
pub struct NeighborTable {
    neighbors: Shared<u32>,
    distances: Shared<f32>,
    k: usize,
}

impl NeighborTable {
    /// Creates a table from its arrays, each `[t, k]` row by row.
    pub(crate) fn from_shared(neighbors: Shared<u32>, distances: Shared<f32>, k: usize) -> Self {
        Self { neighbors, distances, k }
    }

    pub(crate) fn empty(k: usize) -> Self {
        Self { neighbors: Arc::new(Vec::new()), distances: Arc::new(Vec::new()), k }
    }

    /// Returns the number of neighbours `k`.
    pub fn k(&self) -> usize {
        self.k
    }

    /// Returns the number of rows `t`, one per transition of the data.
    pub fn len(&self) -> usize {
        self.neighbors().len() / self.k
    }

    /// Whether there are no rows.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns the neighbour transitions, `u32 [t, k]` row by row. In a hot loop, call this once before the loop.
    pub fn neighbors(&self) -> &[u32] {
        (*self.neighbors).as_ref()
    }

    /// Returns the distances, `f32 [t, k]` row by row, in the units of the states.
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

/// A table under construction: neighbours and distances.
pub(crate) type Filling = (Scratch<u32>, Scratch<f32>);

/// The storage that a build uses.
#[derive(Clone, Debug, Default)]
pub struct Workplace {
    /// The place of its large arrays: images and tables.
    pub scratch: ScratchPlace,
    /// The partial results, so that an interrupted build can resume. `None` stores nothing.
    pub parts: Option<Parts>,
}

/// Builds the tables of all members in one search, in memory.
///
/// Progress counts passes over the sources, then transitions. The tables do not depend on `kind` or on the number of
/// threads.
///
/// # Errors
/// `k` is zero or exceeds the candidates of some query, the parts disagree about the number of rows, the k-d tree is
/// asked for more columns than it supports, or the monitor interrupts.
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
    let workplace = Workplace::default();
    let (tables, _) = find_tables(&sources, k, exclusion, kind, &workplace, monitor)?;
    Ok(finished(tables, k))
}

/// Finds the tables as [`build_tables`], in `workplace`. Returns the tables, which can still be changed, and the
/// structure that found them.
pub(crate) fn find_tables<'a>(
    sources: &Sources<'a>,
    k: usize,
    exclusion: Exclusion,
    kind: IndexKind,
    workplace: &Workplace,
    monitor: &dyn Monitor,
) -> Result<(Vec<Filling>, Planned<'a>), KnnError> {
    let transitions = sources.transitions;
    let blocks = sources.blocks;
    check_candidates(transitions, blocks, sources.candidates, k, exclusion)?;
    let queries = Queries::next_states(sources, exclusion);
    let planned = sources.index(kind, &queries, k, &workplace.scratch, monitor)?;
    let tables = fill(&planned, &queries, k, workplace, monitor)?;
    Ok((tables, planned))
}

/// Returns the final tables of `k` neighbours.
pub(crate) fn finished(tables: Vec<Filling>, k: usize) -> Vec<NeighborTable> {
    tables
        .into_iter()
        .map(|(neighbors, distances)| {
            NeighborTable::from_shared(Arc::new(neighbors), Arc::new(distances), k)
        })
        .collect()
}

/// Searches part by part. A second thread stores the results of one part while the next part is searched.
fn fill(
    planned: &Planned<'_>,
    queries: &Queries<'_>,
    k: usize,
    workplace: &Workplace,
    monitor: &dyn Monitor,
) -> Result<Vec<Filling>, KnnError> {
    let members = queries.members();
    let order = &planned.order[..];
    let part = workplace.parts.as_ref().map_or(PART_QUERIES, Parts::queries);
    // A search that fits in one part is not stored, because searching again is faster than writing.
    let kept = workplace.parts.as_ref().filter(|_| order.len() > part);
    let kept = kept.map(|parts| parts.open(order, members, k)).transpose()?;
    monitor.begin("neighbour tables", order.len() as u64);
    let mut tables = (0..members)
        .map(|_| new_table(queries.len() * k, &workplace.scratch))
        .collect::<Result<Vec<Filling>, KnnError>>()?;
    let (send, receive) = mpsc::sync_channel::<(usize, NeighborLists, Origin)>(1);
    let (searched, stored) = thread::scope(|scope| {
        let tables = &mut tables;
        let kept = &kept;
        let storing = scope.spawn(move || -> Result<(), KnnError> {
            for (number, found, origin) in receive {
                let order = &order[number * part..][..found.len()];
                tables.iter_mut().enumerate().for_each(|(member, table)| {
                    put(table, member, order, &found);
                });
                // The last part is stored too. It is needed until the model is complete.
                if let (Some(kept), Origin::Search) = (kept, origin) {
                    kept.write(number, &found)?;
                }
            }
            Ok(())
        });
        let searched = (|| -> Result<(), KnnError> {
            for (number, order) in order.chunks(part).enumerate() {
                let read = kept.as_ref().and_then(|kept| kept.read(number, order.len()));
                let (found, origin) = if let Some(found) = read {
                    monitor.check()?;
                    monitor.advance(order.len() as u64);
                    (found, Origin::File)
                } else {
                    let mut found = NeighborLists::new(order.len(), members, k);
                    planned.index.search(queries, order, &mut found, monitor)?;
                    found.measure(queries, order);
                    (found, Origin::Search)
                };
                if send.send((number, found, origin)).is_err() {
                    // The other thread has failed, and reports why.
                    break;
                }
            }
            Ok(())
        })();
        drop(send);
        (searched, storing.join().expect("the storing thread does not panic"))
    });
    stored?;
    searched?;
    Ok(tables)
}

/// The origin of the lists of a part.
enum Origin {
    Search,
    File,
}

fn new_table(cells: usize, place: &ScratchPlace) -> Result<Filling, KnnError> {
    Ok((Scratch::zeroed(cells, place)?, Scratch::zeroed(cells, place)?))
}

/// Stores the lists of the queries `order` in their rows.
fn put(table: &mut Filling, member: usize, order: &[u32], found: &NeighborLists) {
    let neighbors = &mut table.0[..];
    let distances = &mut table.1[..];
    let k = found.k();
    for (place, &query) in order.iter().enumerate() {
        let list = found.list(place, member);
        neighbors[query as usize * k..][..k].copy_from_slice(list.0);
        distances[query as usize * k..][..k].copy_from_slice(list.1);
    }
}

/// Checks that every query has `k` admissible candidates in each of its members.
///
/// A member passes at once if it has `k` candidates beyond the largest possible exclusion of a query. Otherwise all
/// queries are checked, in parallel.
pub(crate) fn check_candidates(
    transitions: &Transitions,
    blocks: &Blocks,
    candidates: Candidates<'_>,
    k: usize,
    exclusion: Exclusion,
) -> Result<(), KnnError> {
    if k == 0 {
        return Err(KnnError::NoNeighbors);
    }
    let most_forbidden = candidates.most_in(exclusion.most_forbidden());
    for member in 0..blocks.members() {
        if blocks.admissible(member, &(0..0), candidates) >= k.saturating_add(most_forbidden) {
            continue;
        }
        let least = (0..blocks.transitions() as u32)
            .into_par_iter()
            .map(TransitionIndex)
            .filter(|&query| blocks.contains(member, query))
            .map(|query| {
                let forbidden = exclusion.forbidden(transitions, transitions.next(query));
                blocks.admissible(member, &forbidden, candidates)
            })
            .min()
            .unwrap_or(0);
        if least < k {
            return Err(KnnError::TooFewCandidates { member, candidates: least, k });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use calib_core::Segments;
    use proptest::prelude::*;

    use super::*;
    use crate::SelfMatch;

    proptest! {
        #[test]
        fn the_worst_off_query_decides(
            lengths in proptest::collection::vec(2_usize..12, 1..6),
            members in 2_usize..4,
            k in 1_usize..12,
            every in 1_u32..4,
            theiler in 0_u32..6,
            excluded: bool,
        ) {
            let transitions = Transitions::new(Segments::from_lengths(lengths).expect("valid"));
            prop_assume!(transitions.len() >= members);
            let blocks = Blocks::new(&transitions, members).expect("enough transitions");
            let self_match = if excluded { SelfMatch::Excluded } else { SelfMatch::Allowed };
            let exclusion = Exclusion { self_match, theiler };
            let worst = (0..members).map(|member| {
                let found = blocks.transitions_of(member).map(|query| {
                    let forbidden = exclusion.forbidden(&transitions, transitions.next(query));
                    blocks
                        .transitions_of(member)
                        .filter(|j| j.0.is_multiple_of(every) && !forbidden.contains(&j.0))
                        .count()
                });
                found.min().unwrap_or(0)
            });
            let expected = worst.enumerate().find(|&(_, least)| least < k);
            let chosen: Vec<u32> =
                (0..transitions.len() as u32).filter(|j| j.is_multiple_of(every)).collect();
            for candidates in [Candidates::Every(every), Candidates::Chosen(&chosen)] {
                let found = check_candidates(&transitions, &blocks, candidates, k, exclusion);
                let found = match found {
                    Ok(()) => None,
                    Err(KnnError::TooFewCandidates { member, candidates, .. }) => {
                        Some((member, candidates))
                    }
                    Err(error) => panic!("{error}"),
                };
                prop_assert_eq!(found, expected);
            }
        }
    }
}
