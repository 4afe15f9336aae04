#![expect(
    clippy::inline_always,
    reason = "inner loops must take the instruction set of the function that calls them"
)]

use calib_core::Monitor;
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use super::{
    Found, NeighborIndex, Queries, Sources, going_on,
    pending::{Pending, Pool},
    product::inner_products,
};
use crate::{KnnError, MemberLists, distance::Margin, groups::Groups};

/// Queries of a tile.
const QUERIES: usize = 256;
/// Sources of a tile.
const TILE: usize = 512;
/// Sources that are looked at together.
const STRIP: usize = 128;
/// Beyond this squared distance from the centre f32 products could overflow.
const FARTHEST: f64 = 1e30;

/// An exact blocked scan: every query meets every source, for data that cannot be ruled out unseen.
///
/// With all states moved by a common centre, `‖x − q‖² = ‖x‖² + ‖q‖² − 2 x·q`. The products of a tile are one
/// matrix product in f32. By the usual bounds on sums (Higham 2002, §3.1) products and norms together err by at most
/// `(2d + 16)·2⁻²⁴·(‖x‖² + ‖q‖²)`, which is doubled. Pairs that are near enough by that margin are judged as everywhere else.
#[derive(Debug)]
pub struct Scan<'a> {
    sources: Sources<'a>,
    groups: Groups,
    centre: Vec<f32>,
    margin: Margin,
}

impl<'a> Scan<'a> {
    /// A scan of these sources.
    pub fn new(sources: Sources<'a>) -> Self {
        let groups = Groups::singletons(&sources);
        let centre = centre(&sources);
        let margin = Margin::new(sources.columns());
        Self { sources, groups, centre, margin }
    }

    fn pool(&self) -> Pool<'_> {
        Pool { sources: &self.sources, groups: &self.groups, margin: self.margin }
    }
}

/// A state in the middle of the sources: the mean of up to 1000 of them. Any would do.
fn centre(sources: &Sources<'_>) -> Vec<f32> {
    let stride = sources.len().div_ceil(1000).max(1);
    let sampled: Vec<u32> = (0..sources.len() as u32).step_by(stride).collect();
    let mut sums = vec![0.0_f64; sources.columns()];
    for &transition in &sampled {
        for (sum, &value) in sums.iter_mut().zip(sources.state(transition)) {
            *sum += f64::from(value);
        }
    }
    sums.into_iter().map(|sum| (sum / sampled.len().max(1) as f64) as f32).collect()
}

/// A block of queries against all sources.
struct Block<'a> {
    scan: &'a Scan<'a>,
    queries: &'a Queries<'a>,
    /// Which queries.
    order: &'a [u32],
    k: usize,
}

impl WithSimd for Block<'_> {
    type Output = Vec<MemberLists>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Vec<MemberLists> {
        let (scan, columns) = (self.scan, self.scan.sources.columns());
        let (pool, total) = (scan.pool(), scan.groups.len());
        let error = (2.0 * columns as f64 + 16.0) * f64::from(f32::EPSILON);
        let tiny = (2.0 * columns as f64 + 16.0) * f64::from(f32::MIN_POSITIVE);
        let count = self.order.len();
        let mut left = vec![0.0; count * columns];
        let mut queries_far = false;
        let mut pending: Vec<(Pending<'_>, f64)> = (self.order.iter().enumerate())
            .map(|(place, &query)| {
                let one = Pending::new(simd, pool, self.queries, query as usize, self.k);
                let out = &mut left[place * columns..][..columns];
                let norm = centred(simd, one.state(), &scan.centre, out);
                // A query that is too far meets every source, and its norm counts for nothing.
                queries_far |= norm > FARTHEST;
                (one, if norm > FARTHEST { 0.0 } else { norm })
            })
            .collect();
        let mut right = vec![0.0; TILE * columns];
        let mut products = vec![0.0_f32; count * TILE];
        for start in tile_starts(total, scan.sources.blocks().members()) {
            let width = TILE.min(total - start);
            let mut offsets = [f32::INFINITY; TILE];
            let mut far = queries_far || columns == 0;
            for (lane, offset) in offsets[..width].iter_mut().enumerate() {
                let state = pool.state((start + lane) as u32);
                let out = &mut right[lane * columns..][..columns];
                let norm = centred(simd, state, &scan.centre, out);
                far |= norm > FARTHEST;
                *offset = (norm * (1.0 - error)) as f32;
            }
            let products = &mut products[..count * width];
            if far {
                // Nothing is ruled out here; the definition decides.
                offsets = [f32::NEG_INFINITY; TILE];
                products.fill(0.0);
            } else {
                inner_products(products, &left, &right[..width * columns], columns);
            }
            for ((one, norm), products) in pending.iter_mut().zip(products.chunks_exact(width)) {
                let limit = |one: &Pending<'_>| {
                    let radius = one.radius()?;
                    Some(((radius - *norm * (1.0 - error) + tiny) as f32).next_up())
                };
                let Some(mut threshold) = limit(one) else { continue };
                let strips = products.chunks(STRIP).zip(offsets.chunks(STRIP));
                for (number, (products, offsets)) in strips.enumerate() {
                    if smallest(simd, products, offsets) > threshold {
                        continue;
                    }
                    for (lane, (&product, &offset)) in products.iter().zip(offsets).enumerate() {
                        let source = (start + number * STRIP + lane) as u32;
                        let near = offset - 2.0 * product <= threshold;
                        if near && one.meet(simd, pool, source) {
                            threshold = limit(one).unwrap_or(threshold);
                        }
                    }
                }
            }
        }
        pending.into_iter().map(|(one, _)| one.finish(pool, self.queries)).collect()
    }
}

