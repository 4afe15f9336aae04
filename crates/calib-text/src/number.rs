//! Numbers in the notations of different countries and programs.

use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
};

use thiserror::Error;

use crate::{Cell, Words};

/// The largest magnitude that counts as a number. No plant measures more, and sums of squares of larger numbers
/// overflow.
pub const LARGEST: f64 = 1e150;

/// An unknown decimal sign: nothing in a log shows it, or two cells contradict each other.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("{}: {reason}", path.display())]
pub struct SignError {
    /// Path of the file that has the cell.
    pub path: PathBuf,
    /// The reason, and what to do.
    pub reason: String,
}

/// The decimal sign.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Decimal {
    /// `1.5`, thousands perhaps as `1,234.5`.
    Point,
    /// `1,5`, thousands perhaps as `1.234,5`.
    Comma,
    /// Not known yet: each cell must show it.
    Unknown,
}

/// The evidence of one cell about the decimal sign.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Sign {
    Point,
    Comma,
    /// `1,234`: a fraction or a thousand. `1.234` is ambiguous only beside other cells ([`may_be_thousands`]).
    Either,
    /// A whole number, or not a number.
    Nothing,
}

/// The evidence of a log about its decimal sign: the first cell of each kind.
///
/// Files of one export use the same notation, so the sign belongs to the log and not to a file: `1.310` beside
/// `1.210,5` is another number than beside `1.5`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Signs {
    point: Option<Shown>,
    /// A point in a column whose points could all separate thousands. It counts as a decimal sign unless commas
    /// contradict it.
    open_point: Option<Shown>,
    comma: Option<Shown>,
    either: Option<Shown>,
}

/// A cell and its file.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Shown {
    cell: String,
    path: PathBuf,
}

impl Shown {
    fn of(cell: &str, path: &Path) -> Self {
        Self { cell: cell.trim().to_owned(), path: path.to_owned() }
    }
}

impl Signs {
    /// Whether a cell may add evidence that numbers with this sign do not have.
    pub fn may_tell(cell: &str, decimal: Decimal) -> bool {
        match decimal {
            Decimal::Point => cell.contains(','),
            Decimal::Comma => cell.contains('.'),
            Decimal::Unknown => true,
        }
    }

    /// Records a cell of the file at `path`.
    pub fn note(&mut self, cell: &str, path: &Path) {
        let seen = match sign_of(cell.trim()) {
            Sign::Point => &mut self.point,
            Sign::Comma => &mut self.comma,
            Sign::Either => &mut self.either,
            Sign::Nothing => return,
        };
        seen.get_or_insert_with(|| Shown::of(cell, path));
    }

    /// Records the cells of a column of the file at `path`. Where semicolons separate cells, points may separate
    /// thousands: programs whose decimal sign is the comma write so. Where commas separate cells, a point is a decimal
    /// sign.
    pub(crate) fn note_column(&mut self, cells: &[&str], separator: u8, path: &Path) {
        let are_grouped = separator != b',' && are_grouped(cells);
        let are_open = separator == b';' && are_grouped && may_be_thousands(cells);
        for cell in cells {
            let point = match sign_of(cell.trim()) {
                Sign::Point if are_open => &mut self.either,
                Sign::Point if are_grouped && grouped(cell, '.') => &mut self.open_point,
                _ => {
                    self.note(cell, path);
                    continue;
                }
            };
            point.get_or_insert_with(|| Shown::of(cell, path));
        }
    }

    /// Adds evidence that was seen later.
    pub fn adopt(&mut self, later: Self) {
        self.point = self.point.take().or(later.point);
        self.open_point = self.open_point.take().or(later.open_point);
        self.comma = self.comma.take().or(later.comma);
        self.either = self.either.take().or(later.either);
    }

    /// Returns the decimal sign that all cells agree on.
    ///
    /// # Errors
    /// If two cells contradict each other, or if all cells can be read in two ways.
    pub fn decimal(&self) -> Result<Decimal, SignError> {
        self.refuse_contradiction()?;
        match (&self.point, &self.comma, &self.either) {
            (Some(_), _, _) => Ok(Decimal::Point),
            (None, Some(_), _) => Ok(Decimal::Comma),
            (None, None, Some(Shown { cell, path })) => {
                Err(SignError { path: path.clone(), reason: either_way(cell) })
            }
            (None, None, None) if self.open_point.is_some() => Ok(Decimal::Point),
            (None, None, None) => Ok(Decimal::Unknown),
        }
    }

    /// Returns the warning for points that are read as decimal signs although every one may separate thousands.
    pub fn doubt(&self) -> Option<String> {
        let Shown { cell, path } = self.open_point.as_ref().filter(|_| self.point.is_none())?;
        Some(format!(
            "points such as that of {cell} in {} are read as signs of fractions: if they stand between thousands, set data.decimal = \",\"",
            path.display()
        ))
    }

