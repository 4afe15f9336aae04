//! Numbers as people and programs of different countries write them.

use super::cell::{Cell, Words};
use crate::log::LARGEST;

/// What separates the whole from its fraction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Decimal {
    /// `1.5`, thousands perhaps as `1,234.5`.
    Point,
    /// `1,5`, thousands perhaps as `1.234,5`.
    Comma,
    /// Nothing has shown it yet: each cell must.
    Unknown,
}

/// What a cell says about the decimal sign.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Sign {
    Point,
    Comma,
    /// `1,234`: a fraction or a thousand.
    Either,
    /// A whole number, or none.
    Nothing,
}

/// What `text` says about the decimal sign.
pub(crate) fn sign_of(text: &str) -> Sign {
    let text = mantissa(text);
    let (commas, points) = (count(text, b','), count(text, b'.'));
    let number = |text: &str| text.parse::<f64>().is_ok_and(f64::is_finite);
    match (commas, points) {
        (0, 1) if number(text) => Sign::Point,
        (1, 0) if number(&text.replace(',', ".")) => {
            if grouped(text, ',') {
                Sign::Either
            } else {
                Sign::Comma
            }
        }
        (2.., 0) if grouped(text, ',') => Sign::Point,
        (1.., 1..) => match (text.rfind(','), text.rfind('.')) {
            (Some(comma), Some(point)) if comma > point => comma_if(grouped(&text[..comma], '.')),
            (Some(_), Some(point)) if grouped(&text[..point], ',') => Sign::Point,
            _ => Sign::Nothing,
        },
        _ => Sign::Nothing,
    }
}

fn comma_if(is: bool) -> Sign {
    if is { Sign::Comma } else { Sign::Nothing }
}

/// The number that `text` is; `None` if it is none, or not certainly one.
pub(crate) fn parse(text: &str, decimal: Decimal) -> Option<f64> {
    let bytes = text.as_bytes();
    let has_comma = memchr::memchr(b',', bytes).is_some();
    match decimal {
        Decimal::Point | Decimal::Unknown if !has_comma => plain(text),
        Decimal::Point => whole_of(text, '.', ','),
        Decimal::Comma => {
            if !has_comma && memchr::memchr(b'.', bytes).is_none() {
                plain(text)
            } else {
                whole_of(text, ',', '.')
            }
        }
        Decimal::Unknown => match sign_of(text) {
            Sign::Comma => whole_of(text, ',', '.'),
            Sign::Point => whole_of(text, '.', ','),
            Sign::Either | Sign::Nothing => None,
        },
    }
}

fn plain(text: &str) -> Option<f64> {
    text.parse().ok().or(match text {
        "true" | "True" | "TRUE" => Some(1.0),
        "false" | "False" | "FALSE" => Some(0.0),
        _ => None,
    })
}

/// A number with this sign before its fraction and that one between its thousands.
fn whole_of(text: &str, fraction: char, thousands: char) -> Option<f64> {
    let mantissa = mantissa(text);
    let (whole, rest) = match mantissa.find(fraction) {
        Some(at) => (&mantissa[..at], &mantissa[at + 1..]),
        None => (mantissa, ""),
    };
    if rest.contains([fraction, thousands])
        || (whole.contains(thousands) && !grouped(whole, thousands))
    {
        return None;
    }
    let mut number: String = whole.chars().filter(|&c| c != thousands).collect();
    if mantissa.len() > whole.len() {
        number.push('.');
        number.push_str(rest);
    }
    number.push_str(&text[mantissa.len()..]);
    number.parse().ok()
}

/// The number without its power of ten.
fn mantissa(text: &str) -> &str {
    &text[..text.find(['e', 'E']).unwrap_or(text.len())]
}

/// Groups of three digits after the first, which has one to three.
fn grouped(text: &str, sign: char) -> bool {
    let text = text.strip_prefix(['+', '-']).unwrap_or(text);
    let mut groups = text.split(sign);
    let digits = |group: &str| group.bytes().all(|byte| byte.is_ascii_digit());
    let first = groups.next().is_some_and(|group| {
        (1..=3).contains(&group.len()) && digits(group) && !(group.starts_with('0'))
    });
    let mut later = groups.peekable();
    first && later.peek().is_some() && later.all(|group| group.len() == 3 && digits(group))
}

fn count(text: &str, byte: u8) -> usize {
    memchr::memchr_iter(byte, text.as_bytes()).count()
}

/// The cell that `text` is, `None` if it is one number or another. What is no number is a word, which counts as missing.
pub(crate) fn cell(text: &str, decimal: Decimal, words: &mut Words) -> Option<Cell> {
    let text = text.trim();
    if text.is_empty() {
        return Some(Cell::Missing);
    }
    match parse(text, decimal) {
        Some(value) if value.abs() <= LARGEST => Some(Cell::Number(value)),
        Some(_) => Some(Cell::NonFinite),
        None if decimal == Decimal::Unknown && sign_of(text) == Sign::Either => None,
        None => Some(Cell::Word(words.position(text))),
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn numbers_of_both_kinds_are_read() {
        let point = |text| parse(text, Decimal::Point);
        assert_eq!(point("-1.5e-3"), Some(-1.5e-3));
        assert_eq!(point("1,234.5"), Some(1234.5));
        assert_eq!(point("1,23.5"), None);
        assert_eq!(point("TRUE"), Some(1.0));
        let comma = |text| parse(text, Decimal::Comma);
        assert_eq!(comma("-1,5E-3"), Some(-1.5e-3));
        assert_eq!(comma("1.234,5"), Some(1234.5));
        assert_eq!(comma("1.234"), Some(1234.0));
        assert_eq!((comma("1.5"), comma("1,2,3"), comma("17")), (None, None, Some(17.0)));
        let unknown = |text| parse(text, Decimal::Unknown);
        assert_eq!(
            (unknown("1,5"), unknown("1.5"), unknown("15")),
            (Some(1.5), Some(1.5), Some(15.0))
        );
        assert_eq!(unknown("1,234"), None, "a fraction or a thousand");
        assert_eq!(unknown("1,234,567"), Some(1_234_567.0), "two fractions there are not");
    }

    #[test]
    fn cells_tell_the_decimal_sign() {
        let signs =
            ["1.5", "1,5", "1,234", "0,234", "1.234,5", "1,234.5", "12", "Bad, off"].map(sign_of);
        let expected = [
            Sign::Point,
            Sign::Comma,
            Sign::Either,
            Sign::Comma,
            Sign::Comma,
            Sign::Point,
            Sign::Nothing,
            Sign::Nothing,
        ];
        assert_eq!(signs, expected);
    }

    #[test]
    fn what_is_no_number_is_a_word() {
        let mut words = Words::default();
        let mut point = |text| cell(text, Decimal::Point, &mut words).expect("certain");
        assert_eq!(point(" 7 "), Cell::Number(7.0));
        assert_eq!((point(""), point("inf")), (Cell::Missing, Cell::NonFinite));
        assert_eq!(point("Bad"), Cell::Word(0));
        assert_eq!(cell("1,234", Decimal::Unknown, &mut words), None);
        assert_eq!(words.list(), ["Bad"]);
    }

    proptest! {
        #[test]
        fn a_comma_changes_no_number(value in -1e6_f64..1e6) {
            let text = value.to_string();
            prop_assert_eq!(parse(&text, Decimal::Point), Some(value));
            prop_assert_eq!(parse(&text.replace('.', ","), Decimal::Comma), Some(value));
        }
    }
}
