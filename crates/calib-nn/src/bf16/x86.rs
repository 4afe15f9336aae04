//! The sums of a tile, computed with `vdpbf16ps`.

use std::{
    arch::x86_64::{
        __m512, __m512bh, __m512i, _MM_HINT_T0, _mm_prefetch, _mm512_cvtne2ps_pbh,
        _mm512_dpbf16_ps, _mm512_loadu_ps, _mm512_loadu_si512, _mm512_permutexvar_epi16,
        _mm512_set1_epi32, _mm512_setzero_ps, _mm512_storeu_ps,
    },
    mem::transmute,
};

use pulp::{cast, f32x16, u32x16, x86::V4};

use super::{
    kernel::{Kernel, Left, Square, Tile, by_halves},
    panel::{HALF, PANEL},
    task::Task,
};
use crate::{
    aligned::LINE,
    square::{SIDE, turn},
};

/// Proof that the processor has AVX-512 with bfloat16 products. Only [`Hardware::detect`] creates one.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hardware(V4);

impl Hardware {
    /// Detects the features of the processor.
    pub(super) fn detect() -> Option<Self> {
        V4::try_new().filter(|_| std::is_x86_feature_detected!("avx512bf16")).map(Self)
    }

    /// Runs a computation that is compiled for such a processor.
    pub(super) fn run<T: Task>(self, task: T) -> T::Output {
        #[target_feature(enable = "avx512f,avx512bw,avx512cd,avx512dq,avx512vl,avx512bf16,fma")]
        fn inside<T: Task>(hardware: Hardware, task: T) -> T::Output {
            task.run(hardware)
        }
        // SAFETY: a `Hardware` exists only where these features were detected.
        unsafe { inside(self, task) }
    }
}

impl Kernel for Hardware {
    type Simd = V4;

    #[expect(clippy::inline_always, reason = "a token")]
    #[inline(always)]
    fn simd(self) -> V4 {
        self.0
    }

    #[expect(clippy::inline_always, reason = "as the sums")]
    #[inline(always)]
    fn prefetch<T>(self, values: &[T]) {
        for at in (0..size_of_val(values)).step_by(LINE) {
            let line = values.as_ptr().wrapping_byte_add(at);
            // SAFETY: prefetching changes nothing, and every address is valid for it.
            unsafe { _mm_prefetch::<_MM_HINT_T0>(line.cast()) };
        }
    }

    #[expect(clippy::inline_always, reason = "as the sums")]
    #[inline(always)]
    fn join(self, first: f32x16, second: f32x16) -> u32x16 {
        // SAFETY: a `Hardware` exists only where the features were detected.
        unsafe { join(first, second) }
    }

    #[expect(clippy::inline_always, reason = "as the sums")]
    #[inline(always)]
    fn turn(self, square: &Square) -> Square {
        let mut rows = [self.0.avx512f._mm512_setzero_si512(); SIDE];
        for (row, values) in rows.iter_mut().zip(square) {
            *row = cast(*values);
        }
        let mut turned = [[0; HALF]; HALF];
        for (values, row) in turned.iter_mut().zip(turn(self.0, rows)) {
            *values = cast(row);
        }
        turned
    }

    #[expect(
        clippy::inline_always,
        reason = "only what is inlined into the dispatch is compiled for the processor"
    )]
    #[inline(always)]
    fn sum<const COUNT: usize>(
        self,
        begin: &[f32; PANEL],
        left: Left<'_>,
        panel: &[[u32; PANEL]],
        sums: &mut Tile,
    ) {
        assert!(left.holds(COUNT, panel.len()), "a tile lies inside the left operand");
        // SAFETY: a `Hardware` exists only where the features were detected; the assertion ensures what `sum`
        // requires.
        unsafe { sum::<COUNT>(begin, left, panel, sums) }
    }

    #[expect(clippy::inline_always, reason = "as above")]
    #[inline(always)]
    fn dot(self, a: &[[u32; HALF]], b: &[[u32; HALF]]) -> f32 {
        // SAFETY: a `Hardware` exists only where the features were detected.
        unsafe { dot(a, b) }
    }
}

