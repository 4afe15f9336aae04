use std::ops::Range;

/// One row in so many may have a value that stands out. Our choice.
const ROWS_TO_ONE: usize = 100;

/// Values of a column of continuous actions that stand out from all others, as a slip of the logger does. Levels that reached as far would be
/// the nearest to no row, and all others would be one level.
#[derive(Clone, Debug, PartialEq)]
pub struct OutlyingActions {
    /// The rows that have them, ascending.
    pub rows: Vec<usize>,
    /// The least and the largest of these values.
    pub range: [f64; 2],
    /// The least and the largest of the others.
    pub others: [f64; 2],
}

/// A value of a column, and how many rows have it.
struct CountedValue {
    value: f64,
    rows: usize,
}

/// The least or the largest of some values.
struct End {
    /// How many values.
    values: usize,
    /// How many rows have them.
    rows: usize,
    /// How far the nearest of the other values is; infinite of no value.
    gap: f64,
}

impl OutlyingActions {
    /// Those of `column`, NaN being missing; none where nothing stands out, or where its own values are no more than `levels`. Some of the least
    /// values, some of the largest or both stand out if up to one row in a hundred has them, and either group is farther from the rest than the
    /// rest are from each other. Of several such choices, that with most rows counts.
    pub fn of_column(column: &[f64], levels: usize) -> Option<Self> {
        let mut values: Vec<f64> =
            column.iter().map(|value| value + 0.0).filter(|value| !value.is_nan()).collect();
        values.sort_by(f64::total_cmp);
        let counted: Vec<CountedValue> = values
            .chunk_by(|a, b| a.total_cmp(b).is_eq())
            .map(|alike| CountedValue { value: alike[0], rows: alike.len() })
            .collect();
        if counted.len() <= levels {
            return None;
        }
        let others = &counted[inner(&counted, (values.len() / ROWS_TO_ONE).max(1))];
        let others = [others.first()?.value, others.last()?.value];
        let stands_out = |value: f64| value < others[0] || value > others[1];
        let rows: Vec<usize> = (0..column.len()).filter(|&row| stands_out(column[row])).collect();
        let mut outlying = values.into_iter().filter(|&value| stands_out(value));
        let least = outlying.next()?;
        let largest = outlying.next_back().unwrap_or(least);
        Some(Self { rows, range: [least, largest], others })
    }
}

/// Which of at least three values do not stand out, where up to `most_rows` may.
fn inner(counted: &[CountedValue], most_rows: usize) -> Range<usize> {
    let all = 0..counted.len();
    let mut low = ends(counted.iter(), most_rows);
    let mut high = ends(counted.iter().rev(), most_rows);
    // No rest is closer together than what is between the longest ends, so that few ends are left to compare in pairs.
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

/// The ends of ordered values that up to `most_rows` have, the shortest first: no value, the first one, the first two, and so on.
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

    /// Doses of 0 to 99, over and over, with other values in some rows.
    fn doses(rows: usize, others: &[(usize, f64)]) -> Vec<f64> {
        let mut doses: Vec<f64> = (0..rows).map(|row| (row * 37 % 100) as f64).collect();
        for &(row, value) in others {
            doses[row] = value;
        }
        doses
    }

    #[test]
    fn values_far_from_all_others_stand_out() {
        let found = |others: &[(usize, f64)]| OutlyingActions::of_column(&doses(600, others), 7);
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
        // One row in forty is more than one in a hundred, and may be a slip all the same.
        assert!(OutlyingActions::of_column(&doses(40, &[(3, 1e6)]), 7).is_some());
        // A pump that mostly stands still has other values too.
        let rare: Vec<f64> = (0..600)
            .map(|row| if row % 40 == 0 { 20.0 + f64::from(row / 40) } else { 0.0 })
            .collect();
        assert_eq!(OutlyingActions::of_column(&rare, 7), None);
        // A pump that is off half of the time runs at 40 to 60, and once at 85: nearer to 60 than 60 is to 0.
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
