use std::collections::HashMap;

use calib_core::States;

use crate::scores::distance;

/// Number of `rows` that are no nearer than `tolerance` to an earlier one that was counted; exact repeats are
/// never counted.
///
/// Candidates are found by the column that varies most: rows in other cells than its own and the two beside
/// it are too far away.
pub(crate) fn count_distinct(of: &States, rows: &[usize], tolerance: f64) -> usize {
    let column = widest_column(of, rows);
    let cell = |row: usize| {
        let value = f64::from(of.row(row)[column]);
        // Without a tolerance equal values still share a cell.
        if tolerance > 0.0 { (value / tolerance).floor() as i64 } else { value.to_bits() as i64 }
    };
    let mut counted: HashMap<i64, Vec<usize>> = HashMap::new();
    let mut distinct = 0;
    for &row in rows {
        let own = cell(row);
        let around = [own, own.wrapping_sub(1), own.wrapping_add(1)];
        let mut candidates = around.iter().filter_map(|cell| counted.get(cell)).flatten();
        let near = |&other: &usize| {
            let distance = distance(of.row(row), of.row(other));
            distance < tolerance || distance == 0.0
        };
        if !candidates.any(near) {
            distinct += 1;
            counted.entry(own).or_default().push(row);
        }
    }
    distinct
}

fn widest_column(of: &States, rows: &[usize]) -> usize {
    let spread = |column: usize| {
        let values = || rows.iter().map(|&row| f64::from(of.row(row)[column]));
        let mean = values().sum::<f64>() / rows.len() as f64;
        values().map(|value| (value - mean).powi(2)).sum::<f64>()
    };
    let spreads: Vec<f64> = (0..of.columns()).map(spread).collect();
    (0..of.columns()).max_by(|&a, &b| spreads[a].total_cmp(&spreads[b])).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use calib_core::Seed;

    use super::*;

    #[test]
    fn agrees_with_comparing_all_pairs() {
        let mut rng = Seed::new(5).rng();
        let values: Vec<f32> = (0..600).map(|_| rng.normal() as f32).collect();
        let states = States::new(values, 200, 3).expect("finite");
        let rows: Vec<usize> = (0..200).chain(10..40).collect();
        for tolerance in [0.0, 0.1, 0.5, 2.0] {
            let mut kept: Vec<usize> = Vec::new();
            for &row in &rows {
                let near = |&other: &usize| {
                    let distance = distance(states.row(row), states.row(other));
                    distance < tolerance || distance == 0.0
                };
                if !kept.iter().any(near) {
                    kept.push(row);
                }
            }
            assert_eq!(count_distinct(&states, &rows, tolerance), kept.len(), "{tolerance}");
        }
    }
}
