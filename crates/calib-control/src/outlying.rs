use std::ops::Range;

use crate::level_grid::sorted_values;

/// One row in this many may have an outlying value. Our choice.
const ROWS_TO_ONE: usize = 100;

/// Values of a column of continuous actions that are far from all others, such as a logger's slip. Levels over their range would be nearest
/// to no row, and all other values would share one level.
#[derive(Clone, Debug, PartialEq)]
pub struct OutlyingActions {
    /// Rows with outlying values, ascending.
    pub rows: Vec<usize>,
    /// The least and the largest outlying value.
    pub range: [f64; 2],
    /// The least and the largest of the other values.
    pub others: [f64; 2],
}

/// A value of a column, and its number of rows.
struct CountedValue {
    value: f64,
    rows: usize,
}

/// The least or the largest values of a column, as a candidate group of outlying values.
struct End {
    /// Number of different values.
    values: usize,
    /// Number of rows with these values.
    rows: usize,
    /// Distance to the nearest of the other values; infinite for an empty group.
    gap: f64,
}

impl OutlyingActions {
    /// Returns the outlying values of `column`, with NaN for missing values. Returns `None` if no value is outlying, or if the column has
    /// at most `levels` different values. Some of the least values, some of the largest or both are outlying if at most one row in a
    /// hundred has them, and each group is farther from the rest than the values of the rest are from each other. Among several such
    /// choices, the one with the most rows counts.
    pub fn of_column(column: &[f64], levels: usize) -> Option<Self> {
        let values = sorted_values(column);
        let counted: Vec<CountedValue> = values
            .chunk_by(|a, b| a.total_cmp(b).is_eq())
            .map(|alike| CountedValue { value: alike[0], rows: alike.len() })
            .collect();
        if counted.len() <= levels {
            return None;
        }
        let others = &counted[inner(&counted, (values.len() / ROWS_TO_ONE).max(1))];
        let others = [others.first()?.value, others.last()?.value];
        let rows: Vec<usize> =
            (0..column.len()).filter(|&row| is_outside(column[row], others)).collect();
        let mut outlying = values.into_iter().filter(|&value| is_outside(value, others));
        let least = outlying.next()?;
        let largest = outlying.next_back().unwrap_or(least);
        Some(Self { rows, range: [least, largest], others })
    }
}

/// Returns whether a value is below the least or above the largest of others. A missing value is not.
fn is_outside(value: f64, [least, largest]: [f64; 2]) -> bool {
    value < least || value > largest
}

/// Returns which of at least three values are not outlying, if at most `most_rows` rows may be.
fn inner(counted: &[CountedValue], most_rows: usize) -> Range<usize> {
    let all = 0..counted.len();
    let mut low = ends(counted.iter(), most_rows);
    let mut high = ends(counted.iter().rev(), most_rows);
    // Any rest contains the values between the longest ends. So an end whose gap is not larger than their range cannot
    // count, and few ends remain to compare in pairs.
    let [below, above] = [&low, &high].map(|ends| ends.last().map_or(0, |end| end.values));
    let least = counted[all.end - 1 - above].value - counted[below].value;
    low.retain(|end| end.gap > least);
    high.retain(|end| end.gap > least);
    let mut inner = all.clone();
    let mut most = 0;
    for low in &low {
        for high in &high {
            let rest = low.values..all.end - high.values;
            let rows = low.rows + high.rows;
            if rest.len() < 2 || rows > most_rows || rows <= most {
                continue;
            }
            let spread = counted[rest.end - 1].value - counted[rest.start].value;
            if low.gap > spread && high.gap > spread {
                most = rows;
                inner = rest;
            }
        }
    }
    inner
}

