//! The time warp edit distance, computed along the diagonals i + j = k. The cells of a diagonal do
//! not depend on each other.

use super::dispatch::InstructionSet;

/// A pair of series with the reference reversed: on a diagonal, i grows while j falls.
pub(crate) struct EditInput {
    /// Query values, `[channels][n + 1]`, starting with the zero before the first sample.
    pub(crate) query: Vec<Vec<f64>>,
    /// Reversed reference values, `[channels][m + 1]`, ending with the zero before the first
    /// sample.
    pub(crate) reference: Vec<Vec<f64>>,
    /// Price of deleting query sample i, `[n + 1]`.
    pub(crate) query_deletions: Vec<f64>,
    /// Price of deleting reference sample m − j, `[m + 1]`.
    pub(crate) reference_deletions: Vec<f64>,
    pub(crate) stiffness: f64,
    /// Numbers of samples of query and reference.
    pub(crate) lengths: (usize, usize),
}

/// The cells of one diagonal, indexed by i.
struct Diagonal {
    cumulated: Vec<f64>,
    /// The local distance of samples i and j, summed over channels.
    local: Vec<f64>,
}

impl Diagonal {
    fn new(n: usize) -> Self {
        Self { cumulated: vec![f64::INFINITY; n + 1], local: vec![0.0; n + 1] }
    }
}

#[inline(always)]
fn least(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}

#[inline(always)]
fn distance(input: &EditInput) -> f64 {
    let (n, m) = input.lengths;
    let mut now = Diagonal::new(n);
    let mut one = Diagonal::new(n);
    let mut two = Diagonal::new(n);
    // Diagonal 0 is the cell (0, 0). Diagonal 1 has only cells without a path.
    two.cumulated[0] = 0.0;
    for k in 2..=n + m {
        // Cells with 1 ≤ i ≤ n and 1 ≤ j = k − i ≤ m.
        let first = k.saturating_sub(m).max(1);
        let last = (k - 1).min(n);
        let cells = first..last + 1;
        // Reference sample j lies at m − j = i − (k − m) of the reversed series.
        let reversed = m + first - k..m + last + 1 - k;
        let local = &mut now.local[cells.clone()];
        local.fill(0.0);
        for (x, y) in input.query.iter().zip(&input.reference) {
            let pairs = x[cells.clone()].iter().zip(&y[reversed.clone()]);
            for (local, (x, y)) in local.iter_mut().zip(pairs) {
                *local += (x - y).abs();
            }
        }
        let before = first - 1..last;
        let matched = two.cumulated[before.clone()].iter().zip(&two.local[before.clone()]);
        let matched = matched.zip(&now.local[cells.clone()]);
        let query = one.cumulated[before].iter().zip(&input.query_deletions[cells.clone()]);
        let reference =
            one.cumulated[cells.clone()].iter().zip(&input.reference_deletions[reversed]);
        // 2 |i − j| = 2 |2i − k|, stored as a float that grows by 4.
        let offset = 2.0 * (2.0 * first as f64 - k as f64);
        let ways = matched.zip(query.zip(reference)).enumerate();
        for (out, (step, (matched, (query, reference)))) in
            now.cumulated[cells].iter_mut().zip(ways)
        {
            let ((&origin, &local_before), &local) = matched;
            let apart = (offset + 4.0 * f64::from(step as u32)).abs();
            let matched = origin + ((local + local_before) + input.stiffness * apart);
            let deleted = least(query.0 + query.1, reference.0 + reference.1);
            *out = least(matched, deleted);
        }
        // The cells beside these are outside the rectangle. They must not keep values of older
        // diagonals.
        now.cumulated[first - 1] = f64::INFINITY;
        if let Some(beyond) = now.cumulated.get_mut(last + 1) {
            *beyond = f64::INFINITY;
        }
        // The oldest diagonal becomes the next one.
        std::mem::swap(&mut two, &mut one);
        std::mem::swap(&mut one, &mut now);
    }
    one.cumulated[n]
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn distance_avx2(input: &EditInput) -> f64 {
    distance(input)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f")]
fn distance_avx512(input: &EditInput) -> f64 {
    distance(input)
}

/// Returns the distance with the instructions of `set`, which must be available.
pub(crate) fn edit_dispatch(set: InstructionSet, input: &EditInput) -> f64 {
    debug_assert!(InstructionSet::available().contains(&set));
    match set {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: the caller guarantees that the processor has these instructions.
        InstructionSet::Avx2 => unsafe { distance_avx2(input) },
        #[cfg(target_arch = "x86_64")]
        // SAFETY: the caller guarantees that the processor has these instructions.
        InstructionSet::Avx512 => unsafe { distance_avx512(input) },
        _ => distance(input),
    }
}