    /// Rejects two cells that have, or may have, different decimal signs.
    ///
    /// # Errors
    /// If there are such cells.
    pub fn refuse_contradiction(&self) -> Result<(), SignError> {
        let (point, comma) = match (&self.point, &self.open_point, &self.comma, &self.either) {
            (Some(point), _, Some(comma), _) | (None, Some(point), Some(comma), _) => {
                (point, comma)
            }
            // 3.611 and 10,710: one of them is above a thousand, and nothing shows which.
            (None, Some(point), None, Some(comma)) if comma.cell.contains(',') => (point, comma),
            _ => return Ok(()),
        };
        let elsewhere = if point.path == comma.path {
            format!("and {}", comma.cell)
        } else {
            format!("and {} has {}", comma.path.display(), comma.cell)
        };
        let reason = format!(
            "it has {} {elsewhere}: set data.decimal to \".\" or \",\", the sign that separates fractions",
            point.cell
        );
        Err(SignError { path: point.path.clone(), reason })
    }
}

/// Number of digits of a whole number that an f64 holds exactly, and the powers of ten by which it may be divided.
const EXACT_DIGITS: usize = 15;
const POWERS_OF_TEN: [f64; EXACT_DIGITS + 1] =
    [1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15];

/// Returns the number in a plainly written `cell`: an optional minus, digits, and at most one decimal sign between
/// digits. `None` says nothing about the cell.
///
/// Most cells of most logs are plain, and this is several times faster than [`cell_of`]. It gives the same bits: the
/// whole number and the power of ten are exact, and one division rounds correctly (Clinger 1990).
#[inline]
pub fn plain_decimal(cell: &[u8], decimal: Decimal) -> Option<f64> {
    let fraction_sign = if decimal == Decimal::Comma { b',' } else { b'.' };
    let (is_negative, digits) = match cell {
        [b'-', digits @ ..] => (true, digits),
        digits => (false, digits),
    };
    if digits.is_empty() || digits.len() > EXACT_DIGITS + 1 {
        return None;
    }
    let mut whole = 0_u64;
    let mut sign_at = None;
    for (position, &byte) in digits.iter().enumerate() {
        let digit = byte.wrapping_sub(b'0');
        if digit < 10 {
            whole = 10 * whole + u64::from(digit);
        } else if byte == fraction_sign && sign_at.is_none() {
            sign_at = Some(position);
        } else {
            return None;
        }
    }
    let decimals = match sign_at {
        None if digits.len() > EXACT_DIGITS => return None,
        None => 0,
        Some(at) if at == 0 || at + 1 == digits.len() => return None,
        Some(at) => digits.len() - at - 1,
    };
    let value = whole as f64 / POWERS_OF_TEN[decimals];
    Some(if is_negative { -value } else { value })
}

/// Whether a cell is a number with a point that may be a decimal sign or separate thousands.
pub fn may_be_thousand(cell: &str) -> bool {
    let cell = cell.trim();
    sign_of(cell) == Sign::Point && grouped(cell, '.')
}

/// Returns the message for a number that can be read in two ways.
pub fn either_way(cell: &str) -> String {
    let (sign, other) = if cell.contains(',') { (',', '.') } else { ('.', ',') };
    format!(
        "{cell} is a fraction if data.decimal = \"{sign}\" and above a thousand if data.decimal = \"{other}\": say which is meant"
    )
}

/// Whether a column has points, and every one is where it could separate thousands.
fn are_grouped(cells: &[&str]) -> bool {
    let mut pointed = cells
        .iter()
        .filter(|cell| cell.contains('.') && (is_finite(cell) || grouped(cell, '.')))
        .peekable();
    pointed.peek().is_some() && pointed.all(|cell| grouped(cell, '.'))
}

/// Whether the cells of a column with [such points](are_grouped) may be whole numbers: several distinct numbers of
/// three digits have no point. One alone may be a limit, or stand for a missing value, as 999 does.
fn may_be_thousands(cells: &[&str]) -> bool {
    cells
        .iter()
        .filter(|cell| cell.len() == 3 && are_digits(cell) && **cell != "999")
        .collect::<BTreeSet<_>>()
        .len()
        > 1
        && !cells.iter().any(|cell| cell.contains(','))
}