/// Starts of the tiles, in an order that sees every part of the data early. In the order of time the member
/// that lacks the first block would have no neighbours, and so no radius, for as long as that block lasts.
fn tile_starts(total: usize, members: usize) -> impl Iterator<Item = usize> {
    let tiles = total.div_ceil(TILE);
    let stride = tiles.div_ceil(4 * members).max(1);
    (0..stride).flat_map(move |first| (first..tiles).step_by(stride)).map(|tile| tile * TILE)
}

/// Write `state − centre`; returns its squared norm as an f32 sum.
#[inline(always)]
fn centred<S: Simd>(simd: S, state: &[f32], centre: &[f32], out: &mut [f32]) -> f64 {
    let (state, state_tail) = S::as_simd_f32s(state);
    let (centre, centre_tail) = S::as_simd_f32s(centre);
    let (out, out_tail) = S::as_mut_simd_f32s(out);
    let mut sum = simd.splat_f32s(0.0);
    for ((out, &state), &centre) in out.iter_mut().zip(state).zip(centre) {
        *out = simd.sub_f32s(state, centre);
        sum = simd.mul_add_e_f32s(*out, *out, sum);
    }
    let tail =
        simd.sub_f32s(simd.partial_load_f32s(state_tail), simd.partial_load_f32s(centre_tail));
    simd.partial_store_f32s(out_tail, tail);
    f64::from(simd.reduce_sum_f32s(simd.mul_add_e_f32s(tail, tail, sum)))
}

/// The smallest `offset − 2·product`.
#[inline(always)]
fn smallest<S: Simd>(simd: S, products: &[f32], offsets: &[f32]) -> f32 {
    let (products, products_tail) = S::as_simd_f32s(products);
    let (offsets, offsets_tail) =
        S::as_simd_f32s(&offsets[..products.len() * S::F32_LANES + products_tail.len()]);
    let minus_two = simd.splat_f32s(-2.0);
    let mut least = simd.splat_f32s(f32::INFINITY);
    for (&product, &offset) in products.iter().zip(offsets) {
        least = simd.min_f32s(least, simd.mul_add_e_f32s(minus_two, product, offset));
    }
    let tail =
        products_tail.iter().zip(offsets_tail).map(|(product, offset)| offset - 2.0 * product);
    tail.fold(simd.reduce_min_f32s(least), f32::min)
}

impl NeighborIndex for Scan<'_> {
    fn search(
        &self,
        queries: &Queries<'_>,
        order: &[u32],
        found: &mut Found,
        monitor: &dyn Monitor,
    ) -> Result<(), KnnError> {
        let (k, arch) = (found.k(), Arch::new());
        let tasks = order.chunks(QUERIES);
        found.pieces(tasks.clone().map(<[u32]>::len)).zip(tasks.collect::<Vec<_>>()).for_each(
            |(mut piece, order)| {
                if monitor.interrupted() {
                    return;
                }
                let lists = arch.dispatch(Block { scan: self, queries, order, k });
                for (place, lists) in lists.iter().enumerate() {
                    piece.store(place, lists);
                }
                monitor.advance(order.len() as u64);
            },
        );
        going_on(monitor)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_tile_has_its_turn() {
        for (total, members) in [(1, 2), (TILE, 5), (TILE + 1, 5), (100 * TILE - 3, 3), (0, 2)] {
            let mut starts: Vec<usize> = tile_starts(total, members).collect();
            starts.sort_unstable();
            assert_eq!(starts, (0..total).step_by(TILE).collect::<Vec<_>>());
        }
    }
}
