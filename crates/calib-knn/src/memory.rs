use crate::{IndexKind, ModelConfig, PART_QUERIES, index};

/// The memory for building a model, in bytes, predicted from its size alone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MemoryNeed {
    /// The states, `4 n d` bytes.
    pub states: u64,
    /// All other arrays, if they are in memory.
    pub working: u64,
    /// The part of [`working`](Self::working) that cannot be put in files.
    pub least: u64,
}

/// The program without its data.
const PROGRAM: u64 = 64 << 20;
/// Maximum number of parts of a search in memory at once.
const PARTS: u64 = 5;
/// Maximum number of queries that a thread searches at once.
const QUERIES: u64 = 2048;
/// Bytes per query besides its lists: the states that it collects before it discards some.
const MET: u64 = 6 << 10;
/// The same per neighbour.
const MET_A_NEIGHBOR: u64 = 32;
/// States that a thread lays out at once: queries and sources of a scan.
const LAID_OUT: u64 = 1536;

impl MemoryNeed {
    /// Predicts the memory for a model of `rows` states with `columns` columns, and about as many transitions, that `threads` threads
    /// build.
    ///
    /// With `n` rows of `d` columns, `k` neighbours, `B` members, `T` threads and images of `w` f32 coordinates in the join (32, or for
    /// fewer columns the next multiple of 16), working memory is
    ///
    /// `n (12 + max(8 w + 32, 4 w + 84 + 8 k (B + 1))) + 40 k B min(n, 65536) + T (2048 (16 k B + 32 k + 6144) + 6144 d) + 8 d² + 64 MiB`
    ///
    /// The terms are:
    ///
    /// - timestamps and transitions (12);
    /// - the larger of two: images before and after sorting, with groups, order and boxes; or images, the order of queries, the tables, and
    ///   a copy of one table during the search for closed classes (48, if the log hardly revisits its states);
    /// - the results of up to five parts, which are searched, wait, are stored and are written;
    /// - up to 2048 queries that each thread searches at once, with their lists, the states that they have collected, and the states that a
    ///   scan lays out;
    /// - a covariance.
    ///
    /// Images and tables can be in files. Then `52 n` of the first term remains, mostly for grouping equal states, and all other terms
    /// remain. Searching in `c` principal components adds `4 c n`. Choosing prototypes by `k_centre` takes `236 n` before the images. A
    /// scan has no images. The arrays of the k-d tree cannot be in files, so `"auto"` avoids it when they should be. If the k-d tree is
    /// requested, `(8 d + 44) n` remains. The formula is derived, and checked against measurements.
    pub fn predict(rows: usize, columns: usize, config: &ModelConfig, threads: usize) -> Self {
        let n = rows as u64;
        let d = columns as u64;
        let searched = if config.components > 0 { config.components } else { columns };
        let width = match config.index {
            IndexKind::Scan => 0,
            IndexKind::Auto | IndexKind::Join | IndexKind::KdTree => {
                index::image_width(searched) as u64
            }
        };
        let tree = if config.index == IndexKind::KdTree { 8 * searched as u64 + 44 } else { 0 };
        // A `k` above the number of rows is refused, whatever memory it would take.
        let neighbors = n.min(config.neighbors as u64);
        let members = n.min(config.members as u64);
        let tables = 8_u64.saturating_mul(neighbors).saturating_mul(members);
        let most = (8 * width + 32).max(
            tables.saturating_add(8_u64.saturating_mul(neighbors)).saturating_add(4 * width + 84),
        );
        let (reduced, choosing) = config.shortcuts().bytes_a_row(columns);
        let most = most.max(choosing).saturating_add(reduced + 12);
        let parts = tables.saturating_mul(PARTS * n.min(PART_QUERIES as u64));
        let met = MET + MET_A_NEIGHBOR * neighbors;
        let queries = tables.saturating_mul(2).saturating_add(met).saturating_mul(QUERIES.min(n));
        let of_threads = queries.saturating_add(4 * LAID_OUT * d).saturating_mul(threads as u64);
        let fixed = parts.saturating_add(of_threads).saturating_add(8 * d * d + PROGRAM);
        Self {
            states: 4 * n * d,
            working: n.saturating_mul(most).saturating_add(fixed),
            least: ((52.max(tree).max(choosing) + reduced) * n).saturating_add(fixed),
        }
    }

    /// Returns the peak memory if all arrays are in memory.
    pub fn peak(&self) -> u64 {
        self.states.saturating_add(self.working)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_prediction_is_the_formula() {
        let two = 2 * (2048 * (16 * 15 + 32 * 3 + 6144) + 6144 * 142) + 8 * 142 * 142;
        let need = MemoryNeed::predict(1_000_000, 142, &ModelConfig::default(), 2);
        assert_eq!(need.states, 568_000_000);
        assert_eq!(need.working, 1_000_000 * (12 + 128 + 84 + 144) + 600 * 65_536 + two + PROGRAM);
        assert_eq!(need.least, 1_000_000 * 52 + 600 * 65_536 + two + PROGRAM);
        let scan = ModelConfig { index: IndexKind::Scan, ..ModelConfig::default() };
        let need = MemoryNeed::predict(1_000_000, 142, &scan, 2);
        assert_eq!(need.working, 1_000_000 * (12 + 84 + 144) + 600 * 65_536 + two + PROGRAM);
        let many =
            ModelConfig { neighbors: 20, index: IndexKind::KdTree, ..ModelConfig::default() };
        let need = MemoryNeed::predict(1000, 8, &many, 1);
        let fixed = 4_000_000 + 1000 * (16 * 100 + 32 * 20 + 6144) + 6144 * 8 + 8 * 64 + PROGRAM;
        assert_eq!(need.working, 1000 * (12 + 64 + 84 + 960) + fixed);
        assert_eq!(need.least, 1000 * (8 * 8 + 44) + fixed);
    }

    #[test]
    fn what_no_machine_has_is_no_small_number() {
        let config =
            ModelConfig { neighbors: usize::MAX, members: 1 << 40, ..ModelConfig::default() };
        assert_eq!(MemoryNeed::predict(4_000_000, 142, &config, 2).peak(), u64::MAX);
    }
}
