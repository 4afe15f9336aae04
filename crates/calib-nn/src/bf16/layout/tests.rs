use proptest::prelude::*;
use pulp::Scalar;

use super::super::number::{firsts, seconds};
use super::*;

/// Returns small integers, which rounding does not change. Adjacent values differ.
fn values(rows: usize, columns: usize) -> Vec<f32> {
    (0..rows * columns).map(|place| (place % 127 + 1) as f32).collect()
}

/// Returns the numbers of a column of pairs in the order of `pairing`, followed by the padding.
fn numbers(pairs: &[u32], pairing: Pairing, count: usize) -> Vec<f32> {
    let mut numbers = vec![0.0; count];
    for (place, &pair) in pairs.iter().enumerate() {
        let (first, second) = pairing.rows(place, count);
        numbers[first] = firsts(Scalar, pair);
        match second {
            Some(second) => numbers[second] = seconds(Scalar, pair),
            None => assert_eq!(seconds(Scalar, pair), 0.0, "nothing there"),
        }
    }
    numbers
}

proptest! {
    #[test]
    fn everything_is_where_products_look_for_it(rows in 1_usize..80, columns in 1_usize..150) {
        let values = values(rows, columns);
        for processor in Processor::all() {
            let mut by_rows = Rows::new(rows, columns);
            Fill::Rows(&mut by_rows).with(processor, &values);
            for row in 0..rows {
                let pairs = &by_rows.from(row).as_flattened()[..feature_pairs(columns)];
                let got = numbers(pairs, Pairing::Features, columns);
                prop_assert_eq!(got, &values[row * columns..(row + 1) * columns]);
            }
            for pairing in [Pairing::Features, Pairing::Neighbours] {
                let mut panels = Panels::new(pairing, rows + 3, columns);
                Fill::Panels(&mut panels, columns).with(processor, &values);
                for column in 0..columns {
                    let panel = panels.panel(column / PANEL);
                    let pairs: Vec<u32> = panel.iter().map(|block| block[column % PANEL]).collect();
                    let expected: Vec<f32> = (0..rows).map(|row| values[row * columns + column]).collect();
                    prop_assert_eq!(numbers(&pairs, pairing, rows), expected);
                }
            }
            let mut turned = Panels::new(Pairing::Features, columns, rows);
            Fill::Transposed(&mut turned, columns).with(processor, &values);
            for row in 0..rows {
                let panel = turned.panel(row / PANEL);
                let pairs: Vec<u32> = panel.iter().map(|block| block[row % PANEL]).collect();
                let got = numbers(&pairs, Pairing::Features, columns);
                prop_assert_eq!(got, &values[row * columns..(row + 1) * columns]);
            }
        }
    }
}
