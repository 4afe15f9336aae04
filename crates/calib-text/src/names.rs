//! Tells names of columns from values.

use crate::{Candidates, Decimal, Notation, parse_number};

/// Words for a missing or wrong value, in lower case. Loggers and spreadsheets write them (our choice).
const NO_VALUE: [&str; 18] = [
    "nan", "na", "n/a", "n.a.", "#n/a", "nil", "none", "null", "missing", "no data", "nodata",
    "bad", "err", "error", "fault", "invalid", "?", "#error",
];

/// Whether a cell may be the name of a column: it is no value, and does not say that a value is missing.
pub(crate) fn is_name(cell: &str) -> bool {
    let cell = cell.trim();
    !cell.is_empty() && !is_value(cell) && !is_no_value(cell)
}

/// Whether a cell says that its value is missing or wrong. Spreadsheets write `#DIV/0!`.
fn is_no_value(cell: &str) -> bool {
    let cell = cell.trim().to_lowercase();
    NO_VALUE.contains(&cell.as_str()) || cell.starts_with('#') && cell.ends_with(['!', '?'])
}

/// Whether at least half of the cells of a column are numbers or times, without those that are empty or say that a
/// value is missing.
pub(crate) fn are_values<'a>(cells: impl Iterator<Item = &'a str>) -> bool {
    let (mut values, mut others) = (0, 0);
    for cell in cells.map(str::trim).filter(|cell| !cell.is_empty()) {
        if is_value(cell) {
            values += 1;
        } else if !is_no_value(cell) {
            others += 1;
        }
    }
    values > 0 && values >= others
}

/// Whether a cell is a number with either decimal sign, even one that is not finite, or a time.
fn is_value(cell: &str) -> bool {
    let decimals = [Decimal::Point, Decimal::Comma];
    decimals.iter().any(|&decimal| parse_number(cell, decimal).is_some()) || is_written_time(cell)
}

/// Whether a cell is a time that is not a plain number.
pub(crate) fn is_written_time(cell: &str) -> bool {
    cell.len() >= 6
        && Candidates::of(&[cell], None)
            .left
            .iter()
            .any(|notation| !matches!(notation, Notation::Number(_)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_neither_values_nor_words_for_missing_ones() {
        for name in ["flow", "m3/h", " day ", "101a", "#2"] {
            assert!(is_name(name), "{name}");
        }
        for other in ["", " ", "101", "1,5", "nan", "-inf", "NA", " Err ", "#DIV/0!", "2024-01-01"]
        {
            assert!(!is_name(other), "{other}");
        }
    }

    fn column(cells: &[&str]) -> bool {
        are_values(cells.iter().copied())
    }

    #[test]
    fn columns_of_values_may_have_gaps_and_some_words() {
        assert!(column(&["", "NA", "1"]) && column(&["nan"]) && column(&["open", "1,5", "2"]));
        assert!(column(&["2024-01-01 00:00"]));
        assert!(!column(&[]) && !column(&["", "NA"]) && !column(&["a", "b", "1"]));
    }
}
