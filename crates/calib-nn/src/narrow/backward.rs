use pulp::{Simd, WithSimd, bytemuck};

use super::{
    Narrow,
    products::{Finish, Left, Right, WORD, nonzero, products, put},
    transpose::transpose,
    words_of,
};
use crate::{
    Layer,
    aligned::Aligned,
    sink::{Kept, Sink},
};

/// The buffers of [`Backward`] besides gradients.
pub(crate) struct NarrowBuffers<'a> {
    pub(crate) activations: &'a [Aligned<f32>],
    pub(crate) deltas: &'a mut [Aligned<f32>; 2],
    pub(crate) narrow: &'a mut Narrow,
}

impl NarrowBuffers<'_> {
    /// Prepares for [`Backward`], which no longer reads the weights.
    pub(crate) fn set_weights(&mut self, layers: &[Layer], parameters: &[f32]) {
        for (transposed, layer) in self.narrow.transposed.iter_mut().zip(&layers[1..]) {
            transpose(&parameters[layer.weights.clone()], layer.inputs, layer.outputs, transposed);
        }
    }
}

/// The backward pass, from the gradient of the outputs to those of all parameters. It passes them
/// to a sink.
pub(crate) struct Backward<'a, T> {
    pub(crate) layers: &'a [Layer],
    pub(crate) input: &'a [f32],
    pub(crate) output_gradient: &'a [f32],
    pub(crate) rows: usize,
    pub(crate) buffers: NarrowBuffers<'a>,
    pub(crate) sink: T,
}

impl<T: Sink> WithSimd for Backward<'_, T> {
    type Output = ();

    #[expect(
        clippy::inline_always,
        reason = "only what is inlined into the dispatch is compiled for the processor"
    )]
    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        self.output_layer(simd);
        for index in (0..self.layers.len() - 1).rev() {
            self.hidden_layer(simd, index);
        }
    }
}

impl<T: Sink> Backward<'_, T> {
    #[expect(clippy::inline_always, reason = "as the pass")]
    #[inline(always)]
    fn output_layer<S: Simd>(&mut self, simd: S) {
        let last = self.layers.len() - 1;
        let layer = &self.layers[last];
        let rows = self.rows;
        let NarrowBuffers { activations, deltas, narrow } = &mut self.buffers;
        let Narrow { transposed, errors, columns, bias_gradient, output_gradient, .. } =
            &mut **narrow;
        let gradient = self.output_gradient;
        let outputs = layer.outputs;
        bias_gradient[..outputs].fill(0.0);
        columns[..outputs].fill(0);
        for (row, gradient) in gradient.chunks_exact(outputs).enumerate() {
            let mut bits = 0;
            for (output, &value) in gradient.iter().enumerate() {
                bias_gradient[output] += value;
                let bit = u64::from(value != 0.0);
                bits |= bit << output;
                columns[output] |= bit << row;
            }
            errors[0][row] = bits;
        }
        self.sink.take(simd, layer.bias.start, &bias_gradient[..outputs]);
        let activation = &activations[last - 1][..rows * layer.inputs];
        bias_gradient[..layer.inputs].fill(0.0);
        let [bits, bits_before] = errors;
        let words = words_of(layer.inputs);
        products(
            simd,
            Left {
                values: gradient,
                row_stride: outputs,
                column_stride: 1,
                bits,
                words: 1,
                word_stride: 1,
            },
            rows,
            Right { values: &transposed[last - 1], stride: layer.inputs },
            &mut Errors {
                activation,
                width: layer.inputs,
                out: &mut deltas[0],
                bias_gradient,
                bits: bits_before,
                words,
            },
        );
        let [transposed, in_order] = output_gradient;
        products(
            simd,
            Left {
                values: gradient,
                row_stride: 1,
                column_stride: outputs,
                bits: columns,
                words: 1,
                word_stride: 1,
            },
            outputs,
            Right { values: activation, stride: layer.inputs },
            &mut Gradient { sink: &mut Kept(transposed), start: 0, width: layer.inputs },
        );
        transpose(transposed, outputs, layer.inputs, in_order);
        self.sink.take(simd, layer.weights.start, in_order);
        errors.swap(0, 1);
    }

    #[expect(clippy::inline_always, reason = "as the pass")]
    #[inline(always)]
    fn hidden_layer<S: Simd>(&mut self, simd: S, index: usize) {
        let layer = &self.layers[index];
        let rows = self.rows;
        let NarrowBuffers { activations, deltas, narrow } = &mut self.buffers;
        let Narrow { transposed, errors, columns, bias_gradient, .. } = &mut **narrow;
        self.sink.take(simd, layer.bias.start, &bias_gradient[..layer.outputs]);
        let [delta, delta_before] = &mut **deltas;
        if index > 0 {
            bias_gradient[..layer.inputs].fill(0.0);
            let [bits, bits_before] = errors;
            let words = words_of(layer.inputs);
            products(
                simd,
                Left {
                    values: delta,
                    row_stride: layer.outputs,
                    column_stride: 1,
                    bits,
                    words: words_of(layer.outputs),
                    word_stride: words_of(layer.outputs),
                },
                rows,
                Right { values: &transposed[index - 1], stride: layer.inputs },
                &mut Errors {
                    activation: &activations[index - 1],
                    width: layer.inputs,
                    out: delta_before,
                    bias_gradient,
                    bits: bits_before,
                    words,
                },
            );
        }
        let inputs = if index == 0 { self.input } else { &activations[index - 1] };
        let inputs = &inputs[..rows * layer.inputs];
        by_columns(inputs, layer.inputs, columns);
        products(
            simd,
            Left {
                values: inputs,
                row_stride: 1,
                column_stride: layer.inputs,
                bits: columns,
                words: 1,
                word_stride: 1,
            },
            layer.inputs,
            Right { values: &delta[..rows * layer.outputs], stride: layer.outputs },
            &mut Gradient {
                sink: &mut self.sink,
                start: layer.weights.start,
                width: layer.outputs,
            },
        );
        deltas.swap(0, 1);
        errors.swap(0, 1);
    }
}

