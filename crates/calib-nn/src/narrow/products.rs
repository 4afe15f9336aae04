//! Rows of a product, as sums of the rows of the right operand whose factor is not zero.

use pulp::{Simd, bytemuck};

/// Number of columns of an AVX-512 vector. Rows of right operands are whole groups.
pub(super) const GROUP: usize = 16;

/// Maximum number of columns at a time, so that their sums stay in registers.
const PANEL: usize = 64;

/// Bits of a word.
pub(super) const WORD: usize = u64::BITS as usize;

/// Sums of the columns of a panel, stored in the first vectors.
type Sums<S> = [<S as Simd>::f32s; PANEL];

/// A left operand: element (i, l) is `values[i * row_stride + l * column_stride]`.
#[derive(Clone, Copy)]
pub(super) struct Left<'a> {
    pub(super) values: &'a [f32],
    pub(super) row_stride: usize,
    pub(super) column_stride: usize,
    /// The elements of row i to use: bits of the words from `i * word_stride` on.
    pub(super) bits: &'a [u64],
    pub(super) words: usize,
    pub(super) word_stride: usize,
}

/// A right operand with rows in order, each `stride` wide.
#[derive(Clone, Copy)]
pub(super) struct Right<'a> {
    pub(super) values: &'a [f32],
    pub(super) stride: usize,
}

/// The processing of the sums of a row, from a column on.
pub(super) trait Finish {
    /// Processes the sums. Implementations must be inlined always; only then are they compiled for
    /// the processor.
    fn finish<S: Simd>(&mut self, simd: S, row: usize, column: usize, sums: &[S::f32s]);
}

/// Computes every row of `left` · `right`, panel by panel.
#[expect(
    clippy::inline_always,
    reason = "only what is inlined into the dispatch is compiled for the processor"
)]
#[inline(always)]
pub(super) fn products<S: Simd, F: Finish>(
    simd: S,
    left: Left<'_>,
    rows: usize,
    right: Right<'_>,
    finish: &mut F,
) {
    let mut column = 0;
    while column + PANEL <= right.stride {
        panel::<S, F, 4>(simd, left, rows, right, column, finish);
        column += PANEL;
    }
    if column + 2 * GROUP <= right.stride {
        panel::<S, F, 2>(simd, left, rows, right, column, finish);
        column += 2 * GROUP;
    }
    if column < right.stride {
        panel::<S, F, 1>(simd, left, rows, right, column, finish);
    }
}

#[expect(clippy::inline_always, reason = "as above")]
#[inline(always)]
fn panel<S: Simd, F: Finish, const GROUPS: usize>(
    simd: S,
    left: Left<'_>,
    rows: usize,
    right: Right<'_>,
    column: usize,
    finish: &mut F,
) {
    let vectors = const { GROUPS * GROUP / S::F32_LANES };
    // Two rows at a time if the registers can hold the sums of both, because additions to one row
    // depend on each other.
    let two = const { S::F32_LANES >= GROUP };
    let mut row = 0;
    while two && row + 2 <= rows {
        let sums = two_rows::<S, GROUPS>(simd, left, row, right, column);
        finish.finish(simd, row, column, &sums[0][..vectors]);
        finish.finish(simd, row + 1, column, &sums[1][..vectors]);
        row += 2;
    }
    while row < rows {
        let mut sums = [simd.splat_f32s(0.0); PANEL];
        for word in 0..left.words {
            let bits = left.word(row, word);
            add_rows::<S, GROUPS>(
                simd,
                left.at(row, word),
                bits,
                right.at(word, column),
                &mut sums,
            );
        }
        finish.finish(simd, row, column, &sums[..vectors]);
        row += 1;
    }
}

#[expect(clippy::inline_always, reason = "as above")]
#[inline(always)]
fn two_rows<S: Simd, const GROUPS: usize>(
    simd: S,
    left: Left<'_>,
    row: usize,
    right: Right<'_>,
    column: usize,
) -> [Sums<S>; 2] {
    let mut first = [simd.splat_f32s(0.0); PANEL];
    let mut second = first;
    for word in 0..left.words {
        let right = right.at(word, column);
        let mut bits = [left.word(row, word), left.word(row + 1, word)];
        let factors = [left.at(row, word), left.at(row + 1, word)];
        check::<GROUPS>(bits[0], factors[0], right);
        check::<GROUPS>(bits[1], factors[1], right);
        while bits[0] != 0 && bits[1] != 0 {
            // SAFETY: all bits were checked.
            unsafe {
                add_row::<S, GROUPS>(simd, factors[0], bits[0].trailing_zeros(), right, &mut first);
                add_row::<S, GROUPS>(
                    simd,
                    factors[1],
                    bits[1].trailing_zeros(),
                    right,
                    &mut second,
                );
            }
            bits[0] &= bits[0] - 1;
            bits[1] &= bits[1] - 1;
        }
        add_rows::<S, GROUPS>(simd, factors[0], bits[0], right, &mut first);
        add_rows::<S, GROUPS>(simd, factors[1], bits[1], right, &mut second);
    }
    [first, second]
}

