//! Computes neighbour tables of arrays.

use std::sync::Arc;

use calib_core::States;
use calib_knn::{IndexKind, PointNeighbors, Points, SelfMatch};
use pyo3::prelude::*;

use crate::{
    array::{copied, owned, require_memory},
    errors,
    observer::{Watch, WatchMonitor},
    work::{Needs, watched},
};

/// Returns the `k` nearest of `points` `[n, d]` to every one of them, or to each of `queries` `[q, d]`: positions `uint32 [q, k]` and
/// Euclidean distances `float32 [q, k]`.
#[pyfunction]
#[pyo3(signature = (points, k, queries=None, exclude_self=false, index="auto", observer=None))]
pub(crate) fn knn_join<'py>(
    py: Python<'py>,
    points: &Bound<'py, PyAny>,
    k: usize,
    queries: Option<&Bound<'py, PyAny>>,
    exclude_self: bool,
    index: &str,
    observer: Option<&Bound<'py, PyAny>>,
) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
    let kind = match index {
        "auto" => IndexKind::Auto,
        "kd_tree" => IndexKind::KdTree,
        "join" => IndexKind::Join,
        "scan" => IndexKind::Scan,
        other => {
            return Err(errors::value(format!(
                "index is \"{other}\", expected \"auto\", \"kd_tree\", \"join\" or \"scan\""
            )));
        }
    };
    let (values, shape) = copied::<f32>(points, "points", &[2])?;
    let queries = queries.map(|queries| copied::<f32>(queries, "queries", &[2])).transpose()?;
    let count = queries.as_ref().map_or(shape[0], |(_, shape)| shape[0]);
    let points = Points::new(values, shape[1]).map_err(errors::unusable)?;
    // The search itself refuses a `k` beyond the number of points, whatever memory it would need.
    let needed = points.search_need(count, k.min(points.len()), rayon::current_num_threads());
    require_memory(needed, "the nearest neighbours", "lower k, or ask for fewer points at a time")?;
    let found = watched(
        py,
        Needs::Threads,
        observer,
        |watch: &Arc<Watch>| -> Result<PointNeighbors, calib_knn::KnnError> {
            let monitor = WatchMonitor(Arc::clone(watch));
            if let Some((values, shape)) = queries {
                let states = States::new(values, shape[0], shape[1])?;
                return points.nearest(&states, k, kind, &monitor);
            }
            let self_match = if exclude_self { SelfMatch::Excluded } else { SelfMatch::Allowed };
            points.join(k, self_match, kind, &monitor)
        },
    )?;
    let found = found.map_err(errors::unusable)?;
    Ok((owned(py, found.neighbors, &[count, k])?, owned(py, found.distances, &[count, k])?))
}
