//! Transposes of squares of sixteen AVX-512 vectors.

use std::arch::x86_64::__m512i;

use pulp::x86::V4;

/// Number of rows and columns of a square.
pub(crate) const SIDE: usize = 16;

/// Returns the transpose. Four rows of four become four columns, in each quarter of the vectors. Then the quarters are exchanged in
/// the same way.
///
/// The code uses loops rather than closures, which are compiled without vectors if they are not inlined.
#[inline(always)]
pub(crate) fn turn(simd: V4, rows: [__m512i; SIDE]) -> [__m512i; SIDE] {
    const FIRSTS: i32 = 0b10_00_10_00;
    const SECONDS: i32 = 0b11_01_11_01;
    let all = simd.avx512f;
    let mut fours = rows;
    for first in [0, 4, 8, 12] {
        let [a, b, c, d] = [rows[first], rows[first + 1], rows[first + 2], rows[first + 3]];
        let ab = all._mm512_unpacklo_epi32(a, b);
        let cd = all._mm512_unpacklo_epi32(c, d);
        let upper_ab = all._mm512_unpackhi_epi32(a, b);
        let upper_cd = all._mm512_unpackhi_epi32(c, d);
        fours[first] = all._mm512_unpacklo_epi64(ab, cd);
        fours[first + 1] = all._mm512_unpackhi_epi64(ab, cd);
        fours[first + 2] = all._mm512_unpacklo_epi64(upper_ab, upper_cd);
        fours[first + 3] = all._mm512_unpackhi_epi64(upper_ab, upper_cd);
    }
    let mut turned = rows;
    for column in 0..4 {
        let a = fours[column];
        let b = fours[4 + column];
        let c = fours[8 + column];
        let d = fours[12 + column];
        let even_ab = all._mm512_shuffle_i32x4::<FIRSTS>(a, b);
        let even_cd = all._mm512_shuffle_i32x4::<FIRSTS>(c, d);
        let odd_ab = all._mm512_shuffle_i32x4::<SECONDS>(a, b);
        let odd_cd = all._mm512_shuffle_i32x4::<SECONDS>(c, d);
        turned[column] = all._mm512_shuffle_i32x4::<FIRSTS>(even_ab, even_cd);
        turned[4 + column] = all._mm512_shuffle_i32x4::<FIRSTS>(odd_ab, odd_cd);
        turned[8 + column] = all._mm512_shuffle_i32x4::<SECONDS>(even_ab, even_cd);
        turned[12 + column] = all._mm512_shuffle_i32x4::<SECONDS>(odd_ab, odd_cd);
    }
    turned
}
