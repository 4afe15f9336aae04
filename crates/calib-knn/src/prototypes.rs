//! The choice of prototypes that cover the states: local k-centre selection.

use calib_core::Monitor;
use rayon::prelude::*;

use crate::{
    KnnError, Sources, components::leading_components, distance::squared, groups::Groups,
    index::leaves,
};

/// Number of principal components in which clusters are made and covered.
const COMPONENTS: usize = 16;
/// Memory per row while prototypes are chosen, in bytes: components, points and sorted points, with groups and their order.
pub(crate) const CHOOSING: u64 = 3 * 4 * COMPONENTS as u64 + 44;
/// Maximum number of states in the pieces that form clusters.
const PIECE: usize = 128;
/// Minimum number of prototypes per cluster, if it is large enough.
const CENTRES: usize = 4;

/// Returns the transitions from about one distinct state in `every`, ascending, so that every other state has one of them
/// near.
///
/// The distinct states are split along their principal components into clusters of at least 128 nearby states. In each
/// cluster the state nearest to the mean is chosen first. Then the state farthest from all chosen ones is added repeatedly
/// (Gonzalez 1985, whose covering radius is at most twice the best one's). All transitions from a chosen state are kept.
/// Copies cost nothing to search, and members that lack a block have the copies in the other blocks. Progress counts sources.
///
/// # Errors
/// If the monitor interrupts.
pub(crate) fn covering(
    sources: &Sources<'_>,
    every: u32,
    monitor: &dyn Monitor,
) -> Result<Vec<u32>, KnnError> {
    monitor.begin("prototypes", sources.len() as u64);
    let groups = Groups::new(sources, monitor)?;
    let reduced = if sources.columns() > COMPONENTS {
        &leading_components(sources.states, COMPONENTS, monitor)?
    } else {
        sources.states
    };
    let width = reduced.columns();
    let mut points = Vec::with_capacity(groups.len() * width);
    for group in 0..groups.len() {
        points.extend_from_slice(reduced.row(groups.row(group)));
    }
    monitor.begin("clusters", groups.len() as u64);
    let (starts, order) = leaves(&points, width, PIECE, monitor)?;
    let leaves = (CENTRES * every as usize).div_ceil(PIECE);
    let bounds: Vec<usize> = starts.iter().step_by(leaves).map(|&start| start as usize).collect();
    let clusters: Vec<&[u32]> = (bounds.iter().enumerate())
        .map(|(number, &start)| {
            &order[start..bounds.get(number + 1).copied().unwrap_or(order.len())]
        })
        .filter(|cluster| !cluster.is_empty())
        .collect();
    let mut kept: Vec<u32> = clusters
        .par_iter()
        .flat_map_iter(|cluster| {
            let cluster = if monitor.interrupted() { &[] } else { *cluster };
            let count = cluster.len().div_ceil(every as usize);
            let taken = farthest_first(cluster, width, count, |group: u32| {
                &points[group as usize * width..][..width]
            });
            taken.into_iter().flat_map(|group| groups.transitions(group as usize))
        })
        .copied()
        .collect();
    monitor.check()?;
    kept.par_sort_unstable();
    Ok(kept)
}

/// Returns `count` of these points: the one nearest to the mean, then repeatedly the one farthest from those chosen. Of equal
/// points the first is chosen.
fn farthest_first<'a>(
    cluster: &[u32],
    width: usize,
    count: usize,
    point: impl Fn(u32) -> &'a [f32],
) -> Vec<u32> {
    let mut mean = vec![0.0_f64; width];
    for &one in cluster {
        for (sum, &value) in mean.iter_mut().zip(point(one)) {
            *sum += f64::from(value) / cluster.len() as f64;
        }
    }
    let mean: Vec<f32> = mean.into_iter().map(|value| value as f32).collect();
    // The negative sign makes the point nearest to the mean the first choice.
    let mut distances: Vec<f64> = cluster.iter().map(|&one| -squared(point(one), &mean)).collect();
    let mut taken = Vec::with_capacity(count);
    for number in 0..count.min(cluster.len()) {
        let farthest = (0..cluster.len()).fold(0, |best, next| {
            let order = distances[next].total_cmp(&distances[best]);
            if order.then(cluster[best].cmp(&cluster[next])).is_gt() { next } else { best }
        });
        taken.push(cluster[farthest]);
        for (distance, &one) in distances.iter_mut().zip(cluster) {
            let from = squared(point(one), point(cluster[farthest]));
            *distance = if number == 0 { from } else { distance.min(from) };
        }
        // A point is chosen once, even if others have the same position.
        for (distance, one) in distances.iter_mut().zip(cluster) {
            if taken.contains(one) {
                *distance = f64::NEG_INFINITY;
            }
        }
    }
    taken
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_farthest_point_is_next() {
        let points = [[0.0_f32], [1.0], [2.0], [9.0], [10.0], [2.0]];
        let all = [0, 1, 2, 3, 4, 5];
        // The mean is 4. Nearest is 2, then the farthest is 10, then 0, then those at distance one.
        let expected: [u32; 6] = [2, 4, 0, 1, 3, 5];
        for count in [3, 6] {
            let found = farthest_first(&all, 1, count, |one| &points[one as usize][..]);
            assert_eq!(found, expected[..count]);
        }
    }
}
