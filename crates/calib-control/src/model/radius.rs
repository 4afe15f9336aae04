use calib_core::{Monitor, RowIndex, TransitionIndex};
use calib_files::ScratchPlace;
use calib_knn::{Exclusion, IndexKind, NeighborLists, Queries, Sources};
use calib_stats::quantile;

use crate::ControlError;

/// Returns the radius of coverage: a quantile of the distances from recorded states to the nearest recorded state of their group, which has
/// the same action. `share` is the quantile over all transitions. The nearest state is searched outside the transition's own block.
///
/// States that are near in time are near each other whether the log covers the place or not. Blocks are the times that ensemble
/// members leave out, so these are the distances at which a member predicts what it has not seen. The radius is infinite if no
/// transition has a neighbour.
pub(super) fn radius(
    sources: &Sources<'_>,
    groups: impl Iterator<Item = Vec<u32>>,
    share: f64,
    monitor: &dyn Monitor,
) -> Result<f32, ControlError> {
    let mut distances = Vec::with_capacity(sources.len());
    for chosen in groups {
        if chosen.is_empty() {
            continue;
        }
        let among = sources.among(&chosen);
        for member in 0..sources.blocks().members() {
            let own = sources.blocks().own(member);
            let within = chosen.iter().filter(|transition| own.contains(transition));
            let rows: Vec<RowIndex> = within
                .map(|&transition| sources.transitions().source(TransitionIndex(transition)))
                .collect();
            if rows.is_empty() {
                continue;
            }
            let queries = Queries::rows(&among, &rows, member, Exclusion::default());
            let place = ScratchPlace::Memory;
            let planned = among.index(IndexKind::Auto, &queries, 1, &place, monitor)?;
            let mut found = NeighborLists::new(rows.len(), sources.blocks().members(), 1);
            planned.index.search(&queries, &planned.order, &mut found, monitor)?;
            distances.extend((0..rows.len()).map(|at| f64::from(found.list(at, member).1[0])));
        }
    }
    distances.retain(|distance| distance.is_finite());
    if distances.is_empty() {
        return Ok(f32::INFINITY);
    }
    Ok(quantile(&distances, share)? as f32)
}
