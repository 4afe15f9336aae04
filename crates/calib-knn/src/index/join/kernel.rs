//! The inner loops of the join, written once for every instruction set.

#![expect(
    clippy::inline_always,
    reason = "inner loops must take the instruction set of the function that calls them"
)]

use pulp::Simd;

use super::tree::{STRIP, STRIPS};

/// Registers that hold sums in a pass over lanes.
const SUMS: usize = 8;
/// Coordinates between two checks whether the remaining ones are needed.
const HALT: usize = 8;
/// Coordinates between two such checks, for strips.
const STRIP_HALT: usize = 16;

/// Returns the squared distance between two boxes.
#[inline(always)]
pub(super) fn box_to_box<S: Simd>(simd: S, a: (&[f32], &[f32]), b: (&[f32], &[f32])) -> f32 {
    let a = vectors::<S>(a);
    let b = vectors::<S>(b);
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

/// Writes the squared distances from a box to the lanes of `images`, `[coordinate, LANES]`, into `distances`.
/// Returns whether any is within its threshold. If none is, the distances may be too small.
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
                let lower = simd.splat_f32s(lower);
                let upper = simd.splat_f32s(upper);
                for (sum, &lane) in sums.iter_mut().zip(S::as_simd_f32s(&row[lanes.clone()]).0) {
                    let gap = simd.max_f32s(simd.sub_f32s(lower, lane), simd.sub_f32s(lane, upper));
                    let gap = simd.max_f32s(gap, zero);
                    *sum = simd.mul_add_e_f32s(gap, gap, *sum);
                }
            }
            within = any_within(simd, &sums[..used], limits);
            if !within {
                break;
            }
        }
        any |= within;
        S::as_mut_simd_f32s(&mut distances[lanes]).0.copy_from_slice(&sums[..used]);
    }
    any
}

/// Returns the squared distances from the leading coordinates of `image` to the boxes of a leaf's strips,
/// `[coordinate, lower or upper, strip]`.
#[inline(always)]
pub(super) fn image_to_boxes<S: Simd>(
    simd: S,
    image: &[f32],
    boxes: &[f32],
    distances: &mut [f32; STRIPS],
) {
    let zero = simd.splat_f32s(0.0);
    // Two sums break the dependency between successive additions.
    let mut sums = [[zero; STRIPS]; 2];
    let sides = boxes.as_chunks::<STRIPS>().0.as_chunks::<4>().0;
    for (two, [lower, upper, next_lower, next_upper]) in image.as_chunks::<2>().0.iter().zip(sides)
    {
        for ((sums, &value), (lower, upper)) in
            sums.iter_mut().zip(two).zip([(lower, upper), (next_lower, next_upper)])
        {
            let value = simd.splat_f32s(value);
            let sides = S::as_simd_f32s(lower).0.iter().zip(S::as_simd_f32s(upper).0);
            for (sum, (&lower, &upper)) in sums.iter_mut().zip(sides) {
                let gap = simd.max_f32s(simd.sub_f32s(lower, value), simd.sub_f32s(value, upper));
                let gap = simd.max_f32s(gap, zero);
                *sum = simd.mul_add_e_f32s(gap, gap, *sum);
            }
        }
    }
    let [first, second] = sums;
    let stored = S::as_mut_simd_f32s(distances).0.iter_mut();
    for (to, (&a, &b)) in stored.zip(first.iter().zip(&second)) {
        *to = simd.add_f32s(a, b);
    }
}

/// Computes the squared distances from `image` to the images of a strip, `[coordinate, lane]`. Returns whether any
/// is within the threshold. If none is, the distances may be too small.
#[inline(always)]
pub(super) fn strip_distances<S: Simd>(
    simd: S,
    image: &[f32],
    strip: &[f32],
    threshold: f32,
    distances: &mut [f32; STRIP],
) -> bool {
    let used = STRIP / S::F32_LANES;
    let mut sums = [[simd.splat_f32s(0.0); STRIP]; 4];
    let limits = [simd.splat_f32s(threshold); STRIP];
    let mut total = sums[0];
    let coordinates = image.as_chunks::<4>().0.chunks(STRIP_HALT / 4);
    for (coordinates, rows) in coordinates.zip(strip.chunks(STRIP_HALT * STRIP)) {
        for (values, rows) in coordinates.iter().zip(rows.as_chunks::<STRIP>().0.as_chunks::<4>().0)
        {
            for ((sums, &value), row) in sums.iter_mut().zip(values).zip(rows) {
                let value = simd.splat_f32s(value);
                for (sum, &lane) in sums.iter_mut().zip(S::as_simd_f32s(row).0) {
                    let difference = simd.sub_f32s(value, lane);
                    *sum = simd.mul_add_e_f32s(difference, difference, *sum);
                }
            }
        }
        for (number, total) in total[..used].iter_mut().enumerate() {
            let [a, b, c, d] = sums.map(|sums| sums[number]);
            *total = simd.add_f32s(simd.add_f32s(a, b), simd.add_f32s(c, d));
        }
        if !any_within(simd, &total[..used], &limits[..used]) {
            return false;
        }
    }
    S::as_mut_simd_f32s(distances).0.copy_from_slice(&total[..used]);
    true
}