/// Returns the evidence of `text` about the decimal sign.
pub(crate) fn sign_of(text: &str) -> Sign {
    let joined = without_spaces(text);
    let text = mantissa(joined.as_deref().unwrap_or(text));
    let commas = count(text, b',');
    let points = count(text, b'.');
    match (commas, points) {
        (0, 1) if is_finite(text) => Sign::Point,
        (1, 0) if is_finite(&text.replace(',', ".")) => {
            if grouped(text, ',') {
                Sign::Either
            } else {
                Sign::Comma
            }
        }
        (2.., 0) if grouped(text, ',') => Sign::Point,
        (0, 2..) if grouped(text, '.') => Sign::Comma,
        (1.., 1..) => match (text.rfind(','), text.rfind('.')) {
            (Some(comma), Some(point)) if comma > point && grouped(&text[..comma], '.') => {
                Sign::Comma
            }
            (Some(comma), Some(point)) if comma < point && grouped(&text[..point], ',') => {
                Sign::Point
            }
            _ => Sign::Nothing,
        },
        _ => Sign::Nothing,
    }
}

fn is_finite(text: &str) -> bool {
    text.parse::<f64>().is_ok_and(f64::is_finite)
}

/// Reads `text` as a number; `None` if it is not a number, or not certainly one.
pub fn parse_number(text: &str, decimal: Decimal) -> Option<f64> {
    let joined = without_spaces(text);
    let text = joined.as_deref().unwrap_or(text);
    let bytes = text.as_bytes();
    let has_comma = memchr::memchr(b',', bytes).is_some();
    match decimal {
        Decimal::Point if !has_comma => parse_plain(text),
        Decimal::Point => parse_grouped(text, '.', ','),
        Decimal::Comma => {
            if !has_comma && memchr::memchr(b'.', bytes).is_none() {
                parse_plain(text)
            } else {
                parse_grouped(text, ',', '.')
            }
        }
        Decimal::Unknown if !has_comma && count(text, b'.') < 2 => parse_plain(text),
        Decimal::Unknown => match sign_of(text) {
            Sign::Comma => parse_grouped(text, ',', '.'),
            Sign::Point => parse_grouped(text, '.', ','),
            Sign::Either | Sign::Nothing => None,
        },
    }
}

fn parse_plain(text: &str) -> Option<f64> {
    text.parse().ok().or(match text {
        "true" | "True" | "TRUE" => Some(1.0),
        "false" | "False" | "FALSE" => Some(0.0),
        _ => None,
    })
}

/// Reads a number with the given decimal sign and the given separator of thousands.
fn parse_grouped(text: &str, fraction: char, thousands: char) -> Option<f64> {
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

/// Removes the spaces or apostrophes that separate thousands; `None` if there are none.
fn without_spaces(text: &str) -> Option<String> {
    if text.bytes().all(|byte| byte.is_ascii() && byte != b' ' && byte != b'\'') {
        return None;
    }
    let end = text.find(['.', ',', 'e', 'E']).unwrap_or(text.len());
    let (whole, rest) = text.split_at(end);
    let sign = whole.chars().find(|sign| BETWEEN_THOUSANDS.contains(sign))?;
    grouped(whole, sign).then(|| {
        let mut number: String = whole.chars().filter(|&c| c != sign).collect();
        number.push_str(rest);
        number
    })
}

/// A space, a no-break space, two narrow spaces, and apostrophes.
const BETWEEN_THOUSANDS: [char; 6] = [' ', '\u{A0}', '\u{202F}', '\u{2009}', '\'', '\u{2019}'];

/// Returns the number without its power of ten.
fn mantissa(text: &str) -> &str {
    &text[..text.find(['e', 'E']).unwrap_or(text.len())]
}

/// Whether groups of three digits follow a first group of one to three.
fn grouped(text: &str, sign: char) -> bool {
    let text = text.strip_prefix(['+', '-']).unwrap_or(text);
    let mut groups = text.split(sign);
    let first = groups.next().is_some_and(|group| {
        (1..=3).contains(&group.len()) && are_digits(group) && !(group.starts_with('0'))
    });
    let mut later = groups.peekable();
    first && later.peek().is_some() && later.all(|group| group.len() == 3 && are_digits(group))
}

fn are_digits(group: &str) -> bool {
    group.bytes().all(|byte| byte.is_ascii_digit())
}

fn count(text: &str, byte: u8) -> usize {
    memchr::memchr_iter(byte, text.as_bytes()).count()
}

/// Reads `text` as a cell; `None` if it could be either of two numbers. Text that is not a number is a word, which
/// counts as missing.
pub fn cell_of(text: &str, decimal: Decimal, words: &mut Words) -> Option<Cell> {
    let text = text.trim();
    if text.is_empty() {
        return Some(Cell::Missing);
    }
    match parse_number(text, decimal) {
        Some(value) if value.abs() <= LARGEST => Some(Cell::Number(value)),
        Some(_) => Some(Cell::NonFinite),
        None if decimal == Decimal::Unknown && sign_of(text) == Sign::Either => None,
        None => Some(Cell::Word(words.position(text))),
    }
}

#[cfg(test)]
mod tests;
