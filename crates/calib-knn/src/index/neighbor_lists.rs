use rayon::prelude::*;

use crate::{
    KnnError, Lists, Queries,
    distance::{squared, stored},
};

/// The search results for some queries: `[query, member, k]` neighbours and their distances.
///
/// Sources in classes have a list for each class and member. Lists that were not requested, and the ends of short ones, contain `u32::MAX` and `+∞`.
#[derive(Clone, Debug, PartialEq)]
pub struct NeighborLists {
    members: usize,
    k: usize,
    neighbors: Vec<u32>,
    distances: Vec<f32>,
}

/// Returns a vector of `cells` copies of `value`.
///
/// # Errors
/// [`KnnError::Memory`] if there is not enough memory.
pub(crate) fn filled<T: Copy>(cells: usize, value: T) -> Result<Vec<T>, KnnError> {
    let mut all = Vec::new();
    let bytes = cells.saturating_mul(size_of::<T>());
    all.try_reserve_exact(cells).map_err(|_| KnnError::Memory { bytes })?;
    all.resize(cells, value);
    Ok(all)
}

impl NeighborLists {
    /// Creates empty lists for `queries` queries.
    pub fn new(queries: usize, members: usize, k: usize) -> Self {
        let cells = queries * members * k;
        let neighbors = vec![u32::MAX; cells];
        let distances = vec![f32::INFINITY; cells];
        Self { members, k, neighbors, distances }
    }

    /// Creates empty lists, as [`new`](Self::new).
    ///
    /// # Errors
    /// [`KnnError::Memory`] if there is not enough memory.
    pub(crate) fn with_room(queries: usize, members: usize, k: usize) -> Result<Self, KnnError> {
        let cells = queries.saturating_mul(members).saturating_mul(k);
        Ok(Self {
            members,
            k,
            neighbors: filled(cells, u32::MAX)?,
            distances: filled(cells, f32::INFINITY)?,
        })
    }

    /// Creates lists from these cells, if there are as many as `queries` queries need.
    pub(crate) fn from_cells(
        queries: usize,
        members: usize,
        k: usize,
        neighbors: Vec<u32>,
        distances: Vec<f32>,
    ) -> Option<Self> {
        let cells = queries * members * k;
        (neighbors.len() == cells && distances.len() == cells).then_some(Self {
            members,
            k,
            neighbors,
            distances,
        })
    }

    /// Returns the number of queries.
    pub fn len(&self) -> usize {
        self.neighbors.len() / self.stride()
    }

    /// Whether there are no queries.
    pub fn is_empty(&self) -> bool {
        self.neighbors.is_empty()
    }

    /// Returns the length of a full list.
    pub fn k(&self) -> usize {
        self.k
    }

    /// Returns all neighbours and all distances.
    pub(crate) fn cells(&self) -> (&[u32], &[f32]) {
        (&self.neighbors, &self.distances)
    }

    /// Returns the list of one member for the query at position `query`.
    pub fn list(&self, query: usize, member: usize) -> (&[u32], &[f32]) {
        let start = query * self.stride() + member * self.k;
        (&self.neighbors[start..start + self.k], &self.distances[start..start + self.k])
    }

    /// Replaces the distances in these results of the queries `order` by those that tables store.
    pub(crate) fn measure(&mut self, queries: &Queries<'_>, order: &[u32]) {
        let searched = queries.sources();
        if let Some(states) = searched.measured {
            let sources = searched.transitions.sources();
            self.measure_again(|place, source| {
                let row = queries.row(order[place] as usize);
                squared(states.row(row), states.row(sources[source as usize] as usize))
            });
        }
    }

    /// Replaces the squared distances that were used for the search, and sorts each list by the new ones, ties by row.
    fn measure_again(&mut self, squared: impl Fn(usize, u32) -> f64 + Sync) {
        let stride = self.stride();
        let k = self.k.max(1);
        let queries =
            self.neighbors.par_chunks_mut(stride).zip(self.distances.par_chunks_mut(stride));
        queries.enumerate().for_each(|(place, (neighbors, distances))| {
            let lists = neighbors.chunks_exact_mut(k).zip(distances.chunks_exact_mut(k));
            for (neighbors, distances) in lists {
                let mut list: Vec<(f64, u32)> = neighbors
                    .iter()
                    .map(|&source| match source {
                        u32::MAX => (f64::INFINITY, source),
                        _ => (squared(place, source), source),
                    })
                    .collect();
                list.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
                for ((neighbor, distance), (squared, source)) in
                    neighbors.iter_mut().zip(distances).zip(list)
                {
                    *neighbor = source;
                    *distance = if source == u32::MAX { f32::INFINITY } else { stored(squared) };
                }
            }
        });
    }

    /// Returns the number of cells of one query; at least one, so that slices can be cut.
    fn stride(&self) -> usize {
        (self.members * self.k).max(1)
    }

    /// Splits the lists into consecutive pieces of `lengths` queries, which can be filled in parallel.
    pub(crate) fn pieces(
        &mut self,
        lengths: impl Iterator<Item = usize>,
    ) -> impl IndexedParallelIterator<Item = Piece<'_>> {
        let stride = self.stride();
        let k = self.k;
        let mut neighbors = &mut self.neighbors[..];
        let mut distances = &mut self.distances[..];
        let mut pieces = Vec::new();
        for length in lengths {
            let (here, rest) = neighbors.split_at_mut(length * stride);
            neighbors = rest;
            let (there, rest) = distances.split_at_mut(length * stride);
            distances = rest;
            pieces.push(Piece { stride, k, neighbors: here, distances: there });
        }
        pieces.into_par_iter()
    }
}

/// A part of a [`NeighborLists`] that one task fills.
#[derive(Debug)]
pub(crate) struct Piece<'a> {
    stride: usize,
    k: usize,
    neighbors: &'a mut [u32],
    distances: &'a mut [f32],
}

impl Piece<'_> {
    /// Stores the lists of the query at position `query` of the piece.
    pub(crate) fn store(&mut self, query: usize, lists: &impl Lists) {
        let cells = query * self.stride..(query + 1) * self.stride;
        let neighbors = &mut self.neighbors[cells.clone()];
        let distances = &mut self.distances[cells];
        lists.each(|list, position, candidate| {
            let cell = list * self.k + position;
            neighbors[cell] = candidate.transition;
            distances[cell] = stored(candidate.squared);
        });
    }
}