/// Returns the positions where `distances` are within their `thresholds`.
#[inline(always)]
pub(super) fn within<const N: usize>(distances: &[f32; N], thresholds: &[f32; N]) -> Places {
    const { assert!(N <= 64, "places are bits of a number") };
    let mut places = 0;
    for (place, (distance, threshold)) in distances.iter().zip(thresholds).enumerate() {
        places |= u64::from(distance <= threshold) << place;
    }
    Places(places)
}

/// Returns the position of the smallest distance.
pub(super) fn least<const N: usize>(distances: &[f32; N]) -> usize {
    (0..N).reduce(|a: usize, b: usize| if distances[b] < distances[a] { b } else { a }).unwrap_or(0)
}

/// Returns all positions, the smallest distance first.
pub(super) fn nearest_first<const N: usize>(distances: &[f32; N]) -> [usize; N] {
    let mut order = std::array::from_fn(|place| place);
    order.sort_unstable_by(|&a: &usize, &b| distances[a].total_cmp(&distances[b]));
    order
}

/// A set of positions below 64, in ascending order.
pub(super) struct Places(u64);

impl Places {
    /// Iterates over the positions, beginning with `first` if it is in the set.
    pub(super) fn beginning_with(self, first: usize) -> impl Iterator<Item = usize> {
        let only = self.0 & (1 << first);
        Self(only).chain(Self(self.0 ^ only))
    }

    pub(super) fn len(&self) -> usize {
        self.0.count_ones() as usize
    }
}

impl Iterator for Places {
    type Item = usize;

    #[inline(always)]
    fn next(&mut self) -> Option<usize> {
        let place = self.0.trailing_zeros() as usize;
        self.0 &= self.0.wrapping_sub(1);
        (place < 64).then_some(place)
    }
}

/// Whether any lane is at most its limit. Infinite lanes are within infinite limits.
#[inline(always)]
fn any_within<S: Simd>(simd: S, sums: &[S::f32s], limits: &[S::f32s]) -> bool {
    // Comparing lanes is several times as fast as finding their minimum.
    let mut any = simd.less_than_f32s(simd.splat_f32s(0.0), simd.splat_f32s(0.0));
    for (&sum, &limit) in sums.iter().zip(limits) {
        any = simd.or_m32s(any, simd.less_than_or_equal_f32s(sum, limit));
    }
    simd.first_true_m32s(any) < S::F32_LANES
}

#[cfg(test)]
mod tests {
    use pulp::WithSimd;

    use super::{super::tree::SIDES, *};
    use crate::index::at_every_level;

    const WIDTH: usize = 32;

    /// Returns small integers. Sums of their squares are exact in f32, in any order.
    fn values(count: usize, salt: usize) -> Vec<f32> {
        (0..count).map(|i| ((i * i * 7 + i * 13 + salt) % 23) as f32 - 11.0).collect()
    }

    /// Returns upper bounds, `height` above `lower`.
    fn raised(lower: &[f32], height: f32) -> Vec<f32> {
        lower.iter().map(|value| value + height).collect()
    }

    fn gap(lower: f32, value: f32, upper: f32) -> f32 {
        (lower - value).max(value - upper).max(0.0).powi(2)
    }

    #[derive(Clone, Copy)]
    struct Check;

