//! Element-wise passes, compiled for the widest vectors of the processor.
//!
//! Each is plain Rust under [`pulp`]'s dispatch, and the compiler vectorises it. The order of
//! operations is the order in the code, so results do not depend on the width of the vectors.

use pulp::{Arch, NullaryFnOnce};

struct AddBias<'a, const RECTIFY: bool> {
    outputs: &'a mut [f32],
    bias: &'a [f32],
}

impl<const RECTIFY: bool> NullaryFnOnce for AddBias<'_, RECTIFY> {
    type Output = ();

    #[expect(
        clippy::inline_always,
        reason = "only what is inlined into the dispatch is compiled for the processor"
    )]
    #[inline(always)]
    fn call(self) {
        for row in self.outputs.chunks_exact_mut(self.bias.len()) {
            for (output, bias) in row.iter_mut().zip(self.bias) {
                let sum = *output + bias;
                // NaN must stay NaN: a diverged network must not look like a dead one.
                *output = if RECTIFY && sum < 0.0 { 0.0 } else { sum };
            }
        }
    }
}

/// Computes `outputs[r, j] += bias[j]`.
pub(crate) fn add_bias(outputs: &mut [f32], bias: &[f32]) {
    Arch::new().dispatch(AddBias::<false> { outputs, bias });
}

/// Computes `outputs[r, j] = max(outputs[r, j] + bias[j], 0)`. NaN stays NaN.
pub(crate) fn add_bias_and_rectify(outputs: &mut [f32], bias: &[f32]) {
    Arch::new().dispatch(AddBias::<true> { outputs, bias });
}

struct SumRows<'a> {
    rows: &'a [f32],
    sums: &'a mut [f32],
}

impl NullaryFnOnce for SumRows<'_> {
    type Output = ();

    #[expect(
        clippy::inline_always,
        reason = "only what is inlined into the dispatch is compiled for the processor"
    )]
    #[inline(always)]
    fn call(self) {
        self.sums.fill(0.0);
        for row in self.rows.chunks_exact(self.sums.len()) {
            for (sum, value) in self.sums.iter_mut().zip(row) {
                *sum += value;
            }
        }
    }
}

/// Computes `sums[j] = Σ_r rows[r, j]`.
pub(crate) fn sum_rows(rows: &[f32], sums: &mut [f32]) {
    Arch::new().dispatch(SumRows { rows, sums });
}

struct Mask<'a> {
    deltas: &'a mut [f32],
    activations: &'a [f32],
    sums: &'a mut [f32],
}

impl NullaryFnOnce for Mask<'_> {
    type Output = ();

    #[expect(
        clippy::inline_always,
        reason = "only what is inlined into the dispatch is compiled for the processor"
    )]
    #[inline(always)]
    fn call(self) {
        let width = self.sums.len();
        self.sums.fill(0.0);
        let rows = self.deltas.chunks_exact_mut(width);
        for (delta, activation) in rows.zip(self.activations.chunks_exact(width)) {
            for ((delta, activation), sum) in delta.iter_mut().zip(activation).zip(&mut *self.sums)
            {
                *delta = if *activation > 0.0 { *delta } else { 0.0 };
                *sum += *delta;
            }
        }
    }
}

/// Computes the gradient through `ReLU`: sets `deltas[r, j] = 0` where the activation is not
/// positive. The same pass computes the column sums, which are the gradient of the bias.
pub(crate) fn mask_and_sum_rows(deltas: &mut [f32], activations: &[f32], sums: &mut [f32]) {
    assert_eq!(deltas.len(), activations.len());
    Arch::new().dispatch(Mask { deltas, activations, sums });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rectifying_keeps_nan_and_drops_negatives() {
        let mut outputs = [1.0, -3.0, f32::NAN, -0.5];
        add_bias_and_rectify(&mut outputs, &[0.5, 1.0]);
        assert_eq!(outputs[..2], [1.5, 0.0]);
        assert!(outputs[2].is_nan());
        assert_eq!(outputs[3], 0.5);
        let mut outputs = [1.0, -3.0];
        add_bias(&mut outputs, &[0.5, 1.0]);
        assert_eq!(outputs, [1.5, -2.0]);
    }

    #[test]
    fn masking_passes_gradients_of_active_units_only() {
        let mut deltas = [1.0, 2.0, 3.0, 4.0];
        let mut sums = [9.0; 2];
        mask_and_sum_rows(&mut deltas, &[0.1, 0.0, 5.0, 0.2], &mut sums);
        assert_eq!(deltas, [1.0, 0.0, 3.0, 4.0]);
        assert_eq!(sums, [4.0, 4.0]);
        sum_rows(&[1.0, 2.0, 3.0, 4.0], &mut sums);
        assert_eq!(sums, [4.0, 6.0]);
    }
}
