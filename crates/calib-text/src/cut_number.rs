//! Detects whether the last number of a file was cut off.
//!
//! Many good exports end without a line break, so this alone proves nothing. If all numbers of a column have the same
//! number of decimals, and some end with a zero, the export pads them. A last number with fewer decimals then differs
//! from the format of the export.

use crate::Decimal;

/// Minimum number of numbers that show the format of a column. Our choice.
const FEWEST: usize = 20;

/// Returns the number of decimals in the numbers `before` the last one, if the last one has fewer.
pub fn decimals_before_cut(last: &str, before: &[&str], decimal: Decimal) -> Option<usize> {
    let sign = match decimal {
        Decimal::Point => '.',
        Decimal::Comma => ',',
        Decimal::Unknown => return None,
    };
    let rest = fraction(last, sign)?;
    let mut fractions = Vec::with_capacity(before.len());
    for cell in before.iter().filter(|cell| cell.contains(|c: char| c.is_ascii_digit())) {
        fractions.push(fraction(cell, sign)?);
    }
    let usual = fractions.first()?.len();
    let are_padded = fractions.len() >= FEWEST
        && fractions.iter().all(|fraction| fraction.len() == usual)
        && fractions.iter().any(|fraction| fraction.ends_with('0'));
    (are_padded && rest.len() < usual).then_some(usual)
}

/// Whether `cell` is a plain number with so many decimals, or no number.
pub fn has_decimals(cell: &str, decimals: usize, decimal: Decimal) -> bool {
    let sign = if decimal == Decimal::Comma { ',' } else { '.' };
    !cell.contains(|c: char| c.is_ascii_digit())
        || fraction(cell, sign).is_some_and(|fraction| fraction.len() == decimals)
}

/// Returns the decimals of a plain number, possibly empty; `None` for another format.
fn fraction(cell: &str, sign: char) -> Option<&str> {
    let number = cell.strip_prefix(['-', '+']).unwrap_or(cell);
    let (whole, fraction) = number.split_once(sign).unwrap_or((number, ""));
    let are_digits = whole.bytes().chain(fraction.bytes()).all(|byte| byte.is_ascii_digit());
    (!whole.is_empty() && are_digits).then_some(fraction)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tests a last number after 30 numbers, a quarter of which end with a zero, written by `write`.
    fn decimals(last: &str, write: impl Fn(f64) -> String, decimal: Decimal) -> Option<usize> {
        let cells: Vec<String> = (0..30).map(|row| write(12.0 + f64::from(row) / 4.0)).collect();
        let before: Vec<&str> = cells.iter().map(String::as_str).collect();
        decimals_before_cut(last, &before, decimal)
    }

    fn padded(value: f64) -> String {
        format!("{value:.2}")
    }

    fn padded_with_comma(value: f64) -> String {
        padded(value).replace('.', ",")
    }

    #[test]
    fn padded_numbers_show_that_the_last_one_is_cut() {
        for cut in ["12.3", "12.", "12", "1", "-1", "-12.3"] {
            assert_eq!(decimals(cut, padded, Decimal::Point), Some(2), "{cut}");
        }
        for whole in ["12.34", "-0.10", "12.345", "", "-", "NaN", "1e5", "."] {
            assert_eq!(decimals(whole, padded, Decimal::Point), None, "{whole}");
        }
        assert_eq!(decimals("12,3", padded_with_comma, Decimal::Comma), Some(2));
        assert_eq!(decimals("12,34", padded_with_comma, Decimal::Comma), None);
        assert_eq!(decimals("12,3", padded_with_comma, Decimal::Unknown), None);
    }

    #[test]
    fn numbers_that_are_not_padded_show_nothing() {
        let with_point =
            |last: &str, write: fn(f64) -> String| decimals(last, write, Decimal::Point);
        assert_eq!(with_point("1", |value| value.to_string()), None, "12.25 beside 12.5 and 12");
        assert_eq!(with_point("12", |_| "12.5".to_owned()), None, "13 may be as short");
        assert_eq!(with_point("1", |value| format!("{value:.0}")), None);
        assert_eq!(with_point("12.3", |value| format!("{value:.2}e0")), None);
        let above_a_thousand =
            decimals("998", |value| format!("1.{:03}", 10.0 * value.floor()), Decimal::Comma);
        assert_eq!(above_a_thousand, None, "1.120 has no decimals");
    }

    #[test]
    fn another_number_of_decimals_is_seen() {
        for cell in ["1.50", "-0.00", "Bad", ""] {
            assert!(has_decimals(cell, 2, Decimal::Point), "{cell}");
        }
        for cell in ["1", "0", "1.5", "1,50", "1.50e0"] {
            assert!(!has_decimals(cell, 2, Decimal::Point), "{cell}");
        }
        assert!(has_decimals("1,50", 2, Decimal::Comma));
    }

    #[test]
    fn words_and_few_numbers_show_nothing() {
        let before = ["1.50"; FEWEST];
        assert_eq!(decimals_before_cut("1.5", &before, Decimal::Point), Some(2));
        assert_eq!(decimals_before_cut("1.5", &before[1..], Decimal::Point), None);
        let with_words = [&before[..], &["Bad", "-"]].concat();
        assert_eq!(decimals_before_cut("1.5", &with_words, Decimal::Point), Some(2));
        let with_whole = [&before[..], &["2"]].concat();
        assert_eq!(decimals_before_cut("1.5", &with_whole, Decimal::Point), None);
    }
}