    impl WithSimd for Check {
        type Output = ();

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) {
            boxes(simd);
            boxes_and_lanes(simd);
            strips(simd);
        }
    }

    fn boxes<S: Simd>(simd: S) {
        let a = values(WIDTH, 1);
        let b = values(WIDTH, 8);
        let au = raised(&a, 3.0);
        let bu = raised(&b, 3.0);
        let expected: f32 =
            (0..WIDTH).map(|i: usize| (a[i] - bu[i]).max(b[i] - au[i]).max(0.0).powi(2)).sum();
        assert_eq!(box_to_box(simd, (&a, &au), (&b, &bu)), expected);

        let sides = values(SIDES * 2 * STRIPS, 3);
        let image = values(WIDTH, 4);
        let mut distances = [f32::NAN; STRIPS];
        image_to_boxes(simd, &image, &sides, &mut distances);
        for (strip, &distance) in distances.iter().enumerate() {
            let gaps = (0..SIDES).map(|c| {
                gap(sides[2 * c * STRIPS + strip], image[c], sides[(2 * c + 1) * STRIPS + strip])
            });
            assert_eq!(distance, gaps.sum::<f32>());
        }
    }

    fn boxes_and_lanes<S: Simd>(simd: S) {
        const LANES: usize = 64;
        let lower = values(WIDTH, 2);
        let images = values(WIDTH * LANES, 5);
        let upper = raised(&lower, 2.0);
        let mut distances = [f32::NAN; LANES];
        let exact: [f32; LANES] = std::array::from_fn(|lane: usize| -> f32 {
            (0..WIDTH).map(|c| gap(lower[c], images[c * LANES + lane], upper[c])).sum()
        });
        for near in 0..LANES {
            // One lane is just within its threshold, and decides whether the rest is computed.
            let mut thresholds = [-1.0; LANES];
            thresholds[near] = exact[near];
            let bounds = (&lower[..], &upper[..]);
            assert!(box_to_lanes(simd, bounds, &images, &thresholds, &mut distances));
            assert_eq!(within(&distances, &thresholds).collect::<Vec<_>>(), [near]);
            thresholds[near] = exact[near] - 1.0;
            let any = box_to_lanes(simd, bounds, &images, &thresholds, &mut distances);
            assert!(!any || within(&distances, &thresholds).len() == 0);
        }
    }

    fn strips<S: Simd>(simd: S) {
        let image = values(WIDTH, 9);
        let strip = values(WIDTH * STRIP, 6);
        let exact: [f32; STRIP] = std::array::from_fn(|lane: usize| -> f32 {
            (0..WIDTH).map(|c| (image[c] - strip[c * STRIP + lane]).powi(2)).sum()
        });
        let least = exact.iter().copied().fold(f32::INFINITY, f32::min);
        let mut distances = [f32::NAN; STRIP];
        assert!(!strip_distances(simd, &image, &strip, least - 1.0, &mut distances));
        assert!(strip_distances(simd, &image, &strip, least, &mut distances));
        assert_eq!(distances, exact);
    }

    #[test]
    fn one_place_is_first() {
        let places = within(&[1.0, 5.0, 0.5, 2.0], &[3.0; 4]);
        assert_eq!(places.beginning_with(2).collect::<Vec<_>>(), [2, 0, 3]);
        let places = within(&[1.0, 5.0, 0.5, 2.0], &[3.0; 4]);
        assert_eq!(places.beginning_with(1).collect::<Vec<_>>(), [0, 2, 3]);
        assert_eq!(least(&[1.0, 5.0, 0.5, 2.0]), 2);
        assert_eq!(nearest_first(&[1.0, 5.0, 0.5, 2.0]), [2, 0, 3, 1]);
    }

    #[test]
    fn every_level_is_the_definition() {
        at_every_level(Check);
    }

    #[derive(Clone, Copy)]
    struct Infinite;

    impl WithSimd for Infinite {
        type Output = ();

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) {
            let mut images = vec![0.0; 16 * 64];
            images[..64].fill(f32::MAX);
            let lower = [0.0; 16];
            let upper = [1.0; 16];
            let mut distances = [0.0; 64];
            for near in 0..64 {
                // Each lane is infinitely far. One of them has an infinite threshold.
                let mut thresholds = [1.0; 64];
                thresholds[near] = f32::INFINITY;
                let bounds = (&lower[..], &upper[..]);
                assert!(box_to_lanes(simd, bounds, &images, &thresholds, &mut distances));
                assert_eq!(within(&distances, &thresholds).collect::<Vec<_>>(), [near]);
            }
        }
    }

    #[test]
    fn infinite_sums_are_within_infinite_limits() {
        at_every_level(Infinite);
    }
}
