//! Dot products and sums of linear value functions, for the widest vectors the processor has.
//!
//! Sums run in a fixed order of 16 partial sums with fused multiply-adds: the result depends neither on
//! the processor's vectors nor on how many agents share a pass.

/// Values are stored in multiples of this many, the rest zeros.
pub(crate) const LANES: usize = 16;

/// Partial sums that [`total`] adds up.
pub(crate) type Sums = [f32; LANES];

/// `sums` += `scale`-free products x · w, lane by lane.
#[expect(
    clippy::inline_always,
    reason = "only what is inlined into the dispatch is compiled for the processor"
)]
#[inline(always)]
pub(crate) fn add_products(sums: &mut Sums, x: &[f32], w: &[f32]) {
    let (x, w) = (x.as_chunks::<LANES>().0, w.as_chunks::<LANES>().0);
    for (x, w) in x.iter().zip(w) {
        for lane in 0..LANES {
            sums[lane] = x[lane].mul_add(w[lane], sums[lane]);
        }
    }
}

/// The sum of all lanes, by halves.
#[expect(
    clippy::inline_always,
    reason = "only what is inlined into the dispatch is compiled for the processor"
)]
#[inline(always)]
pub(crate) fn total(mut sums: Sums) -> f32 {
    let mut half = LANES / 2;
    while half > 0 {
        for lane in 0..half {
            sums[lane] += sums[lane + half];
        }
        half /= 2;
    }
    sums[0]
}

/// `sum` += `scale` · `x`.
#[expect(
    clippy::inline_always,
    reason = "only what is inlined into the dispatch is compiled for the processor"
)]
#[inline(always)]
pub(crate) fn add_scaled(sum: &mut [f32], scale: f32, x: &[f32]) {
    let (sum, x) = (sum.as_chunks_mut::<LANES>().0, x.as_chunks::<LANES>().0);
    for (sum, x) in sum.iter_mut().zip(x) {
        for lane in 0..LANES {
            sum[lane] = scale.mul_add(x[lane], sum[lane]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_are_those_of_the_definition() {
        let x: Vec<f32> = (0..48).map(|i| i as f32 - 20.0).collect();
        let w: Vec<f32> = (0..48).map(|i| (i % 7) as f32).collect();
        let mut sums = [0.0; LANES];
        add_products(&mut sums, &x, &w);
        // Small integers: exact in any order.
        let expected: f32 = x.iter().zip(&w).map(|(x, w)| x * w).sum();
        assert_eq!(total(sums), expected);
        let mut sum = w.clone();
        add_scaled(&mut sum, -2.0, &x);
        for ((sum, w), x) in sum.iter().zip(&w).zip(&x) {
            assert_eq!(*sum, w - 2.0 * x);
        }
    }
}
