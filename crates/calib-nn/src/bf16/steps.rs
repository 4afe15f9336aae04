//! What becomes of the sums of each product of a network.

use pulp::Simd;

use super::{
    kernel::{Kernel, ROWS, Tile},
    layout::{HALF, PANEL, Panels, Rows, half_of_block, halves, part},
    number::{firsts, rectified, seconds, without_small},
    product::Finish,
};

/// Activations of a hidden layer: sums that begin with the bias, without what is below 0, rounded.
pub(super) struct Activations<'a> {
    /// Filled up with zeros to whole panels.
    pub(super) bias: &'a [[f32; PANEL]],
    /// For the next layer.
    pub(super) rows: &'a mut Rows,
    /// For the gradient of the next layer's weights, of the first `learnt` rows.
    pub(super) panels: &'a mut Panels,
    pub(super) learnt: usize,
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
        sums: &mut Tile,
        first_row: usize,
        rows: usize,
        panel: usize,
    ) {
        for row in &mut sums.0[..rows] {
            for value in K::Simd::as_mut_simd_f32s(row).0 {
                *value = rectified(kernel.simd(), *value);
            }
        }
        into_rows(kernel, sums, self.rows, first_row, rows, panel);
        if first_row < self.learnt {
            let rows = rows.min(self.learnt - first_row);
            into_panels(kernel, sums, self.panels, first_row, rows, panel);
        }
    }
}

/// Errors of a hidden layer: zero where its activation is not positive.
pub(super) struct Errors<'a> {
    pub(super) activations: &'a Rows,
    /// Their sums over the rows, before they are rounded.
    pub(super) bias_gradient: &'a mut [f32],
    /// For the gradient of this layer's weights.
    pub(super) panels: &'a mut Panels,
    /// For the errors of the layer before.
    pub(super) rows: &'a mut Rows,
}

impl Finish for Errors<'_> {
    #[expect(clippy::inline_always, reason = "as the product")]
    #[inline(always)]
    fn finish<K: Kernel>(
        &mut self,
        kernel: K,
        sums: &mut Tile,
        first_row: usize,
        rows: usize,
        panel: usize,
    ) {
        let simd = kernel.simd();
        let zero = simd.splat_f32s(0.0);
        let mut totals = [0.0; PANEL];
        let of_totals = K::Simd::as_mut_simd_f32s(&mut totals).0;
        for (row, sums) in sums.0[..rows].iter_mut().enumerate() {
            let activations = numbers(kernel, self.activations, first_row + row, panel);
            let activations = K::Simd::as_simd_f32s(&activations).0;
            let errors = K::Simd::as_mut_simd_f32s(sums).0;
            for (vector, error) in errors.iter_mut().enumerate() {
                let active = simd.greater_than_f32s(activations[vector], zero);
                *error = without_small(simd, simd.select_f32s(active, *error, zero));
                of_totals[vector] = simd.add_f32s(of_totals[vector], *error);
            }
        }
        let width = PANEL.min(self.bias_gradient.len() - panel * PANEL);
        let bias_gradient = &mut self.bias_gradient[panel * PANEL..][..width];
        if first_row == 0 {
            bias_gradient.fill(0.0);
        }
        for (sum, total) in bias_gradient.iter_mut().zip(totals) {
            *sum += total;
        }
        into_rows(kernel, sums, self.rows, first_row, rows, panel);
        into_panels(kernel, sums, self.panels, first_row, rows, panel);
    }
}

/// The gradient of weights `[inputs, outputs]`.
pub(super) struct Gradient<'a> {
    pub(super) values: &'a mut [f32],
    /// The outputs.
    pub(super) columns: usize,
}

impl Finish for Gradient<'_> {
    #[expect(clippy::inline_always, reason = "as the product")]
    #[inline(always)]
    fn finish<K: Kernel>(
        &mut self,
        _kernel: K,
        sums: &mut Tile,
        first_row: usize,
        rows: usize,
        panel: usize,
    ) {
        let first_column = panel * PANEL;
        let width = PANEL.min(self.columns - first_column);
        for (row, sums) in sums.0[..rows].iter().enumerate() {
            let at = (first_row + row) * self.columns + first_column;
            let to = &mut self.values[at..at + width];
            // Whole panels are vectors; a copy of unknown length is a call.
            match to.as_mut_array() {
                Some(to) => *to = *sums,
                None => to.copy_from_slice(&sums[..width]),
            }
        }
    }
}

/// A block of a row in single precision, feature after feature; the rest are zeros.
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

/// Rows of a tile, features paired.
#[expect(clippy::inline_always, reason = "as the product")]
#[inline(always)]
fn into_rows<K: Kernel>(
    kernel: K,
    tile: &Tile,
    to: &mut Rows,
    first_row: usize,
    rows: usize,
    block: usize,
) {
    let half = half_of_block(block * PANEL, to.columns());
    for (row, numbers) in tile.0[..rows].iter().enumerate() {
        let to = to.block_mut(first_row + row, block);
        if half == HALF {
            let [first, second] = halves(numbers);
            join_all(kernel, first, second, to);
        } else {
            join_all(kernel, &part(&numbers[..half]), &part(&numbers[half..2 * half]), to);
        }
    }
}

/// Rows of a tile, the first of which has an even number, paired with their neighbours; a missing last one is zeros.
#[expect(clippy::inline_always, reason = "as the product")]
#[inline(always)]
fn into_panels<K: Kernel>(
    kernel: K,
    tile: &Tile,
    to: &mut Panels,
    first_row: usize,
    rows: usize,
    panel: usize,
) {
    let zeros = [0.0; PANEL];
    let to = &mut to.panel_mut(panel)[first_row / 2..];
    for (two, to) in to.iter_mut().take(rows.div_ceil(2)).enumerate() {
        let second = if 2 * two + 1 < rows { &tile.0[2 * two + 1] } else { &zeros };
        join_all(kernel, &tile.0[2 * two], second, to);
    }
}

/// Pairs of first and second numbers.
#[expect(clippy::inline_always, reason = "as the product")]
#[inline(always)]
fn join_all<K: Kernel>(kernel: K, first: &[f32], second: &[f32], to: &mut [u32]) {
    let (first, second) = (K::Simd::as_simd_f32s(first).0, K::Simd::as_simd_f32s(second).0);
    for (vector, to) in K::Simd::as_mut_simd_u32s(to).0.iter_mut().enumerate() {
        *to = kernel.join(first[vector], second[vector]);
    }
}

const _: () = assert!(ROWS.is_multiple_of(2), "tiles begin at even rows");
