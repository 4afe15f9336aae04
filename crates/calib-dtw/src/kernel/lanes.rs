//! Sixteen `f64` at a time, in the registers that the processor has.
//!
//! Every instruction set has the same 16 lanes: two AVX-512 registers, four AVX2 registers, or a
//! plain array. Each does the same IEEE operations in the same order, without fused multiply-add.
//! So the results are bit-identical.
//!
//! # Safety
//! The methods of [`Lanes`] are safe to call only where the instruction set is known to be present.
//! Only functions with the matching `target_feature` call them, and [`super::dispatch`] returns
//! those functions only after run-time detection.

pub(crate) const LANES: usize = 16;

/// Sixteen values in memory, one per lane, aligned for any register.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(64))]
pub(crate) struct Pack(pub(crate) [f64; LANES]);

impl Pack {
    pub(crate) const fn splat(value: f64) -> Self {
        Self([value; LANES])
    }
}

/// Sixteen values in registers.
pub(crate) trait Lanes: Copy {
    /// The registers.
    type V: Copy;

    /// # Safety
    /// All methods: the instruction set must be present.
    unsafe fn splat(value: f64) -> Self::V;
    unsafe fn load(pack: &Pack) -> Self::V;
    unsafe fn load_unaligned(values: &[f64; LANES]) -> Self::V;
    unsafe fn store(v: Self::V, pack: &mut Pack);
    unsafe fn add(a: Self::V, b: Self::V) -> Self::V;
    unsafe fn sub(a: Self::V, b: Self::V) -> Self::V;
    unsafe fn mul(a: Self::V, b: Self::V) -> Self::V;
    unsafe fn min(a: Self::V, b: Self::V) -> Self::V;
    unsafe fn abs(a: Self::V) -> Self::V;
    unsafe fn sqrt(a: Self::V) -> Self::V;
    /// Shifts the lanes by one: lane 0 is `first`, and lane l is lane l − 1 of `v`. The last lane
    /// of `v` is dropped.
    unsafe fn shift_in(v: Self::V, first: f64) -> Self::V;
    /// Returns `v` where low ≤ x ≤ high, and +∞ elsewhere.
    unsafe fn inside(x: Self::V, low: Self::V, high: Self::V, v: Self::V) -> Self::V;
}

/// Plain arrays, for every processor. Compilers turn these loops into the instructions of the
/// target.
#[derive(Clone, Copy)]
pub(crate) struct Portable;

#[inline(always)]
fn each(a: [f64; LANES], b: [f64; LANES], f: impl Fn(f64, f64) -> f64) -> [f64; LANES] {
    let mut out = a;
    for lane in 0..LANES {
        out[lane] = f(a[lane], b[lane]);
    }
    out
}

impl Lanes for Portable {
    type V = [f64; LANES];

    #[inline(always)]
    unsafe fn splat(value: f64) -> Self::V {
        [value; LANES]
    }
    #[inline(always)]
    unsafe fn load(pack: &Pack) -> Self::V {
        pack.0
    }
    #[inline(always)]
    unsafe fn load_unaligned(values: &[f64; LANES]) -> Self::V {
        *values
    }
    #[inline(always)]
    unsafe fn store(v: Self::V, pack: &mut Pack) {
        pack.0 = v;
    }
    #[inline(always)]
    unsafe fn add(a: Self::V, b: Self::V) -> Self::V {
        each(a, b, |a, b| a + b)
    }
    #[inline(always)]
    unsafe fn sub(a: Self::V, b: Self::V) -> Self::V {
        each(a, b, |a, b| a - b)
    }
    #[inline(always)]
    unsafe fn mul(a: Self::V, b: Self::V) -> Self::V {
        each(a, b, |a, b| a * b)
    }
    #[inline(always)]
    unsafe fn min(a: Self::V, b: Self::V) -> Self::V {
        each(a, b, |a, b| if a < b { a } else { b })
    }
    #[inline(always)]
    unsafe fn abs(a: Self::V) -> Self::V {
        a.map(f64::abs)
    }
    #[inline(always)]
    unsafe fn sqrt(a: Self::V) -> Self::V {
        a.map(f64::sqrt)
    }
    #[inline(always)]
    unsafe fn shift_in(v: Self::V, first: f64) -> Self::V {
        let mut out = [first; LANES];
        out[1..].copy_from_slice(&v[..LANES - 1]);
        out
    }
    #[inline(always)]
    unsafe fn inside(x: Self::V, low: Self::V, high: Self::V, v: Self::V) -> Self::V {
        let mut out = v;
        for lane in 0..LANES {
            if !(low[lane] <= x[lane] && x[lane] <= high[lane]) {
                out[lane] = f64::INFINITY;
            }
        }
        out
    }
}