/// Rounds both vectors, then puts number i of the first below number i of the second.
#[inline]
#[target_feature(enable = "avx512f,avx512bw,avx512bf16")]
fn join(first: f32x16, second: f32x16) -> u32x16 {
    const ORDER: [u16; 32] = {
        let mut order = [0; 32];
        let mut place = 0;
        while place < 32 {
            order[place] = (place / 2 + place % 2 * 16) as u16;
            place += 1;
        }
        order
    };
    // SAFETY: all of these types are 64 bytes without invalid values.
    unsafe {
        let both = _mm512_cvtne2ps_pbh(single(second), single(first));
        let order = transmute::<[u16; 32], __m512i>(ORDER);
        let both = transmute::<__m512bh, __m512i>(both);
        transmute::<__m512i, u32x16>(_mm512_permutexvar_epi16(order, both))
    }
}

#[inline]
#[target_feature(enable = "avx512f")]
fn single(values: f32x16) -> __m512 {
    // SAFETY: both are sixteen values of single precision.
    unsafe { transmute::<f32x16, __m512>(values) }
}

/// # Safety
/// The features are there, and all pairs of `COUNT` rows lie inside `left`.
#[inline]
#[target_feature(enable = "avx512f,avx512bf16")]
unsafe fn sum<const COUNT: usize>(
    begin: &[f32; PANEL],
    left: Left<'_>,
    panel: &[[u32; PANEL]],
    sums: &mut Tile,
) {
    let Left { pairs, row_stride, pair_stride } = left;
    let mut kept = [halves(begin); COUNT];
    // Each row has its own pointer. If the address of one row depended on another row's sum, they would form a chain
    // as long as the products.
    let rows: [_; COUNT] = std::array::from_fn(|row| pairs.as_ptr().wrapping_add(row * row_stride));
    let mut at = 0;
    for block in panel {
        let block = bf16_halves(block);
        for (row, kept) in rows.iter().zip(&mut kept) {
            // SAFETY: pair (row, p) lies inside `left`, as the caller promises.
            let pair = unsafe { *row.add(at) };
            let pair = bf16(_mm512_set1_epi32(pair.cast_signed()));
            kept[0] = _mm512_dpbf16_ps(kept[0], pair, block[0]);
            kept[1] = _mm512_dpbf16_ps(kept[1], pair, block[1]);
        }
        at += pair_stride;
    }
    for (kept, sums) in kept.iter().zip(&mut sums.0) {
        let (first, second) = sums.split_at_mut(16);
        // SAFETY: both halves contain sixteen values.
        unsafe {
            _mm512_storeu_ps(first.as_mut_ptr(), kept[0]);
            _mm512_storeu_ps(second.as_mut_ptr(), kept[1]);
        }
    }
}

#[inline]
#[target_feature(enable = "avx512f,avx512bf16")]
fn dot(a: &[[u32; HALF]], b: &[[u32; HALF]]) -> f32 {
    let mut sums = _mm512_setzero_ps();
    for (a, b) in a.iter().zip(b) {
        sums = _mm512_dpbf16_ps(sums, bf16(load(a)), bf16(load(b)));
    }
    let mut lanes = [0.0; HALF];
    // SAFETY: there are sixteen values.
    unsafe { _mm512_storeu_ps(lanes.as_mut_ptr(), sums) };
    by_halves(lanes)
}

#[inline]
#[target_feature(enable = "avx512f")]
fn halves(row: &[f32; PANEL]) -> [__m512; 2] {
    // SAFETY: a row contains 32 values.
    unsafe { [_mm512_loadu_ps(row.as_ptr()), _mm512_loadu_ps(row.as_ptr().add(16))] }
}

#[inline]
#[target_feature(enable = "avx512f")]
fn bf16_halves(block: &[u32; PANEL]) -> [__m512bh; 2] {
    // SAFETY: a block contains 32 pairs.
    unsafe {
        let pairs = block.as_ptr();
        [bf16(_mm512_loadu_si512(pairs.cast())), bf16(_mm512_loadu_si512(pairs.add(16).cast()))]
    }
}

#[inline]
#[target_feature(enable = "avx512f")]
fn load(pairs: &[u32; HALF]) -> __m512i {
    // SAFETY: there are sixteen pairs.
    unsafe { _mm512_loadu_si512(pairs.as_ptr().cast()) }
}

#[inline]
#[target_feature(enable = "avx512f")]
fn bf16(bits: __m512i) -> __m512bh {
    // SAFETY: both are 64 bytes without invalid values.
    unsafe { transmute::<__m512i, __m512bh>(bits) }
}
