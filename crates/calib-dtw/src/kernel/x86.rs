//! The sixteen lanes in AVX2 and AVX-512 registers.
//!
//! # Safety
//! All blocks of this file rely on the same two facts. The caller of a method of [`Lanes`]
//! guarantees the instruction set. Loads and stores stay inside the sixteen values of a reference,
//! and a [`Pack`] is aligned to 64 bytes.

#![expect(clippy::undocumented_unsafe_blocks, reason = "one argument for all blocks, above")]

use std::arch::x86_64::{
    __m256d, __m512d, __m512i, _CMP_LE_OQ, _mm256_add_pd, _mm256_and_pd, _mm256_andnot_pd,
    _mm256_blend_pd, _mm256_blendv_pd, _mm256_cmp_pd, _mm256_load_pd, _mm256_loadu_pd,
    _mm256_min_pd, _mm256_mul_pd, _mm256_permute4x64_pd, _mm256_set1_pd, _mm256_sqrt_pd,
    _mm256_store_pd, _mm256_sub_pd, _mm512_abs_pd, _mm512_add_pd, _mm512_alignr_epi64,
    _mm512_castpd_si512, _mm512_castsi512_pd, _mm512_cmp_pd_mask, _mm512_load_pd, _mm512_loadu_pd,
    _mm512_mask_blend_pd, _mm512_mask_cmp_pd_mask, _mm512_min_pd, _mm512_mul_pd, _mm512_set1_pd,
    _mm512_sqrt_pd, _mm512_store_pd, _mm512_sub_pd,
};

use super::lanes::{LANES, Lanes, Pack};

// Macros repeat the code, because a closure might become a call outside the function with the
// target feature.
macro_rules! two {
    ($r:ident => $one:expr) => {
        [
            {
                let $r = 0;
                $one
            },
            {
                let $r = 1;
                $one
            },
        ]
    };
}

macro_rules! four {
    ($r:ident => $one:expr) => {
        [
            {
                let $r = 0;
                $one
            },
            {
                let $r = 1;
                $one
            },
            {
                let $r = 2;
                $one
            },
            {
                let $r = 3;
                $one
            },
        ]
    };
}

/// Four registers of four.
#[derive(Clone, Copy)]
pub(crate) struct Avx2;

impl Lanes for Avx2 {
    type V = [__m256d; 4];

    #[inline(always)]
    unsafe fn splat(value: f64) -> Self::V {
        unsafe { [_mm256_set1_pd(value); 4] }
    }
    #[inline(always)]
    unsafe fn load(pack: &Pack) -> Self::V {
        four!(r => unsafe { _mm256_load_pd(pack.0.as_ptr().add(4 * r)) })
    }
    #[inline(always)]
    unsafe fn load_unaligned(values: &[f64; LANES]) -> Self::V {
        four!(r => unsafe { _mm256_loadu_pd(values.as_ptr().add(4 * r)) })
    }
    #[inline(always)]
    unsafe fn store(v: Self::V, pack: &mut Pack) {
        for (r, v) in v.into_iter().enumerate() {
            unsafe { _mm256_store_pd(pack.0.as_mut_ptr().add(4 * r), v) }
        }
    }
    #[inline(always)]
    unsafe fn add(a: Self::V, b: Self::V) -> Self::V {
        four!(r => unsafe { _mm256_add_pd(a[r], b[r]) })
    }
    #[inline(always)]
    unsafe fn sub(a: Self::V, b: Self::V) -> Self::V {
        four!(r => unsafe { _mm256_sub_pd(a[r], b[r]) })
    }
    #[inline(always)]
    unsafe fn mul(a: Self::V, b: Self::V) -> Self::V {
        four!(r => unsafe { _mm256_mul_pd(a[r], b[r]) })
    }
    #[inline(always)]
    unsafe fn min(a: Self::V, b: Self::V) -> Self::V {
        four!(r => unsafe { _mm256_min_pd(a[r], b[r]) })
    }
    #[inline(always)]
    unsafe fn abs(a: Self::V) -> Self::V {
        four!(r => unsafe { _mm256_andnot_pd(_mm256_set1_pd(-0.0), a[r]) })
    }
    #[inline(always)]
    unsafe fn sqrt(a: Self::V) -> Self::V {
        four!(r => unsafe { _mm256_sqrt_pd(a[r]) })
    }
    #[inline(always)]
    unsafe fn shift_in(v: Self::V, first: f64) -> Self::V {
        unsafe {
            // Rotates every register up by one, then takes lane 0 from the register below.
            let rotated: Self::V = four!(r => _mm256_permute4x64_pd::<0b10_01_00_11>(v[r]));
            four!(r => {
                let below = match r {
                    0 => _mm256_set1_pd(first),
                    r => rotated[r - 1],
                };
                _mm256_blend_pd::<0b0001>(rotated[r], below)
            })
        }
    }
    #[inline(always)]
    unsafe fn inside(x: Self::V, low: Self::V, high: Self::V, v: Self::V) -> Self::V {
        four!(r => unsafe {
            let above = _mm256_cmp_pd::<_CMP_LE_OQ>(low[r], x[r]);
            let below = _mm256_cmp_pd::<_CMP_LE_OQ>(x[r], high[r]);
            let outside = _mm256_set1_pd(f64::INFINITY);
            _mm256_blendv_pd(outside, v[r], _mm256_and_pd(above, below))
        })
    }
}

