use pulp::{Simd, cast};

/// Smaller magnitudes count as zero: 2⁻⁵⁵, about 2.8e-17.
///
/// The product of two numbers that are not smaller is a multiple of 2⁻¹²⁴, because each has eight significant bits. So is
/// every sum of such products, with any rounding. So no sum except 0 is subnormal, and it makes no difference that
/// `vdpbf16ps` treats subnormal numbers as zeros.
const SMALLEST: u32 = 0x2400_0000;

const MAGNITUDE: u32 = 0x7fff_ffff;
const INFINITY: u32 = 0x7f80_0000;
const QUIET: u32 = 0x0040_0000;
const UPPER: u32 = 0xffff_0000;

/// Returns `values` with those below [`SMALLEST`] set to 0. NaN stays NaN.
#[expect(
    clippy::inline_always,
    reason = "only what is inlined into the dispatch is compiled for the processor"
)]
#[inline(always)]
pub(super) fn without_small<S: Simd>(simd: S, values: S::f32s) -> S::f32s {
    let magnitude = simd.and_u32s(cast(values), simd.splat_u32s(MAGNITUDE));
    let small = simd.less_than_u32s(magnitude, simd.splat_u32s(SMALLEST));
    simd.select_f32s(small, simd.splat_f32s(0.0), values)
}

/// Returns `values` with those below [`SMALLEST`] and all negative ones set to 0. NaN stays NaN.
#[expect(clippy::inline_always, reason = "as above")]
#[inline(always)]
pub(super) fn rectified<S: Simd>(simd: S, values: S::f32s) -> S::f32s {
    // NaN must stay NaN: a diverged network must not look like a dead one.
    let smallest = simd.splat_f32s(f32::from_bits(SMALLEST));
    let less = simd.less_than_f32s(values, smallest);
    simd.select_f32s(less, simd.splat_f32s(0.0), values)
}

/// Rounds `values` to bfloat16, to nearest and ties to even. No value may be subnormal. Each result is in the upper half
/// of a word whose lower half is 0. Values that are too large become infinite. NaN stays NaN, quiet, with as much of its
/// payload as fits.
#[expect(clippy::inline_always, reason = "as above")]
#[inline(always)]
fn upper<S: Simd>(simd: S, values: S::f32s) -> S::u32s {
    let bits: S::u32s = cast(values);
    let last_kept =
        simd.and_u32s(simd.wrapping_dyn_shr_u32s(bits, simd.splat_u32s(16)), simd.splat_u32s(1));
    let rounding = simd.add_u32s(last_kept, simd.splat_u32s(0x7fff));
    let number = simd.add_u32s(bits, rounding);
    let nan = simd.greater_than_u32s(
        simd.and_u32s(bits, simd.splat_u32s(MAGNITUDE)),
        simd.splat_u32s(INFINITY),
    );
    let quiet = simd.or_u32s(bits, simd.splat_u32s(QUIET));
    simd.and_u32s(simd.select_u32s(nan, quiet, number), simd.splat_u32s(UPPER))
}

/// Returns pairs of two vectors, rounded, the first in the lower halves. No value may be subnormal.
#[expect(clippy::inline_always, reason = "as above")]
#[inline(always)]
pub(super) fn join<S: Simd>(simd: S, first: S::f32s, second: S::f32s) -> S::u32s {
    let first = simd.wrapping_dyn_shr_u32s(upper(simd, first), simd.splat_u32s(16));
    simd.or_u32s(first, upper(simd, second))
}

/// Returns the first numbers of pairs, in single precision.
#[expect(clippy::inline_always, reason = "as the conversion itself")]
#[inline(always)]
pub(super) fn firsts<S: Simd>(simd: S, pairs: S::u32s) -> S::f32s {
    cast(simd.wrapping_dyn_shl_u32s(pairs, simd.splat_u32s(16)))
}

/// Returns the second numbers of pairs, in single precision.
#[expect(clippy::inline_always, reason = "as the conversion itself")]
#[inline(always)]
pub(super) fn seconds<S: Simd>(simd: S, pairs: S::u32s) -> S::f32s {
    cast(simd.and_u32s(pairs, simd.splat_u32s(UPPER)))
}