/// Adds the rows whose bits are set to `sums`.
#[expect(clippy::inline_always, reason = "as above")]
#[inline(always)]
fn add_rows<S: Simd, const GROUPS: usize>(
    simd: S,
    factors: Factors<'_>,
    mut bits: u64,
    right: Right<'_>,
    sums: &mut Sums<S>,
) {
    check::<GROUPS>(bits, factors, right);
    while bits != 0 {
        // SAFETY: all bits were checked.
        unsafe { add_row::<S, GROUPS>(simd, factors, bits.trailing_zeros(), right, sums) };
        bits &= bits - 1;
    }
}

/// Checks that both operands contain the row of the highest bit.
#[expect(clippy::inline_always, reason = "as above")]
#[inline(always)]
fn check<const GROUPS: usize>(bits: u64, factors: Factors<'_>, right: Right<'_>) {
    let places = WORD - bits.leading_zeros() as usize;
    if let Some(last) = places.checked_sub(1) {
        assert!(last * factors.stride < factors.values.len(), "a factor of each bit");
        let end = last * right.stride + const { GROUPS * GROUP };
        assert!(end <= right.values.len(), "a row of each bit");
    }
}

/// # Safety
/// `place` must be that of a bit for which [`check`] found that both operands contain its row.
#[expect(clippy::inline_always, reason = "as above")]
#[inline(always)]
unsafe fn add_row<S: Simd, const GROUPS: usize>(
    simd: S,
    factors: Factors<'_>,
    place: u32,
    right: Right<'_>,
    sums: &mut Sums<S>,
) {
    let width = const { GROUPS * GROUP };
    let place = place as usize;
    // SAFETY: the caller checked that both lie inside.
    let (factor, row) = unsafe {
        let first = place * right.stride;
        (
            factors.values.get_unchecked(place * factors.stride),
            right.values.get_unchecked(first..first + width),
        )
    };
    let factor = simd.splat_f32s(*factor);
    let row = S::as_simd_f32s(row).0;
    for (vector, sum) in sums.iter_mut().take(const { GROUPS * GROUP / S::F32_LANES }).enumerate() {
        *sum = simd.mul_add_f32s(factor, row[vector], *sum);
    }
}

/// The factors of one word of a row.
#[derive(Clone, Copy)]
struct Factors<'a> {
    values: &'a [f32],
    stride: usize,
}

impl<'a> Left<'a> {
    #[expect(clippy::inline_always, reason = "as above")]
    #[inline(always)]
    fn word(&self, row: usize, word: usize) -> u64 {
        self.bits[row * self.word_stride + word]
    }

    #[expect(clippy::inline_always, reason = "as above")]
    #[inline(always)]
    fn at(&self, row: usize, word: usize) -> Factors<'a> {
        let first = row * self.row_stride + word * WORD * self.column_stride;
        Factors { values: &self.values[first..], stride: self.column_stride }
    }
}

impl<'a> Right<'a> {
    /// Returns the rows of a word, from a column on.
    #[expect(clippy::inline_always, reason = "as above")]
    #[inline(always)]
    fn at(&self, word: usize, column: usize) -> Right<'a> {
        let first = word * WORD * self.stride + column;
        Right { values: &self.values[first..], stride: self.stride }
    }
}

/// Returns a bit for each value of a vector that is not zero.
#[expect(clippy::inline_always, reason = "as above")]
#[inline(always)]
pub(super) fn nonzero<S: Simd>(simd: S, values: S::f32s) -> u64 {
    let zeros = simd.equal_f32s(values, simd.splat_f32s(0.0));
    let bytes = bytemuck::bytes_of(&zeros);
    if let (16, &[low, high]) = (S::F32_LANES, bytes) {
        return u64::from(!u16::from_le_bytes([low, high]));
    }
    let step = bytes.len() / S::F32_LANES;
    let mut bits = 0;
    for lane in 0..S::F32_LANES {
        bits |= u64::from(!bytes[lane * step] & 1) << lane;
    }
    bits
}

/// Sets the bits of a panel, which begins at this column. Panels must be processed in order.
#[expect(clippy::inline_always, reason = "as above")]
#[inline(always)]
pub(super) fn put(words: &mut [u64], column: usize, bits: u64) {
    let word = &mut words[column / WORD];
    let before = if column.is_multiple_of(WORD) { 0 } else { *word };
    *word = before | bits << (column % WORD);
}
