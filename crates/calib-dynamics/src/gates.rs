//! The gates of a GRU, for one row.

use std::ops::Range;

use crate::activation::{sigmoid, tanh};

/// Products of the three gates for one row, without their biases.
#[derive(Clone, Copy)]
pub(crate) struct Products<'a> {
    pub(crate) of_input: &'a [f32],
    pub(crate) of_hidden: &'a [f32],
    pub(crate) bias_ih: &'a [f32],
    pub(crate) bias_hh: &'a [f32],
}

/// The activations of one row, for writing.
pub(crate) struct Activated<'a> {
    pub(crate) reset: &'a mut [f32],
    pub(crate) keep: &'a mut [f32],
    pub(crate) new: &'a mut [f32],
    pub(crate) new_hidden: &'a mut [f32],
    pub(crate) hidden: &'a mut [f32],
}

/// Returns the places of a gate's values among those of all three.
#[inline]
fn gate(units: usize, number: usize) -> Range<usize> {
    number * units..(number + 1) * units
}

/// Computes the gates and the new hidden state of one row.
pub(crate) fn activate(products: Products<'_>, past: &[f32], to: Activated<'_>) {
    let Products { of_input, of_hidden, bias_ih, bias_hh } = products;
    let Activated { reset, keep, new, new_hidden, hidden: next } = to;
    let units = past.len();
    for (number, gate_values) in [(0, &mut *reset), (1, &mut *keep)] {
        let input = of_input[gate(units, number)].iter().zip(&bias_ih[gate(units, number)]);
        let hidden = of_hidden[gate(units, number)].iter().zip(&bias_hh[gate(units, number)]);
        for ((value, (input, a)), (hidden, b)) in gate_values.iter_mut().zip(input).zip(hidden) {
            *value = sigmoid((input + a) + (hidden + b));
        }
    }
    let hidden = of_hidden[gate(units, 2)].iter().zip(&bias_hh[gate(units, 2)]);
    for (value, (hidden, bias)) in new_hidden.iter_mut().zip(hidden) {
        *value = hidden + bias;
    }
    let input = of_input[gate(units, 2)].iter().zip(&bias_ih[gate(units, 2)]);
    let gated = reset.iter().zip(&*new_hidden);
    for ((value, (input, bias)), (reset, hidden)) in new.iter_mut().zip(input).zip(gated) {
        *value = tanh((input + bias) + reset * hidden);
    }
    let kept = keep.iter().zip(past);
    for ((value, new), (keep, past)) in next.iter_mut().zip(&*new).zip(kept) {
        *value = (1.0 - keep) * new + keep * past;
    }
}