/// Returns a bias: in single precision, with the same smallest magnitude.
pub(super) fn bias(value: f32) -> f32 {
    if value.abs() < f32::from_bits(SMALLEST) { 0.0 } else { value }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use pulp::{Arch, Scalar, WithSimd};

    use super::*;

    fn rounded(value: f32) -> f32 {
        f32::from_bits(upper(Scalar, without_small(Scalar, value)))
    }

    /// Returns the nearer of the two adjacent bfloat16 numbers, measured in double precision.
    fn nearest(value: f32) -> f32 {
        let below = value.to_bits() & UPPER;
        let (below, above) = (f32::from_bits(below), f32::from_bits(below.wrapping_add(0x1_0000)));
        let [to_below, to_above] = [below, above].map(|other| {
            // Beyond the largest number, the next step would be 2¹²⁸.
            let other = if other.is_infinite() { 2_f64.powi(128) } else { f64::from(other.abs()) };
            (f64::from(value.abs()) - other).abs()
        });
        let order = to_below.total_cmp(&to_above);
        let is_even = below.to_bits() & 0x1_0000 == 0;
        if order.is_lt() || (order.is_eq() && is_even) { below } else { above }
    }

    struct All<'a>(&'a [f32; 16]);

    impl WithSimd for All<'_> {
        type Output = [u32; 16];

        #[expect(clippy::inline_always, reason = "as the conversion itself")]
        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) -> [u32; 16] {
            let mut words = [0; 16];
            let values = S::as_simd_f32s(self.0).0;
            for (word, &value) in S::as_mut_simd_u32s(&mut words).0.iter_mut().zip(values) {
                *word = join(simd, rectified(simd, value), without_small(simd, value));
            }
            words
        }
    }

    proptest! {
        #[test]
        fn numbers_are_rounded_to_the_nearest(bits in any::<u32>()) {
            let value = f32::from_bits(bits);
            let got = rounded(value);
            if value.is_nan() {
                prop_assert!(got.is_nan());
            } else if value.is_infinite() {
                prop_assert_eq!(got, value);
            } else if value.abs() < 2_f32.powi(-55) {
                prop_assert_eq!(got.to_bits(), 0);
            } else {
                prop_assert_eq!(got, nearest(value));
            }
        }

        #[test]
        fn vectors_are_rounded_as_numbers_are(bits in any::<[u32; 16]>()) {
            let values = bits.map(f32::from_bits);
            let words = Arch::new().dispatch(All(&values));
            let expected = values
                .map(|value| join(Scalar, rectified(Scalar, value), without_small(Scalar, value)));
            prop_assert_eq!(words, expected);
        }
    }

    #[test]
    fn the_edges_are_rounded_as_they_should() {
        assert_eq!(rounded(1.0), 1.0);
        assert_eq!(rounded(1.0 + 2_f32.powi(-8)), 1.0, "a tie, to even");
        assert_eq!(rounded(1.0 + 3.0 * 2_f32.powi(-8)), 1.0 + 2_f32.powi(-6), "a tie, to even");
        assert_eq!(rounded(f32::MAX), f32::INFINITY);
        assert_eq!(rounded(-2_f32.powi(-55)), -2_f32.powi(-55));
        assert_eq!(rounded(-2_f32.powi(-55) * 0.999).to_bits(), 0);
        assert_eq!(rounded(-0.0).to_bits(), 0);
        let two = join(Scalar, 1.5, -3.0);
        assert_eq!((firsts(Scalar, two), seconds(Scalar, two)), (1.5, -3.0));
        assert_eq!(
            (rectified(Scalar, -1.0), rectified(Scalar, 1e-17), rectified(Scalar, 0.5)),
            (0.0, 0.0, 0.5)
        );
        assert!(rectified(Scalar, f32::NAN).is_nan() && rounded(f32::NAN).is_nan());
        assert_eq!((bias(1e-17), bias(-1e-16)), (0.0, -1e-16));
    }
}
