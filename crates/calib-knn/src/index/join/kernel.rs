//! The inner loops, written once for every instruction set.

#![expect(
    clippy::inline_always,
    reason = "inner loops must take the instruction set of the function that calls them"
)]

use pulp::Simd;

use super::tree::LEAF;

/// Registers that a pass over lanes keeps.
const SUMS: usize = 8;
/// Coordinates between two looks at whether the rest is needed.
const HALT: usize = 8;

/// Squared distance between two boxes.
#[inline(always)]
pub(super) fn box_to_box<S: Simd>(simd: S, a: (&[f32], &[f32]), b: (&[f32], &[f32])) -> f32 {
    let (a, b) = (vectors::<S>(a), vectors::<S>(b));
    let mut sum = simd.splat_f32s(0.0);
    for ((&al, &au), (&bl, &bu)) in a.0.iter().zip(a.1).zip(b.0.iter().zip(b.1)) {
        let gap = simd.max_f32s(simd.sub_f32s(al, bu), simd.sub_f32s(bl, au));
        let gap = simd.max_f32s(gap, simd.splat_f32s(0.0));
        sum = simd.mul_add_e_f32s(gap, gap, sum);
    }
    simd.reduce_sum_f32s(sum)
}

#[inline(always)]
fn vectors<'a, S: Simd>(bounds: (&'a [f32], &'a [f32])) -> (&'a [S::f32s], &'a [S::f32s]) {
    (S::as_simd_f32s(bounds.0).0, S::as_simd_f32s(bounds.1).0)
}

/// Squared distances from a box to the lanes of `images`, `[coordinate, LANES]`, into `distances`.
/// Returns whether any is within its threshold; where none is, the distances may be too small.
#[inline(always)]
pub(super) fn box_to_lanes<S: Simd, const LANES: usize>(
    simd: S,
    bounds: (&[f32], &[f32]),
    images: &[f32],
    thresholds: &[f32; LANES],
    distances: &mut [f32; LANES],
) -> bool {
    let zero = simd.splat_f32s(0.0);
    let mut any = false;
    for first in (0..LANES).step_by(SUMS * S::F32_LANES) {
        let used = SUMS.min((LANES - first) / S::F32_LANES);
        let lanes = first..first + used * S::F32_LANES;
        let limits = S::as_simd_f32s(&thresholds[lanes.clone()]).0;
        let mut sums = [zero; SUMS];
        let mut within = false;
        let coordinates = bounds.0.chunks(HALT).zip(bounds.1.chunks(HALT));
        for ((lower, upper), images) in coordinates.zip(images.chunks(HALT * LANES)) {
            let rows = images.chunks_exact(LANES);
            for ((&lower, &upper), row) in lower.iter().zip(upper).zip(rows) {
                let (lower, upper) = (simd.splat_f32s(lower), simd.splat_f32s(upper));
                for (sum, &lane) in sums.iter_mut().zip(S::as_simd_f32s(&row[lanes.clone()]).0) {
                    let gap = simd.max_f32s(simd.sub_f32s(lower, lane), simd.sub_f32s(lane, upper));
                    let gap = simd.max_f32s(gap, zero);
                    *sum = simd.mul_add_e_f32s(gap, gap, *sum);
                }
            }
            // The least amount by which a lane is beyond its threshold.
            let mut least = simd.splat_f32s(f32::INFINITY);
            for (&sum, &limit) in sums.iter().zip(limits) {
                least = simd.min_f32s(least, simd.sub_f32s(sum, limit));
            }
            within = is_any(simd, simd.less_than_or_equal_f32s(least, zero));
            if !within {
                break;
            }
        }
        any |= within;
        S::as_mut_simd_f32s(&mut distances[lanes]).0.copy_from_slice(&sums[..used]);
    }
    any
}

/// Squared distances from `image` to the lanes of a leaf, into `distances`. Returns whether any is within the
/// threshold; where none is, the distances may be too small.
#[inline(always)]
pub(super) fn lane_distances<S: Simd>(
    simd: S,
    image: &[f32],
    lanes: &[f32],
    threshold: f32,
    distances: &mut [f32; LEAF],
) -> bool {
    let limit = simd.splat_f32s(threshold);
    let mut any = false;
    for first in (0..LEAF).step_by(SUMS * S::F32_LANES) {
        let used = SUMS.min((LEAF - first) / S::F32_LANES);
        let part = first..first + used * S::F32_LANES;
        let mut sums = [simd.splat_f32s(0.0); SUMS];
        let mut within = false;
        for (coordinates, lanes) in image.chunks(HALT).zip(lanes.chunks(HALT * LEAF)) {
            for (&value, row) in coordinates.iter().zip(lanes.chunks_exact(LEAF)) {
                let value = simd.splat_f32s(value);
                for (sum, &lane) in sums.iter_mut().zip(S::as_simd_f32s(&row[part.clone()]).0) {
                    let difference = simd.sub_f32s(value, lane);
                    *sum = simd.mul_add_e_f32s(difference, difference, *sum);
                }
            }
            let mut minimum = sums[0];
            for &sum in &sums[1..used] {
                minimum = simd.min_f32s(minimum, sum);
            }
            // A comparison of lanes is several times as fast as finding the least of them.
            within = is_any(simd, simd.less_than_or_equal_f32s(minimum, limit));
            if !within {
                break;
            }
        }
        any |= within;
        S::as_mut_simd_f32s(&mut distances[part]).0.copy_from_slice(&sums[..used]);
    }
    any
}

#[inline(always)]
fn is_any<S: Simd>(simd: S, mask: S::m32s) -> bool {
    simd.first_true_m32s(mask) < S::F32_LANES
}
