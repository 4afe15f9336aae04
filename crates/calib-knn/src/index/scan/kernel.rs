//! The inner loops of the scan, written once for every instruction set.

#![expect(
    clippy::inline_always,
    reason = "inner loops must take the instruction set of the function that calls them"
)]

use pulp::Simd;

/// Number of source vectors that are compared together.
const VECTORS: usize = 3;
/// Number of sources that are compared together with the widest vectors.
pub(super) const MOST_LANES: usize = VECTORS * 16;

/// Returns the number of sources of a strip, which are compared together.
pub(super) const fn strip<S: Simd>() -> usize {
    VECTORS * S::F32_LANES
}

/// Writes the centred states of a strip side by side, `[column, lane]`, and their squared norms to `norms`. Lanes
/// past the last state keep their old values.
#[inline(always)]
pub(super) fn lay_strip<'a, S: Simd>(
    simd: S,
    states: impl Iterator<Item = &'a [f32]>,
    centre: &[f32],
    lanes: &mut [f32],
    norms: &mut [f32],
) {
    for (lane, state) in states.enumerate() {
        let column_of = lanes[lane..].iter_mut().step_by(strip::<S>());
        for ((out, &value), &centre) in column_of.zip(state).zip(centre) {
            *out = value - centre;
        }
    }
    let mut sums = [simd.splat_f32s(0.0); VECTORS];
    for row in S::as_simd_f32s(lanes).0.as_chunks::<VECTORS>().0 {
        for (sum, &value) in sums.iter_mut().zip(row) {
            *sum = simd.mul_add_e_f32s(value, value, *sum);
        }
    }
    S::as_mut_simd_f32s(norms).0.copy_from_slice(&sums);
}

/// Computes `offset − 2 x·q` for a strip of states `x` and `QUERIES` queries, whose panel contains `−2 q` as
/// `[column, query]`.
///
/// The sums stay in registers. Returns whether any is within the limit of its query. Only then are they written to
/// `out`, `[query, lane]`.
#[inline(always)]
pub(super) fn meets<S: Simd, const QUERIES: usize>(
    simd: S,
    lanes: &[f32],
    offsets: &[f32],
    panel: &[f32],
    limits: &[f32],
    out: &mut [f32],
) -> bool {
    let start: &[S::f32s; VECTORS] =
        S::as_simd_f32s(offsets).0.try_into().expect("a strip has its vectors");
    let mut sums = [*start; QUERIES];
    let rows = S::as_simd_f32s(lanes).0.as_chunks::<VECTORS>().0;
    for (row, queries) in rows.iter().zip(panel.as_chunks::<QUERIES>().0) {
        for (sums, &query) in sums.iter_mut().zip(queries) {
            let query = simd.splat_f32s(query);
            for (sum, &lane) in sums.iter_mut().zip(row) {
                *sum = simd.mul_add_e_f32s(query, lane, *sum);
            }
        }
    }
    let mut any = false;
    for (sums, &limit) in sums.iter().zip(limits) {
        let least = simd.min_f32s(simd.min_f32s(sums[0], sums[1]), sums[2]);
        let within = simd.less_than_or_equal_f32s(least, simd.splat_f32s(limit));
        any |= simd.first_true_m32s(within) < S::F32_LANES;
    }
    if any {
        let out = S::as_mut_simd_f32s(out).0;
        for (out, sums) in out.as_chunks_mut::<VECTORS>().0.iter_mut().zip(&sums) {
            *out = *sums;
        }
    }
    any
}

#[cfg(test)]
mod tests {
    use pulp::{Arch, WithSimd};

    use super::*;

    /// Returns small integers, whose sums are exact in f32 in any order.
    fn value(i: usize, salt: usize) -> f32 {
        ((i * 37 + salt) % 19) as f32 - 9.0
    }

    fn product(a: &[f32], b: &[f32]) -> f32 {
        a.iter().zip(b).map(|(a, b)| a * b).sum()
    }

    /// Returns a sum by definition, for a centre of twos.
    fn expected(state: &[f32], query: &[f32]) -> f32 {
        let x: Vec<f32> = state.iter().map(|value| value - 2.0).collect();
        product(&x, &x) - 2.0 * product(&x, query)
    }

    struct Check {
        columns: usize,
    }

    impl WithSimd for Check {
        type Output = ();

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) {
            const QUERIES: usize = 4;
            let columns = self.columns;
            let strip = strip::<S>();
            let states: Vec<Vec<f32>> = (0..strip - 1)
                .map(|row| (0..columns).map(|c| value(row * columns + c, 1)).collect())
                .collect();
            let queries: Vec<Vec<f32>> = (0..QUERIES)
                .map(|row| (0..columns).map(|c| value(row * columns + c, 5)).collect())
                .collect();
            let centre = vec![2.0; columns];
            let mut lanes = vec![0.0; strip * columns];
            let mut offsets = vec![0.0; strip];
            let rows = states.iter().map(Vec::as_slice);
            lay_strip(simd, rows, &centre, &mut lanes, &mut offsets);
            let mut panel = vec![0.0; QUERIES * columns];
            for (q, query) in queries.iter().enumerate() {
                for (c, value) in query.iter().enumerate() {
                    panel[c * QUERIES + q] = -2.0 * value;
                }
            }
            offsets[strip - 1] = f32::INFINITY;
            let mut out = vec![f32::NAN; QUERIES * strip];
            let below: Vec<f32> = (0..QUERIES)
                .map(|q| {
                    states.iter().map(|state| expected(state, &queries[q])).fold(0.0, f32::min)
                        - 1.0
                })
                .collect();
            assert!(!meets::<S, QUERIES>(simd, &lanes, &offsets, &panel, &below, &mut out));
            for near in 0..QUERIES {
                let mut limits = below.clone();
                limits[near] =
                    states.iter().map(|state| expected(state, &queries[near])).fold(1e9, f32::min);
                assert!(meets::<S, QUERIES>(simd, &lanes, &offsets, &panel, &limits, &mut out));
                for (q, out) in out.chunks(strip).enumerate() {
                    for (row, &out) in out[..strip - 1].iter().enumerate() {
                        assert_eq!(out, expected(&states[row], &queries[q]));
                    }
                    assert_eq!(out[strip - 1], f32::INFINITY);
                }
            }
        }
    }

    #[test]
    fn sums_are_the_definition() {
        for columns in [1, 2, 7, 142] {
            Arch::new().dispatch(Check { columns });
            Check { columns }.with_simd(pulp::Scalar);
        }
    }
}
