//! The processing of the sums of each product of a network.

use pulp::Simd;

use super::{
    kernel::{Kernel, ROWS, Tile},
    layout::{Panels, Rows, half_of_block, halves, part},
    number::{firsts, rectified, seconds, without_small},
    panel::{HALF, PANEL},
    product::Finish,
};
use crate::sink::Sink;

/// The matrices that receive rounded values, as operands of later products.
pub(super) struct Operands<'a> {
    /// The operand of products over features.
    pub(super) rows: &'a mut Rows,
    /// The operand of products over rows of the batch. It receives only the first `learnt` rows.
    pub(super) panels: &'a mut Panels,
    pub(super) learnt: usize,
}

impl Operands<'_> {
    /// Rounds and stores these rows. The first row number is even.
    #[expect(clippy::inline_always, reason = "as the product")]
    #[inline(always)]
    fn take<K: Kernel>(
        &mut self,
        kernel: K,
        numbers: &[[f32; PANEL]],
        first_row: usize,
        panel: usize,
    ) {
        into_rows(kernel, numbers, self.rows, first_row, panel);
        if first_row < self.learnt {
            let rows = numbers.len().min(self.learnt - first_row);
            into_panels(kernel, &numbers[..rows], self.panels, first_row, panel);
        }
    }
}

/// Activations of a hidden layer: sums that begin with the bias, with negative values set to 0, rounded.
pub(super) struct Activations<'a> {
    /// The bias, padded with zeros to whole panels.
    pub(super) bias: &'a [[f32; PANEL]],
    pub(super) to: Operands<'a>,
}

impl Finish for Activations<'_> {
    fn begin(&self, panel: usize) -> [f32; PANEL] {
        self.bias[panel]
    }

    #[expect(clippy::inline_always, reason = "as the product")]
    #[inline(always)]
    fn finish<K: Kernel>(
        &mut self,
        kernel: K,
        sums: &[[f32; PANEL]],
        room: &mut Tile,
        first_row: usize,
        panel: usize,
    ) {
        for (sums, values) in sums.iter().zip(&mut room.0) {
            let sums = K::Simd::as_simd_f32s(sums).0;
            for (value, &sum) in K::Simd::as_mut_simd_f32s(values).0.iter_mut().zip(sums) {
                *value = rectified(kernel.simd(), sum);
            }
        }
        self.to.take(kernel, &room.0[..sums.len()], first_row, panel);
    }
}

/// Errors of a hidden layer: zero where its activation is not positive.
pub(super) struct Errors<'a> {
    pub(super) activations: &'a Rows,
    /// The sums of the errors over the rows, before rounding.
    pub(super) bias_gradient: &'a mut [[f32; PANEL]],
    /// The operand for the gradient of this layer's weights, and for the errors of the previous layer.
    pub(super) to: Operands<'a>,
}

impl Finish for Errors<'_> {
    #[expect(clippy::inline_always, reason = "as the product")]
    #[inline(always)]
    fn finish<K: Kernel>(
        &mut self,
        kernel: K,
        sums: &[[f32; PANEL]],
        room: &mut Tile,
        first_row: usize,
        panel: usize,
    ) {
        let simd = kernel.simd();
        let zero = simd.splat_f32s(0.0);
        let mut totals = [0.0; PANEL];
        let of_totals = K::Simd::as_mut_simd_f32s(&mut totals).0;
        for (row, (sums, errors)) in sums.iter().zip(&mut room.0).enumerate() {
            let activations = numbers(kernel, self.activations, first_row + row, panel);
            let activations = K::Simd::as_simd_f32s(&activations).0;
            let sums = K::Simd::as_simd_f32s(sums).0;
            let errors = K::Simd::as_mut_simd_f32s(errors).0;
            for (vector, error) in errors.iter_mut().enumerate() {
                let active = simd.greater_than_f32s(activations[vector], zero);
                *error = without_small(simd, simd.select_f32s(active, sums[vector], zero));
                of_totals[vector] = simd.add_f32s(of_totals[vector], *error);
            }
        }
        let bias_gradient = &mut self.bias_gradient[panel];
        if first_row == 0 {
            *bias_gradient = [0.0; PANEL];
        }
        for (sum, total) in bias_gradient.iter_mut().zip(totals) {
            *sum += total;
        }
        self.to.take(kernel, &room.0[..sums.len()], first_row, panel);
    }
}

/// The gradient of weights `[inputs, outputs]`.
pub(super) struct Gradient<'a, S> {
    pub(super) sink: &'a mut S,
    /// Position of the weights among the parameters.
    pub(super) start: usize,
    /// Number of outputs.
    pub(super) columns: usize,
}

