#![expect(
    clippy::inline_always,
    reason = "inner loops must take the instruction set of the function that calls them"
)]

use calib_core::Monitor;
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use super::{
    NeighborIndex, Queries, Sink, Sources,
    pending::{Pending, Pool},
    product::inner_products,
};
use crate::{KnnError, MemberLists, distance::Margin, groups::Groups};

/// Queries of a tile.
const QUERIES: usize = 256;
/// Sources of a tile.
const TILE: usize = 512;
/// Sources that are looked at together.
const STRIP: usize = 64;
/// Blocks of queries between two looks at the monitor.
const GROUP: usize = 8;
/// Beyond this squared distance from the centre f32 products could overflow.
const FARTHEST: f64 = 1e30;

/// An exact blocked scan: every query meets every source, for data that cannot be ruled out unseen.
///
/// With all states moved by a common centre, `‖x − q‖² = ‖x‖² + ‖q‖² − 2 x·q`. The products of a tile are one
/// matrix product in f32, whose error is at most `(d + 8)·2⁻²³·(‖x‖² + ‖q‖²)` by the usual bounds on sums (Higham
/// 2002, §3.1; doubled). Pairs that are near enough by that margin are judged as everywhere else.
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
        let groups = Groups::singletons(sources.len());
        let centre = centre(&sources);
        let margin = Margin::new(sources.columns());
        Self { sources, groups, centre, margin }
    }

    fn pool(&self) -> Pool<'_> {
        Pool { sources: &self.sources, groups: &self.groups, margin: self.margin }
    }

    /// Append `state`, centred; returns its squared norm.
    fn centred(&self, state: &[f32], to: &mut Vec<f32>) -> f64 {
        let mut norm = 0.0;
        to.extend(state.iter().zip(&self.centre).map(|(&value, &centre)| {
            let centred = value - centre;
            norm += f64::from(centred) * f64::from(centred);
            centred
        }));
        norm
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
    first: usize,
    count: usize,
    k: usize,
}

impl WithSimd for Block<'_> {
    type Output = Vec<MemberLists>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Vec<MemberLists> {
        let (scan, columns) = (self.scan, self.scan.sources.columns());
        let (pool, total) = (scan.pool(), scan.sources.len());
        let error = (columns as f64 + 8.0) * f64::from(f32::EPSILON);
        let tiny = (columns as f64 + 8.0) * f64::from(f32::MIN_POSITIVE);
        let mut left = Vec::with_capacity(self.count * columns);
        let mut pending: Vec<(Pending<'_>, f64)> = (self.first..self.first + self.count)
            .map(|query| {
                let one = Pending::new(simd, pool, self.queries, query, self.k);
                let norm = scan.centred(one.state(), &mut left);
                (one, norm)
            })
            .collect();
        let farthest = |norms: f64| norms > FARTHEST;
        let queries_far = farthest(pending.iter().map(|one| one.1).fold(0.0, f64::max));
        let mut right = Vec::with_capacity(TILE * columns);
        let mut products = vec![0.0_f32; self.count * TILE];
        for start in (0..total).step_by(TILE) {
            let width = TILE.min(total - start);
            right.clear();
            let mut offsets = [f32::INFINITY; TILE];
            let mut far = queries_far || columns == 0;
            for (lane, offset) in offsets[..width].iter_mut().enumerate() {
                let norm = scan.centred(scan.sources.state((start + lane) as u32), &mut right);
                far |= farthest(norm);
                *offset = (norm * (1.0 - error)) as f32;
            }
            let products = &mut products[..self.count * width];
            if far {
                // Nothing is ruled out here; the definition decides.
                offsets = [f32::NEG_INFINITY; TILE];
                products.fill(0.0);
            } else {
                inner_products(products, &left, &right, columns);
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
        k: usize,
        sink: &mut Sink<'_>,
        monitor: &dyn Monitor,
    ) -> Result<(), KnnError> {
        let (total, arch) = (queries.len(), Arch::new());
        let starts: Vec<usize> = (0..total).step_by(QUERIES).collect();
        for group in starts.chunks(GROUP) {
            if monitor.interrupted() {
                return Err(KnnError::Interrupted);
            }
            let found: Vec<Vec<MemberLists>> = group
                .par_iter()
                .map(|&first| {
                    let count = QUERIES.min(total - first);
                    arch.dispatch(Block { scan: self, queries, first, count, k })
                })
                .collect();
            let mut query = group[0];
            for lists in found.iter().flatten() {
                sink(query, lists);
                query += 1;
            }
            monitor.advance((query - group[0]) as u64);
        }
        Ok(())
    }
}