/// Returns the groups of first values that at most `most_rows` rows have, the shortest first: no value, the first one, the first
/// two, and so on.
fn ends<'a>(values: impl Iterator<Item = &'a CountedValue> + Clone, most_rows: usize) -> Vec<End> {
    let mut ends = vec![End { values: 0, rows: 0, gap: f64::INFINITY }];
    let mut rows = 0;
    for (place, (value, next)) in values.clone().zip(values.skip(1)).enumerate() {
        rows += value.rows;
        if rows > most_rows {
            break;
        }
        ends.push(End { values: place + 1, rows, gap: (next.value - value.value).abs() });
    }
    ends
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns doses of 0 to 99, repeated, with other values in some rows.
    fn doses(rows: usize, others: &[(usize, f64)]) -> Vec<f64> {
        let mut doses: Vec<f64> = (0..rows).map(|row| (row * 37 % 100) as f64).collect();
        for &(row, value) in others {
            doses[row] = value;
        }
        doses
    }

    /// Returns the outlying values of 600 doses with other values in some rows.
    fn found(others: &[(usize, f64)]) -> Option<OutlyingActions> {
        OutlyingActions::of_column(&doses(600, others), 7)
    }

    #[test]
    fn values_far_from_all_others_stand_out() {
        assert_eq!(found(&[]), None);
        let one = found(&[(300, 1e6), (4, f64::NAN)]).expect("a slip");
        assert_eq!((&one.rows[..], one.range, one.others), (&[300][..], [1e6; 2], [0.0, 99.0]));
        let stuck = found(&[(7, 1e6), (8, 1e6)]).expect("a slip of two rows");
        assert_eq!(stuck.rows, [7, 8]);
        let several = found(&[(9, -1e5), (7, 1e6), (8, 2_000.0)]).expect("slips on both sides");
        assert_eq!((&several.rows[..], several.range), (&[7, 8, 9][..], [-1e5, 1e6]));
        assert_eq!(several.others, [0.0, 99.0]);
        // They are nearer to each other than to the rest.
        let alike = found(&[(7, 5_000.0), (8, 5_200.0)]).expect("two unlike slips on one side");
        assert_eq!((&alike.rows[..], alike.range), (&[7, 8][..], [5_000.0, 5_200.0]));
        let four = found(&[(7, 5_000.0), (8, 5_200.0), (9, -900.0), (10, -950.0)]);
        assert_eq!(four.map(|found| found.rows), Some(vec![7, 8, 9, 10]), "on both sides");
        // Neither is farther from the rest than the other one is.
        let opposite = found(&[(7, 1e6), (8, -1e6)]).expect("slips as far on both sides");
        assert_eq!((&opposite.rows[..], opposite.range), (&[7, 8][..], [-1e6, 1e6]));
        assert_eq!(found(&[(300, 190.0)]), None, "no farther than others are from each other");
    }

    #[test]
    fn what_many_rows_have_does_not_stand_out() {
        let often: Vec<(usize, f64)> = (0..20).map(|row| (row, 1e6)).collect();
        assert_eq!(OutlyingActions::of_column(&doses(600, &often), 7), None, "20 rows of 600");
        // One row in forty is more than one in a hundred, but may still be a slip.
        assert!(OutlyingActions::of_column(&doses(40, &[(3, 1e6)]), 7).is_some());
        // A pump that is mostly constant has other values too.
        let rare: Vec<f64> = (0..600)
            .map(|row| if row % 40 == 0 { 20.0 + f64::from(row / 40) } else { 0.0 })
            .collect();
        assert_eq!(OutlyingActions::of_column(&rare, 7), None);
        // A pump that is off half of the time runs at 40 to 60, and once at 85, which is nearer to 60 than 60 is to 0.
        let mut halves: Vec<f64> = (0..600)
            .map(|row| if row % 2 == 0 { 0.0 } else { 40.0 + f64::from(row % 41) / 2.0 })
            .collect();
        halves[301] = 85.0;
        assert_eq!(OutlyingActions::of_column(&halves, 7), None);
        halves[301] = 850.0;
        assert_eq!(OutlyingActions::of_column(&halves, 7).map(|found| found.rows), Some(vec![301]));
    }

    #[test]
    fn few_values_are_levels_of_their_own() {
        let few: Vec<f64> =
            (0..600).map(|row| if row == 5 { 1e6 } else { f64::from(row % 3) }).collect();
        assert_eq!(OutlyingActions::of_column(&few, 7), None);
        assert!(OutlyingActions::of_column(&few, 3).is_some());
        assert_eq!(OutlyingActions::of_column(&[f64::NAN; 4], 2), None);
    }
}
