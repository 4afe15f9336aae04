//! Distances between two trajectories of one sensor, other than time warping, and
//! collapse.

mod autocorrelation;
mod collapse;
mod fourier;
mod spectrum;
mod wasserstein;

pub use autocorrelation::{autocorrelation, autocorrelation_distance, usual_lags};
pub use collapse::collapse_step;
pub use spectrum::{SPECTRUM_FLOOR, spectral_distance, spectrum, usual_segment};
pub use wasserstein::{increments, wasserstein};

use crate::{StatsError, error::check};

/// Checks that `values` are all finite numbers, and at least one.
fn check_finite(what: &'static str, values: &[f64]) -> Result<(), StatsError> {
    check(what, values)?;
    match values.iter().position(|value| value.is_infinite()) {
        Some(index) => Err(StatsError::Infinite { what, index }),
        None => Ok(()),
    }
}
