use pulp::{Simd, WithSimd};

use super::{
    Narrow,
    products::{Finish, GROUP, Left, Right, nonzero, products, put},
    words_of,
};
use crate::{Layer, aligned::Aligned};

/// The forward pass, from inputs to outputs.
pub(crate) struct Forward<'a> {
    pub(crate) layers: &'a [Layer],
    pub(crate) parameters: &'a [f32],
    pub(crate) input: &'a [f32],
    pub(crate) rows: usize,
    pub(crate) activations: &'a mut [Aligned<f32>],
    pub(crate) narrow: &'a mut Narrow,
}

impl WithSimd for Forward<'_> {
    type Output = ();

    #[expect(
        clippy::inline_always,
        reason = "only what is inlined into the dispatch is compiled for the processor"
    )]
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { layers, parameters, input, rows, activations, narrow } = self;
        let Narrow { all, active, output_weights, .. } = narrow;
        for (index, layer) in layers.iter().enumerate() {
            let (before, after) = activations.split_at_mut(index);
            let output = &mut after[0][..rows * layer.outputs];
            let (active_before, active_after) = active.split_at_mut(index);
            let weights = &parameters[layer.weights.clone()];
            let bias = &parameters[layer.bias.clone()];
            let left = Left {
                values: before.last().map_or(input, |values| &values[..]),
                row_stride: layer.inputs,
                column_stride: 1,
                bits: active_before.last().unwrap_or(all),
                words: words_of(layer.inputs),
                word_stride: if index == 0 { 0 } else { words_of(layer.inputs) },
            };
            if let Some(active) = active_after.first_mut() {
                let words = words_of(layer.outputs);
                let right = Right { values: weights, stride: layer.outputs };
                products(simd, left, rows, right, &mut Rectified { bias, output, active, words });
            } else {
                pad(weights, layer.outputs, output_weights);
                outputs(simd, left, rows, output_weights, bias, output);
            }
        }
    }
}

/// Activations of a hidden layer.
struct Rectified<'a> {
    bias: &'a [f32],
    output: &'a mut [f32],
    active: &'a mut [u64],
    words: usize,
}

impl Finish for Rectified<'_> {
    #[expect(clippy::inline_always, reason = "as the products")]
    #[inline(always)]
    fn finish<S: Simd>(&mut self, simd: S, row: usize, column: usize, sums: &[S::f32s]) {
        let count = sums.len() * S::F32_LANES;
        let zero = simd.splat_f32s(0.0);
        let bias = S::as_simd_f32s(&self.bias[column..][..count]).0;
        let output = &mut self.output[row * self.bias.len() + column..][..count];
        let output = S::as_mut_simd_f32s(output).0;
        let mut bits = 0;
        for (vector, &sum) in sums.iter().enumerate() {
            let sum = simd.add_f32s(sum, bias[vector]);
            // NaN must stay NaN: a diverged network must not look like a dead one.
            let value = simd.select_f32s(simd.less_than_f32s(sum, zero), zero, sum);
            output[vector] = value;
            bits |= nonzero(simd, value) << (vector * S::F32_LANES);
        }
        put(&mut self.active[row * self.words..], column, bits);
    }
}

/// Copies rows of `columns` values into rows of [`GROUP`]. The values beyond `columns` are
/// arbitrary.
#[expect(clippy::inline_always, reason = "as the products")]
#[inline(always)]
fn pad(values: &[f32], columns: usize, padded: &mut [f32]) {
    for (row, padded) in padded.as_chunks_mut::<GROUP>().0.iter_mut().enumerate() {
        let rest = &values[row * columns..];
        match rest.first_chunk::<GROUP>() {
            Some(whole) => *padded = *whole,
            None => padded[..columns].copy_from_slice(&rest[..columns]),
        }
    }
}

/// Computes the outputs of the last layer. There are few columns, so several rows are summed at a
/// time.
#[expect(clippy::inline_always, reason = "as the products")]
#[inline(always)]
fn outputs<S: Simd>(
    simd: S,
    left: Left<'_>,
    rows: usize,
    weights: &[f32],
    bias: &[f32],
    output: &mut [f32],
) {
    let mut row = 0;
    while row + 8 <= rows {
        output_rows::<S, 8>(simd, left, row, weights, bias, output);
        row += 8;
    }
    while row < rows {
        output_rows::<S, 1>(simd, left, row, weights, bias, output);
        row += 1;
    }
}

#[expect(clippy::inline_always, reason = "as the products")]
#[inline(always)]
fn output_rows<S: Simd, const ROWS: usize>(
    simd: S,
    left: Left<'_>,
    first: usize,
    weights: &[f32],
    bias: &[f32],
    output: &mut [f32],
) {
    let vectors = const { GROUP / S::F32_LANES };
    let inputs = left.row_stride;
    let mut sums = [[simd.splat_f32s(0.0); GROUP]; ROWS];
    let weights = weights.as_chunks::<GROUP>().0;
    let rows: [&[f32]; ROWS] =
        std::array::from_fn(|row| &left.values[(first + row) * inputs..][..inputs]);
    for (place, weights) in weights[..inputs].iter().enumerate() {
        let weights = S::as_simd_f32s(weights).0;
        for (sums, row) in sums.iter_mut().zip(rows) {
            let factor = simd.splat_f32s(row[place]);
            for vector in 0..vectors {
                sums[vector] = simd.mul_add_f32s(factor, weights[vector], sums[vector]);
            }
        }
    }
    let columns = bias.len();
    for (row, sums) in sums.iter().enumerate() {
        let mut values = [0.0; GROUP];
        S::as_mut_simd_f32s(&mut values).0.copy_from_slice(&sums[..vectors]);
        let output = &mut output[(first + row) * columns..][..columns];
        for ((output, value), bias) in output.iter_mut().zip(values).zip(bias) {
            *output = value + bias;
        }
    }
}
