//! Distances of trajectories other than warping, each from the crate that computes
//! it.

use calib_base::StepError;
use calib_dtw::TimeWarpEdit;
use calib_stats::{
    autocorrelation_distance, increments, spectral_distance, usual_lags, usual_segment, wasserstein,
};

/// A distance of two series of equal length, on the normalised sensor.
pub(super) struct Measure {
    /// Its column in `measures.parquet`.
    pub(super) column: &'static str,
    /// Its label for people.
    pub(super) label: &'static str,
    pub(super) distance: DistanceFunction,
}

/// The distance of a rollout and the recorded series; `None` where it is not
/// defined.
type DistanceFunction = fn(&[f64], &[f64]) -> Result<Option<f64>, StepError>;

pub(super) const MEASURES: [Measure; 5] = [
    Measure {
        column: "wasserstein",
        label: "Wasserstein distance of values",
        distance: |rollout, recorded| Ok(Some(wasserstein(rollout, recorded)?)),
    },
    Measure {
        column: "wasserstein_increments",
        label: "Wasserstein distance of changes",
        distance: |rollout, recorded| {
            Ok(Some(wasserstein(&increments(rollout), &increments(recorded))?))
        },
    },
    Measure {
        column: "autocorrelation_distance",
        label: "autocorrelation distance",
        distance: |rollout, recorded| {
            Ok(autocorrelation_distance(rollout, recorded, usual_lags(rollout.len()))?)
        },
    },
    Measure {
        column: "spectral_distance",
        label: "spectral distance (dB)",
        distance: |rollout, recorded| {
            let segment = usual_segment(rollout.len());
            segment.map(|segment| Ok(spectral_distance(rollout, recorded, segment)?)).transpose()
        },
    },
    Measure {
        column: "time_warp_edit",
        label: "time warp edit distance per sample",
        distance: |rollout, recorded| {
            let samples = (rollout.len() + recorded.len()) as f64;
            Ok(Some(TimeWarpEdit::default().distance(rollout, recorded)? / samples))
        },
    },
];