impl<S> Gradient<'_, S> {
    /// Returns the position of the first weight of a tile's row, and the number of weights.
    #[expect(clippy::inline_always, reason = "as the product")]
    #[inline(always)]
    fn place(&self, row: usize, panel: usize) -> (usize, usize) {
        let first_column = panel * PANEL;
        (self.start + row * self.columns + first_column, PANEL.min(self.columns - first_column))
    }
}

impl<S: Sink> Finish for Gradient<'_, S> {
    #[expect(clippy::inline_always, reason = "as the product")]
    #[inline(always)]
    fn prepare<K: Kernel>(&self, kernel: K, first_row: usize, rows: usize, panel: usize) {
        for row in first_row..first_row + rows {
            let (at, width) = self.place(row, panel);
            self.sink.touched(at, width).for_each(|values| kernel.prefetch(values));
        }
    }

    #[expect(clippy::inline_always, reason = "as the product")]
    #[inline(always)]
    fn finish<K: Kernel>(
        &mut self,
        kernel: K,
        sums: &[[f32; PANEL]],
        _room: &mut Tile,
        first_row: usize,
        panel: usize,
    ) {
        for (row, sums) in sums.iter().enumerate() {
            let (at, width) = self.place(first_row + row, panel);
            // A whole panel is processed as vectors. A slice of unknown length would become a loop or a call.
            if width == PANEL {
                self.sink.take(kernel.simd(), at, sums);
            } else {
                self.sink.take(kernel.simd(), at, &sums[..width]);
            }
        }
    }
}

/// Returns a block of a row in single precision, feature after feature, padded with zeros.
#[expect(clippy::inline_always, reason = "as the product")]
#[inline(always)]
fn numbers<K: Kernel>(kernel: K, rows: &Rows, row: usize, block: usize) -> [f32; PANEL] {
    let simd = kernel.simd();
    let pairs = K::Simd::as_simd_u32s(&rows.from(row)[block]).0;
    let mut numbers = [0.0; PANEL];
    let (to, _) = numbers.as_chunks_mut::<HALF>();
    let [first, second] = to else { unreachable!("two halves") };
    let first = K::Simd::as_mut_simd_f32s(first).0;
    let second = K::Simd::as_mut_simd_f32s(second).0;
    for (vector, &pairs) in pairs.iter().enumerate() {
        first[vector] = firsts(simd, pairs);
        second[vector] = seconds(simd, pairs);
    }
    let half = half_of_block(block * PANEL, rows.columns());
    if half < HALF {
        numbers.copy_within(HALF..HALF + half, half);
    }
    numbers
}

/// Stores the rows of a tile with features paired.
#[expect(clippy::inline_always, reason = "as the product")]
#[inline(always)]
fn into_rows<K: Kernel>(
    kernel: K,
    numbers: &[[f32; PANEL]],
    to: &mut Rows,
    first_row: usize,
    block: usize,
) {
    let half = half_of_block(block * PANEL, to.columns());
    let rows = numbers.iter().zip(to.blocks_mut(first_row, block));
    if half == HALF {
        for (numbers, to) in rows {
            let [first, second] = halves(numbers);
            join_all(kernel, first, second, to);
        }
    } else {
        for (numbers, to) in rows {
            join_all(kernel, &part(&numbers[..half]), &part(&numbers[half..2 * half]), to);
        }
    }
}

/// Stores the rows of a tile with adjacent rows paired. The first row number is even. A missing last row is zeros.
#[expect(clippy::inline_always, reason = "as the product")]
#[inline(always)]
fn into_panels<K: Kernel>(
    kernel: K,
    numbers: &[[f32; PANEL]],
    to: &mut Panels,
    first_row: usize,
    panel: usize,
) {
    let to = &mut to.panel_mut(panel)[first_row / 2..];
    let (pairs, last) = numbers.as_chunks::<2>();
    for ([first, second], to) in pairs.iter().zip(&mut *to) {
        join_all(kernel, first, second, to);
    }
    if let [last] = last {
        join_all(kernel, last, &[0.0; PANEL], &mut to[pairs.len()]);
    }
}

/// Returns the pairs of first and second numbers.
#[expect(clippy::inline_always, reason = "as the product")]
#[inline(always)]
fn join_all<K: Kernel>(kernel: K, first: &[f32], second: &[f32], to: &mut [u32]) {
    let first = K::Simd::as_simd_f32s(first).0;
    let second = K::Simd::as_simd_f32s(second).0;
    for (vector, to) in K::Simd::as_mut_simd_u32s(to).0.iter_mut().enumerate() {
        *to = kernel.join(first[vector], second[vector]);
    }
}

const _: () = assert!(ROWS.is_multiple_of(2), "tiles begin at even rows");
