/// The neighbours of some states for every action.
///
/// Row `i`, action `a` holds the up to `k` transitions with action `a` whose sources are nearest to state `i`, nearest first, and the distances;
/// places that are left hold `u32::MAX` and `+∞`.
#[derive(Clone, Debug)]
pub(crate) struct ActionTable {
    actions: usize,
    k: usize,
    neighbors: Vec<u32>,
    distances: Vec<f32>,
}

impl ActionTable {
    /// A table of nothing yet.
    pub(crate) fn new(rows: usize, actions: usize, k: usize) -> Self {
        let cells = rows * actions * k;
        Self { actions, k, neighbors: vec![u32::MAX; cells], distances: vec![f32::INFINITY; cells] }
    }

    /// Put a list in its place.
    pub(crate) fn put(&mut self, row: usize, action: usize, list: (&[u32], &[f32])) {
        let start = (row * self.actions + action) * self.k;
        self.neighbors[start..start + self.k].copy_from_slice(list.0);
        self.distances[start..start + self.k].copy_from_slice(list.1);
    }

    /// The neighbours of state `row` for `action`, and their distances.
    pub(crate) fn of(&self, row: usize, action: usize) -> (&[u32], &[f32]) {
        let start = (row * self.actions + action) * self.k;
        let neighbors = &self.neighbors[start..start + self.k];
        let there = neighbors.partition_point(|&of| of != u32::MAX);
        (&neighbors[..there], &self.distances[start..start + there])
    }
}
