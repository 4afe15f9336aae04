//! Computes dynamic time warping.

use std::sync::Arc;

use calib_core::Monitor as _;
use calib_dtw::{Dtw, Ends, LocalDistance, Series, Settings, StepPattern, Window};
use pyo3::prelude::*;

use crate::{
    array::{copied, owned, require_memory},
    errors,
    observer::WatchMonitor,
    work::{Needs, watched},
};

/// Raw distance, normalised distance, last matched sample of the reference, and the path `int64 [2, p]` if it was
/// requested.
type Warped<'py> = (f64, Option<f64>, usize, Option<Bound<'py, PyAny>>);

/// Returns the distance between `query` `[n]` or `[n, c]` and `reference` `[m]` or `[m, c]`.
#[pyfunction]
#[pyo3(signature = (query, reference, step_pattern, local_distance, window, ends, path))]
#[expect(clippy::too_many_arguments, reason = "what defines a distance")]
pub(crate) fn dtw<'py>(
    py: Python<'py>,
    query: &Bound<'py, PyAny>,
    reference: &Bound<'py, PyAny>,
    step_pattern: &str,
    local_distance: &str,
    window: &str,
    ends: &str,
    path: bool,
) -> PyResult<Warped<'py>> {
    let pattern: StepPattern = step_pattern.parse().map_err(|error| refused(&error))?;
    let local_distance: LocalDistance = local_distance.parse().map_err(|error| refused(&error))?;
    let window: Window = window.parse().map_err(|error| refused(&error))?;
    let ends: Ends = ends.parse().map_err(|error| refused(&error))?;
    let dtw = Dtw::with_settings(pattern, Settings { local_distance, window, ends });
    let series = [(query, "query"), (reference, "reference")];
    let [query, reference] = series.map(|(values, name)| copied::<f64>(values, name, &[1, 2]));
    let query = query?;
    let reference = reference?;
    if path {
        let needed = dtw.path_bytes(query.1[0], reference.1[0]);
        // Python gets a second copy of the path, as positions.
        let needed = needed.saturating_mul(2);
        require_memory(needed, "the path", "shorten the series, or ask for the distance alone")?;
    }
    let warped = watched(py, Needs::Threads, None, |watch| {
        let monitor = WatchMonitor(Arc::clone(watch));
        let query = Series::with_channels(&query.0, channels(&query.1))?;
        let reference = Series::with_channels(&reference.0, channels(&reference.1))?;
        if path {
            let aligned = dtw.align_until(query, reference, &|| monitor.interrupted())?;
            Ok((aligned.distance, Some(aligned.path)))
        } else {
            let distance = dtw.distance_until(query, reference, &|| monitor.interrupted());
            distance.map(|distance| (distance, None))
        }
    })?;
    let (distance, path) = warped.map_err(|error: calib_dtw::DtwError| refused(&error))?;
    let path = path.map(|path| {
        let count = path.len();
        let queries = path.iter().map(|(query, _)| *query as i64);
        let both = queries.chain(path.iter().map(|(_, reference)| *reference as i64)).collect();
        owned(py, both, &[2, count])
    });
    Ok((distance.raw, distance.normalised, distance.end, path.transpose()?))
}

fn refused(error: &dyn std::error::Error) -> PyErr {
    errors::value(error.to_string())
}

/// Returns the number of channels of a series of this shape, `[n]` or `[n, c]`.
fn channels(shape: &[usize]) -> usize {
    shape.get(1).copied().unwrap_or(1)
}
