use calib_core::{Rng, Seed};
use proptest::prelude::*;

use super::super::{
    layout::{Fill, Pairing, Panels, Rows, feature_pairs},
    number::{bias, without_small},
    processor::Processor,
    product::{Dot, LeftOperand, Product},
    steps::Gradient,
};
use super::*;
use crate::sink::Kept;

/// The range from which operands are drawn.
#[derive(Clone, Copy, Debug)]
enum Range {
    /// Values typical of a network.
    Usual,
    /// From the smallest magnitude up to values so large that products overflow.
    Wide,
    /// Any bits, including infinities and NaN.
    Any,
}

/// Returns single-precision values that are not subnormal as bfloat16 numbers.
fn values(count: usize, range: Range, seed: u64) -> Vec<f32> {
    let mut rng = Seed::new(seed).rng();
    let mut values: Vec<f32> = (0..count).map(|_| number(&mut rng, range)).collect();
    // Cancellation: sums that are nearly zero.
    for place in (3..count).step_by(4) {
        values[place] = -values[place - 3];
    }
    values
}

/// Returns a number with random sign, exponent and mantissa.
fn number(rng: &mut Rng, range: Range) -> f32 {
    let sign = rng.below(2) as u32;
    let mantissa = rng.below(1 << 23) as u32;
    let exponent = match range {
        Range::Usual => 127 - 8 + rng.below(12),
        Range::Wide => 127 - 55 + rng.below(140),
        Range::Any => rng.below(256),
    };
    f32::from_bits(sign << 31 | (exponent as u32) << 23 | mantissa)
}

/// Computes one value by definition: operands in the order of the inner index.
fn defined(begin: f32, a: &[u32], b: &[u32]) -> f32 {
    a.iter().zip(b).fold(begin, |sum, (&a, &b)| {
        let sum = seconds(Scalar, a).mul_add(seconds(Scalar, b), sum);
        firsts(Scalar, a).mul_add(firsts(Scalar, b), sum)
    })
}

/// Whether two values are equal: all NaN are equal, and other values are compared by their bytes.
fn same(left: f32, right: f32) -> bool {
    left.to_bits() == right.to_bits() || (left.is_nan() && right.is_nan())
}

/// Compares every processor's product of `[rows, inner]` and `[inner, columns]` with the definition.
fn assert_defined(rows: usize, inner: usize, columns: usize, range: Range) {
    let a = values(rows * inner, range, 1);
    let b = values(inner * columns, range, 2);
    let mut left = Rows::new(rows, inner);
    Fill::Rows(&mut left).with(Processor::detect(), &a);
    let mut right = Panels::new(Pairing::Features, inner, columns);
    Fill::Panels(&mut right, columns).with(Processor::detect(), &b);
    let mut columns_of_left = Panels::new(Pairing::Features, inner, rows);
    let turned: Vec<f32> = (0..inner)
        .flat_map(|l| (0..rows).map(move |i| (i, l)))
        .map(|(i, l)| a[i * inner + l])
        .collect();
    Fill::Panels(&mut columns_of_left, rows).with(Processor::detect(), &turned);
    let pairs = feature_pairs(inner);
    for processor in Processor::all() {
        for operand in [LeftOperand::Rows(&left, 0), LeftOperand::Columns(&columns_of_left)] {
            let mut out = vec![0.0; rows * columns];
            let finish = &mut Gradient { sink: &mut Kept(&mut out), start: 0, columns };
            processor.run(Product { left: operand, rows, right: &right, columns, finish });
            for i in 0..rows {
                let row = &left.from(i).as_flattened()[..pairs];
                for j in 0..columns {
                    let column: Vec<u32> =
                        right.panel(j / PANEL).iter().map(|block| block[j % PANEL]).collect();
                    let got = out[i * columns + j];
                    let expected = defined(0.0, row, &column);
                    assert!(
                        same(got, expected),
                        "{got} for {expected}: {rows} x {inner} x {columns}, {range:?}, {processor:?}"
                    );
                }
            }
        }
        let row = &left.from(0)[..left.stride()];
        let dots =
            Processor::all().into_iter().map(|processor| processor.run(Dot { a: row, b: row }));
        let lanes: Vec<f32> = (0..HALF)
            .map(|lane| {
                let lane: Vec<u32> = row.iter().map(|block| block[lane]).collect();
                defined(0.0, &lane, &lane)
            })
            .collect();
        let lanes: [f32; HALF] = lanes.try_into().expect("sixteen");
        dots.for_each(|dot| assert!(same(dot, by_halves(lanes))));
    }
}

proptest! {
    #[test]
    fn all_processors_add_up_as_defined(rows in 1_usize..20, inner in 1_usize..150, columns in 1_usize..70) {
        assert_defined(rows, inner, columns, Range::Usual);
    }

    #[test]
    fn also_at_the_edges_of_the_numbers(rows in 1_usize..10, inner in 1_usize..70, columns in 1_usize..40) {
        assert_defined(rows, inner, columns, Range::Wide);
        assert_defined(rows, inner, columns, Range::Any);
    }
}

#[test]
fn long_sums_are_added_up_as_defined() {
    for inner in [512, 1000, 4096, 16_384] {
        assert_defined(9, inner, 33, Range::Usual);
    }
}

#[test]
fn sums_begin_with_a_bias() {
    let panel = [[join(Scalar, 1.5, -2.0); PANEL]];
    let left = Left { pairs: &[join(Scalar, 2.0, 0.25)], row_stride: 0, pair_stride: 1 };
    let mut sums = Tile([[0.0; PANEL]; ROWS]);
    Widened.sum::<1>(&[0.125; PANEL], left, &panel, &mut sums);
    assert_eq!(sums.0[0], [0.125 + 3.0 - 0.5; PANEL]);
}

/// Returns `value` as a product uses it: a bfloat16 number that is not too small.
fn as_operand(value: f32) -> f32 {
    seconds(Scalar, join(Scalar, 0.0, without_small(Scalar, value)))
}

/// A sum of two arbitrary numbers may become a tie by rounding to double precision. These sums never do.
#[test]
fn going_by_double_precision_rounds_once() {
    let operands = values(40_000, Range::Wide, 5);
    let sums = values(40_000, Range::Wide, 6);
    for (two, &sum) in operands.windows(2).zip(&sums) {
        let a = as_operand(two[0]);
        let b = as_operand(two[1]);
        for sum in [bias(sum), -a * b, sum * f32::EPSILON, 1.0, a * b * 16_777_216.0] {
            assert!(same(widened(a, b, sum), a.mul_add(b, sum)), "{a} {b} {sum}");
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[test]
fn the_instruction_rounds_as_defined() {
    use super::super::x86::Hardware;

    let Some(hardware) = Hardware::detect() else { return };
    let mut rng = Seed::new(8).rng();
    for _ in 0..20_000 {
        let [first, second]: [[f32; HALF]; 2] = std::array::from_fn(|_| {
            std::array::from_fn(|_| {
                let bits = rng.below(1 << 16) << 16 | rng.below(1 << 16);
                without_small(Scalar, f32::from_bits(bits as u32))
            })
        });
        let got: [u32; HALF] = pulp::cast(hardware.join(pulp::cast(first), pulp::cast(second)));
        for lane in 0..HALF {
            assert_eq!(got[lane], join(Scalar, first[lane], second[lane]));
        }
    }
}
