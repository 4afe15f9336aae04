use crate::{IndexKind, ModelConfig, PART_QUERIES, index};

/// The memory that building a model takes, in bytes, predicted from its size alone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MemoryNeed {
    /// The states, `4 n d`.
    pub states: u64,
    /// Everything else, if it is in memory.
    pub working: u64,
    /// The part of [`working`](Self::working) that cannot be put in files.
    pub least: u64,
}

/// What a program and its threads take beside its data.
const PROGRAM: u64 = 64 << 20;
/// Parts of a search that are in memory at once, at most.
const PARTS: u64 = 5;

impl MemoryNeed {
    /// The need of a model of `rows` states and about as many transitions.
    ///
    /// With `n` rows, `k` neighbours, `B` members and images of `w` f32 coordinates in the join (32, or for
    /// fewer columns the next multiple of 16), working memory is
    ///
    /// `n (12 + max(8 w + 20, 4 w + 24 + 8 k B)) + 40 k B min(n, 65536) + 64 MiB`
    ///
    /// that is timestamps and transitions (12), and the larger of: images before and after sorting, with groups, order and boxes;
    /// or images, order of queries and the tables; and what was found of up to five parts, which are searched, wait, are put in
    /// their places and written. Images and tables can be in files; then `52 n`, the parts and 64 MiB are left, most of it
    /// for finding equal states. Searching in `c` principal components adds `4 c n`, and choosing prototypes by `k_centre` takes
    /// `236 n` before the images. A scan has no images. The k-d tree has 8 columns at most, which are counted as images.
    /// Derived, and checked against measurements.
    pub fn predict(rows: usize, columns: usize, config: &ModelConfig) -> Self {
        let n = rows as u64;
        let searched = if config.components > 0 { config.components } else { columns };
        let width = match config.index {
            IndexKind::Scan => 0,
            IndexKind::Auto | IndexKind::Join | IndexKind::KdTree => {
                index::image_width(searched) as u64
            }
        };
        // More neighbours than there are rows are refused, whatever they would take.
        let tables = 8 * n.min(config.neighbors as u64) * config.members as u64;
        let most = (8 * width + 20).max(4 * width + 24 + tables);
        let (reduced, choosing) = config.shortcuts().bytes_a_row(columns);
        let most = most.max(choosing) + reduced;
        let parts = PARTS * tables * n.min(PART_QUERIES as u64);
        Self {
            states: 4 * n * columns as u64,
            working: n * (12 + most) + parts + PROGRAM,
            least: (52.max(choosing) + reduced) * n + parts + PROGRAM,
        }
    }

    /// The peak if everything is in memory.
    pub fn peak(&self) -> u64 {
        self.states + self.working
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_prediction_is_the_formula() {
        let need = MemoryNeed::predict(1_000_000, 142, &ModelConfig::default());
        assert_eq!(need.states, 568_000_000);
        assert_eq!(need.working, 1_000_000 * (12 + 276) + 600 * 65_536 + PROGRAM);
        let scan = ModelConfig { index: IndexKind::Scan, ..ModelConfig::default() };
        let need = MemoryNeed::predict(1_000_000, 142, &scan);
        assert_eq!(need.working, 1_000_000 * (12 + 24 + 120) + 600 * 65_536 + PROGRAM);
        let many = ModelConfig { neighbors: 20, ..ModelConfig::default() };
        let need = MemoryNeed::predict(1000, 8, &many);
        assert_eq!(need.working, 1000 * (12 + 64 + 24 + 800 + 4000) + PROGRAM);
    }
}
