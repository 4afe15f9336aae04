use std::sync::Arc;

/// Numbers in memory or in a mapped file.
pub(crate) type Shared<T> = Arc<dyn AsRef<[T]> + Send + Sync>;

/// The neighbours of states for every action.
///
/// Row `i`, action `a` holds up to `k` transitions with action `a` whose sources are nearest to state `i`, nearest first, and their
/// distances. Unused places hold `u32::MAX` and `+∞`.
#[derive(Clone)]
pub(crate) struct ActionTable {
    actions: usize,
    k: usize,
    neighbors: Shared<u32>,
    distances: Shared<f32>,
}

impl ActionTable {
    /// Returns a table of these arrays, `[rows × actions, k]` each.
    pub(crate) fn from_shared(
        actions: usize,
        k: usize,
        neighbors: Shared<u32>,
        distances: Shared<f32>,
    ) -> Self {
        Self { actions, k, neighbors, distances }
    }

    /// Returns the number of neighbours per state and action.
    pub(crate) fn k(&self) -> usize {
        self.k
    }

    /// Returns all neighbours, `[rows × actions, k]`.
    pub(crate) fn neighbors(&self) -> &[u32] {
        (*self.neighbors).as_ref()
    }

    /// Returns all distances, `[rows × actions, k]`.
    pub(crate) fn distances(&self) -> &[f32] {
        (*self.distances).as_ref()
    }

    /// Returns the neighbours of state `row` for `action`, and their distances.
    pub(crate) fn list(&self, row: usize, action: usize) -> (&[u32], &[f32]) {
        let start = (row * self.actions + action) * self.k;
        let neighbors = &self.neighbors()[start..start + self.k];
        let there = neighbors.partition_point(|&neighbor| neighbor != u32::MAX);
        (&neighbors[..there], &self.distances()[start..start + there])
    }
}

impl std::fmt::Debug for ActionTable {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { actions, k, .. } = self;
        f.debug_struct("ActionTable")
            .field("actions", actions)
            .field("k", k)
            .finish_non_exhaustive()
    }
}

/// A table during its build.
pub(crate) struct FillingTable {
    actions: usize,
    k: usize,
    neighbors: Vec<u32>,
    distances: Vec<f32>,
}

impl FillingTable {
    /// Returns an empty table.
    pub(crate) fn new(rows: usize, actions: usize, k: usize) -> Self {
        let cells = rows * actions * k;
        Self { actions, k, neighbors: vec![u32::MAX; cells], distances: vec![f32::INFINITY; cells] }
    }

    /// Writes a list to its place.
    pub(crate) fn put(&mut self, row: usize, action: usize, list: (&[u32], &[f32])) {
        let start = (row * self.actions + action) * self.k;
        self.neighbors[start..start + self.k].copy_from_slice(list.0);
        self.distances[start..start + self.k].copy_from_slice(list.1);
    }

    /// Writes the lists of every action to their places.
    pub(crate) fn put_all<'l>(
        &mut self,
        row: usize,
        list: impl Fn(usize) -> (&'l [u32], &'l [f32]),
    ) {
        for action in 0..self.actions {
            self.put(row, action, list(action));
        }
    }

    /// Returns the finished table.
    pub(crate) fn finished(self) -> ActionTable {
        let neighbors = Arc::new(self.neighbors);
        let distances = Arc::new(self.distances);
        ActionTable::from_shared(self.actions, self.k, neighbors, distances)
    }
}