/// Writes for each column the rows in which it is not zero, as bits.
#[inline(always)]
fn by_columns(values: &[f32], width: usize, columns: &mut [u64]) {
    // Half a word has as many bits as a value, so a vector contains equally many of both.
    const HALF: usize = WORD / 2;
    const AT_ONCE: usize = 64;
    for (half, values) in values.chunks(HALF * width).enumerate() {
        for (block, columns) in columns[..width].chunks_mut(AT_ONCE).enumerate() {
            let mut bits = [0_u32; AT_ONCE];
            for (row, values) in values.chunks_exact(width).enumerate() {
                let values = &values[block * AT_ONCE..][..columns.len()];
                for (bits, &value) in bits.iter_mut().zip(values) {
                    *bits |= u32::from(value != 0.0) << row;
                }
            }
            for (word, &bits) in columns.iter_mut().zip(&bits) {
                let before = if half == 0 { 0 } else { *word };
                *word = before | u64::from(bits) << (half * HALF);
            }
        }
    }
}

/// Errors of a hidden layer: zero where its activation is not positive.
struct Errors<'a> {
    activation: &'a [f32],
    width: usize,
    out: &'a mut [f32],
    /// The sums of the errors.
    bias_gradient: &'a mut [f32],
    bits: &'a mut [u64],
    words: usize,
}

impl Finish for Errors<'_> {
    #[expect(clippy::inline_always, reason = "as the products")]
    #[inline(always)]
    fn finish<S: Simd>(&mut self, simd: S, row: usize, column: usize, sums: &[S::f32s]) {
        let count = sums.len() * S::F32_LANES;
        let zero = simd.splat_f32s(0.0);
        let at = row * self.width + column;
        let activation = S::as_simd_f32s(&self.activation[at..][..count]).0;
        let errors = S::as_mut_simd_f32s(&mut self.out[at..][..count]).0;
        let totals = S::as_mut_simd_f32s(&mut self.bias_gradient[column..][..count]).0;
        let mut bits = 0;
        for (vector, &sum) in sums.iter().enumerate() {
            let active = simd.greater_than_f32s(activation[vector], zero);
            let error = simd.select_f32s(active, sum, zero);
            errors[vector] = error;
            totals[vector] = simd.add_f32s(totals[vector], error);
            bits |= nonzero(simd, error) << (vector * S::F32_LANES);
        }
        put(&mut self.bits[row * self.words..], column, bits);
    }
}

/// Gradients of weights.
struct Gradient<'a, T> {
    sink: &'a mut T,
    start: usize,
    width: usize,
}

impl<T: Sink> Finish for Gradient<'_, T> {
    #[expect(clippy::inline_always, reason = "as the products")]
    #[inline(always)]
    fn finish<S: Simd>(&mut self, simd: S, row: usize, column: usize, sums: &[S::f32s]) {
        let at = self.start + row * self.width + column;
        self.sink.take(simd, at, bytemuck::cast_slice(sums));
    }
}
