//! The inner loops, written once for every instruction set.

#![expect(
    clippy::inline_always,
    reason = "inner loops must take the instruction set of the function that calls them"
)]

use pulp::Simd;

use super::tree::LEAF;

/// Registers that a pass over the lanes of a leaf keeps.
const SUMS: usize = 8;

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

/// Squared distances from `image` to the lanes of a leaf. Returns the smallest; gives up, and returns a
/// lower bound of it, once that exceeds `threshold`.
#[inline(always)]
pub(super) fn lane_distances<S: Simd>(
    simd: S,
    image: &[f32],
    lanes: &[f32],
    threshold: f32,
    distances: &mut [f32; LEAF],
) -> f32 {
    let step = SUMS * S::F32_LANES;
    let mut smallest = f32::INFINITY;
    let mut first = 0;
    while first < LEAF {
        let used = SUMS.min((LEAF - first) / S::F32_LANES);
        debug_assert!(used * S::F32_LANES == step.min(LEAF - first), "leaves are whole registers");
        let mut sums = [simd.splat_f32s(0.0); SUMS];
        let mut least = f32::INFINITY;
        for (number, coordinates) in image.chunks(16).enumerate() {
            for (offset, &value) in coordinates.iter().enumerate() {
                let row = &lanes[(16 * number + offset) * LEAF + first..][..used * S::F32_LANES];
                let value = simd.splat_f32s(value);
                for (sum, &lane) in sums.iter_mut().zip(S::as_simd_f32s(row).0) {
                    let difference = simd.sub_f32s(value, lane);
                    *sum = simd.mul_add_e_f32s(difference, difference, *sum);
                }
            }
            let mut minimum = sums[0];
            for &sum in &sums[1..used] {
                minimum = simd.min_f32s(minimum, sum);
            }
            least = simd.reduce_min_f32s(minimum);
            if least > threshold {
                break;
            }
        }
        let out = S::as_mut_simd_f32s(&mut distances[first..first + used * S::F32_LANES]).0;
        out.copy_from_slice(&sums[..used]);
        smallest = smallest.min(least);
        first += step;
    }
    smallest
}

/// Squared distance of two states.
#[inline(always)]
pub(super) fn state_distance<S: Simd>(simd: S, a: &[f32], b: &[f32]) -> f32 {
    let ((a, a_tail), (b, b_tail)) = (S::as_simd_f32s(a), S::as_simd_f32s(b));
    let mut sums = [simd.splat_f32s(0.0); 4];
    let (a4, a_rest) = a.as_chunks::<4>();
    let (b4, b_rest) = b.as_chunks::<4>();
    for (a, b) in a4.iter().zip(b4) {
        for i in 0..4 {
            let difference = simd.sub_f32s(a[i], b[i]);
            sums[i] = simd.mul_add_e_f32s(difference, difference, sums[i]);
        }
    }
    for (&a, &b) in a_rest.iter().zip(b_rest) {
        let difference = simd.sub_f32s(a, b);
        sums[0] = simd.mul_add_e_f32s(difference, difference, sums[0]);
    }
    let (a, b) = (simd.partial_load_f32s(a_tail), simd.partial_load_f32s(b_tail));
    let difference = simd.sub_f32s(a, b);
    sums[1] = simd.mul_add_e_f32s(difference, difference, sums[1]);
    let sum = simd.add_f32s(simd.add_f32s(sums[0], sums[1]), simd.add_f32s(sums[2], sums[3]));
    simd.reduce_sum_f32s(sum)
}