/// Two registers of eight.
#[derive(Clone, Copy)]
pub(crate) struct Avx512;

impl Lanes for Avx512 {
    type V = [__m512d; 2];

    #[inline(always)]
    unsafe fn splat(value: f64) -> Self::V {
        unsafe { [_mm512_set1_pd(value); 2] }
    }
    #[inline(always)]
    unsafe fn load(pack: &Pack) -> Self::V {
        two!(r => unsafe { _mm512_load_pd(pack.0.as_ptr().add(8 * r)) })
    }
    #[inline(always)]
    unsafe fn load_unaligned(values: &[f64; LANES]) -> Self::V {
        two!(r => unsafe { _mm512_loadu_pd(values.as_ptr().add(8 * r)) })
    }
    #[inline(always)]
    unsafe fn store(v: Self::V, pack: &mut Pack) {
        for (r, v) in v.into_iter().enumerate() {
            unsafe { _mm512_store_pd(pack.0.as_mut_ptr().add(8 * r), v) }
        }
    }
    #[inline(always)]
    unsafe fn add(a: Self::V, b: Self::V) -> Self::V {
        two!(r => unsafe { _mm512_add_pd(a[r], b[r]) })
    }
    #[inline(always)]
    unsafe fn sub(a: Self::V, b: Self::V) -> Self::V {
        two!(r => unsafe { _mm512_sub_pd(a[r], b[r]) })
    }
    #[inline(always)]
    unsafe fn mul(a: Self::V, b: Self::V) -> Self::V {
        two!(r => unsafe { _mm512_mul_pd(a[r], b[r]) })
    }
    #[inline(always)]
    unsafe fn min(a: Self::V, b: Self::V) -> Self::V {
        two!(r => unsafe { _mm512_min_pd(a[r], b[r]) })
    }
    #[inline(always)]
    unsafe fn abs(a: Self::V) -> Self::V {
        two!(r => unsafe { _mm512_abs_pd(a[r]) })
    }
    #[inline(always)]
    unsafe fn sqrt(a: Self::V) -> Self::V {
        two!(r => unsafe { _mm512_sqrt_pd(a[r]) })
    }
    #[inline(always)]
    unsafe fn shift_in(v: Self::V, first: f64) -> Self::V {
        unsafe {
            let bits: [__m512i; 2] = two!(r => _mm512_castpd_si512(v[r]));
            let first = _mm512_castpd_si512(_mm512_set1_pd(first));
            [
                _mm512_castsi512_pd(_mm512_alignr_epi64::<7>(bits[0], first)),
                _mm512_castsi512_pd(_mm512_alignr_epi64::<7>(bits[1], bits[0])),
            ]
        }
    }
    #[inline(always)]
    unsafe fn inside(x: Self::V, low: Self::V, high: Self::V, v: Self::V) -> Self::V {
        two!(r => unsafe {
            let above = _mm512_cmp_pd_mask::<_CMP_LE_OQ>(low[r], x[r]);
            let inside = _mm512_mask_cmp_pd_mask::<_CMP_LE_OQ>(above, x[r], high[r]);
            _mm512_mask_blend_pd(inside, _mm512_set1_pd(f64::INFINITY), v[r])
        })
    }
}
