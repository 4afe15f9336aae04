use calib_core::Rng;

use super::errors::Errors;

/// Clusters with those of their runs that count, in any number of copies.
pub(super) type Clusters = Vec<(usize, Vec<usize>)>;

/// Which members, runs and windows count: all of them, or a resample.
///
/// The bootstrap is hierarchical: members and windows are drawn with replacement, and within each drawn one its runs. What one stream
/// has in common for all its runs is then drawn as often as there are streams, not runs (Davison & Hinkley 1997, section 3.8).
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Drawn {
    /// Members, and rollouts in each.
    pub(super) members: Clusters,
    /// Windows of the replayed log.
    pub(super) log: Vec<usize>,
    /// Held-out windows, and runs over each.
    pub(super) windows: Clusters,
}

/// How many members, runs and windows there are.
pub(super) struct Sizes {
    members: Vec<usize>,
    log: usize,
    windows: Vec<usize>,
}

impl Sizes {
    pub(super) fn of(members: &[Errors], log: Option<&Errors>, online: Option<&Errors>) -> Self {
        let runs = |of: &Errors| of.streams.iter().map(|stream| stream.runs.len()).collect();
        Self {
            members: members.iter().map(|member| member.streams.len()).collect(),
            log: log.map_or(0, |log| log.streams.len()),
            windows: online.map_or_else(Vec::new, runs),
        }
    }

    /// Everything once.
    pub(super) fn all(&self) -> Drawn {
        let whole = |sizes: &[usize]| -> Clusters {
            sizes.iter().map(|&runs| (0..runs).collect()).enumerate().collect()
        };
        Drawn {
            members: whole(&self.members),
            log: (0..self.log).collect(),
            windows: whole(&self.windows),
        }
    }

    /// A resample.
    pub(super) fn draw(&self, rng: &mut Rng) -> Drawn {
        let mut below = |n: usize| rng.below(n);
        let members = two_levels(&self.members, &mut below);
        let log = some(self.log, &mut below);
        Drawn { members, log, windows: two_levels(&self.windows, &mut below) }
    }
}

/// As many clusters as there are, and in each as many runs as it has, with replacement.
fn two_levels(sizes: &[usize], below: &mut impl FnMut(usize) -> usize) -> Clusters {
    let clusters = some(sizes.len(), below);
    clusters.into_iter().map(|cluster| (cluster, some(sizes[cluster], below))).collect()
}

fn some(count: usize, below: &mut impl FnMut(usize) -> usize) -> Vec<usize> {
    (0..count).map(|_| below(count)).collect()
}
