//! Converts a column of a file to `f64`, and counts the values that are not numbers.

use std::{
    collections::{BTreeMap, BTreeSet},
    sync::Arc,
};

use calib_text::LARGEST;
use polars::prelude as pl;

use super::store::Store;
use crate::text::{Cell, Decimal, Switch, Words, cell_of};

/// Maximum number of distinct words; all further words count as one.
const WORDS: usize = 1_000;
/// The word that stands for all words beyond [`WORDS`].
const OTHER_WORDS: &str = "(other words)";

/// Values of a channel that are not numbers.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct NotNumbers {
    /// Number of NaN, infinite values and values beyond ±1e150.
    pub(crate) non_finite: u64,
    /// Text that is not a number, with its frequency.
    pub(crate) words: BTreeMap<String, u64>,
    /// Words that are read as 1 and 0.
    pub(crate) switch: Option<Switch>,
}

impl NotNumbers {
    /// Returns the words with their frequencies, the most frequent first; the words that are counted together come
    /// last.
    pub(crate) fn by_frequency(&self) -> Vec<(String, u64)> {
        let mut words: Vec<(String, u64)> = self.words.clone().into_iter().collect();
        words.sort_by_key(|(word, times)| (word == OTHER_WORDS, std::cmp::Reverse(*times)));
        words
    }

    /// Returns the most frequent word, on a tie the first in the alphabet; `None` without words.
    pub(crate) fn example(&self) -> Option<String> {
        self.by_frequency().into_iter().next().map(|(word, _)| word)
    }

    /// Starts the count for cells that are read again, with the words of `switch` as numbers.
    pub(crate) fn with(switch: Switch) -> Self {
        Self { switch: Some(switch), ..Self::default() }
    }

    /// The pair of words that cells without a number and the `replaced` ones hold, and nothing else.
    pub(crate) fn pair<'a>(&'a self, replaced: impl Iterator<Item = &'a str>) -> Option<Switch> {
        if self.non_finite > 0 || self.switch.is_some() || self.words.is_empty() {
            return None;
        }
        let words: BTreeSet<&str> = self.words.keys().map(String::as_str).chain(replaced).collect();
        Switch::of(words.into_iter())
    }

    /// Returns the number that a word is read as. Returns NaN for other words, and counts them.
    fn word(&mut self, word: &str) -> f64 {
        if let Some(value) = self.switch.as_ref().and_then(|switch| switch.value(word)) {
            return value;
        }
        let word = shown(word);
        if let Some(count) = self.words.get_mut(word) {
            *count += 1;
        } else {
            let full = self.words.len() >= WORDS;
            let word = if full { OTHER_WORDS } else { word };
            *self.words.entry(word.to_owned()).or_default() += 1;
        }
        f64::NAN
    }
}

/// Cuts a word to a readable length.
fn shown(word: &str) -> &str {
    word.char_indices().nth(SHOWN_LETTERS).map_or(word, |(end, _)| &word[..end])
}

/// Maximum number of letters of a word that are shown.
const SHOWN_LETTERS: usize = 100;

/// A column in the form of its file.
#[derive(Clone, Debug)]
pub(crate) enum RawColumn {
    Polars(pl::Column),
    Cells(Vec<u64>, Arc<Store>),
}

/// Writes the values of `column` to `out`, NaN where there is no finite number.
pub(crate) fn to_numbers(
    column: &RawColumn,
    out: &mut [f64],
    not_numbers: &mut NotNumbers,
) -> pl::PolarsResult<()> {
    match column {
        RawColumn::Polars(column) => polars_to_numbers(column, out, not_numbers),
        RawColumn::Cells(cells, store) => {
            cells_to_numbers(cells, &store.words, out, not_numbers);
            Ok(())
        }
    }
}

/// Writes the numbers among `cells` to `out`, and counts the other cells.
pub(crate) fn cells_to_numbers(
    cells: &[u64],
    words: &Words,
    out: &mut [f64],
    not_numbers: &mut NotNumbers,
) {
    for (out, &cell) in out.iter_mut().zip(cells) {
        *out = match Cell::decode(cell) {
            Cell::Number(value) => value,
            Cell::Missing => f64::NAN,
            Cell::NonFinite => {
                not_numbers.non_finite += 1;
                f64::NAN
            }
            Cell::Word(word) => not_numbers.word(words.word(word)),
        };
    }
}

pub(crate) fn to_cells(column: &RawColumn, words: &mut Words) -> pl::PolarsResult<Vec<u64>> {
    use pl::DataType as D;
    let column = match column {
        RawColumn::Cells(cells, _) => return Ok(cells.clone()),
        RawColumn::Polars(column) => column,
    };
    if let D::String | D::Categorical(..) | D::Enum(..) = column.dtype() {
        let text = column.cast(&D::String)?;
        let cells = text.str()?.iter().map(|text| {
            let cell = text.and_then(|text| cell_of(text, Decimal::Point, words));
            cell.unwrap_or(Cell::Missing).encode()
        });
        return Ok(cells.collect());
    }
    let mut values = vec![f64::NAN; column.len()];
    polars_to_numbers(column, &mut values, &mut NotNumbers::default())?;
    let cells = values.into_iter().map(|value| {
        let cell = if value.is_nan() { Cell::Missing } else { Cell::Number(value) };
        cell.encode()
    });
    Ok(cells.collect())
}

fn polars_to_numbers(
    column: &pl::Column,
    out: &mut [f64],
    not_numbers: &mut NotNumbers,
) -> pl::PolarsResult<()> {
    use pl::DataType as D;
    macro_rules! numbers {
        ($array:ident, $convert:expr) => {{
            let mut rest = out;
            for chunk in column.$array()?.downcast_iter() {
                let (part, next) = rest.split_at_mut(chunk.len());
                rest = next;
                let values = chunk.values().iter().copied().map($convert);
                match chunk.validity() {
                    None => part.iter_mut().zip(values).for_each(|(out, value)| {
                        *out = finite(value, &mut not_numbers.non_finite);
                    }),
                    Some(valid) => {
                        for ((out, value), valid) in part.iter_mut().zip(values).zip(valid) {
                            *out = if valid {
                                finite(value, &mut not_numbers.non_finite)
                            } else {
                                f64::NAN
                            };
                        }
                    }
                }
            }
        }};
    }
    match column.dtype() {
        D::Float64 => numbers!(f64, |value| value),
        D::Float32 => numbers!(f32, f64::from),
        D::Int8 => numbers!(i8, f64::from),
        D::Int16 => numbers!(i16, f64::from),
        D::Int32 => numbers!(i32, f64::from),
        D::Int64 => numbers!(i64, |value| value as f64),
        D::UInt8 => numbers!(u8, f64::from),
        D::UInt16 => numbers!(u16, f64::from),
        D::UInt32 => numbers!(u32, f64::from),
        D::UInt64 => numbers!(u64, |value| value as f64),
        D::Boolean => {
            for (out, value) in out.iter_mut().zip(column.bool()?.iter()) {
                *out = value.map_or(f64::NAN, |value| f64::from(u8::from(value)));
            }
        }
        D::String | D::Categorical(..) | D::Enum(..) => {
            let text = column.cast(&D::String)?;
            for (out, text) in out.iter_mut().zip(text.str()?.iter()) {
                *out = text.map_or(f64::NAN, |text| parse(text, not_numbers));
            }
        }
        _ => {
            let column = column.cast(&D::Float64)?;
            for (out, value) in out.iter_mut().zip(column.f64()?.iter()) {
                *out = value.map_or(f64::NAN, |value| finite(value, &mut not_numbers.non_finite));
            }
        }
    }
    Ok(())
}

/// Calls `take` with each value of `column` as text, in order. Whole numbers have no fraction; missing and empty values
/// are `None`.
pub(crate) fn each_label(
    column: &RawColumn,
    mut take: impl FnMut(Option<&str>),
) -> pl::PolarsResult<()> {
    use pl::DataType as D;
    let column = match column {
        RawColumn::Cells(cells, store) => {
            for &cell in cells {
                with_label(cell, &store.words, &mut take);
            }
            return Ok(());
        }
        RawColumn::Polars(column) => column,
    };
    if let D::String | D::Categorical(..) | D::Enum(..) = column.dtype() {
        let text = column.cast(&D::String)?;
        for text in text.str()?.iter() {
            take(text.map(str::trim).filter(|text| !text.is_empty()));
        }
        return Ok(());
    }
    let mut values = vec![f64::NAN; column.len()];
    polars_to_numbers(column, &mut values, &mut NotNumbers::default())?;
    for value in values {
        if value.is_nan() {
            take(None);
        } else {
            take(Some(&value.to_string()));
        }
    }
    Ok(())
}

/// Calls `take` with a cell as text, `None` if it is missing.
pub(crate) fn with_label<T>(
    cell: u64,
    words: &Words,
    mut take: impl FnMut(Option<&str>) -> T,
) -> T {
    match Cell::decode(cell) {
        Cell::Number(value) => take(Some(&value.to_string())),
        Cell::Word(word) => take(Some(words.word(word))),
        Cell::Missing | Cell::NonFinite => take(None),
    }
}

/// Returns the value, or NaN if it is too large or not finite, which is counted.
fn finite(value: f64, non_finite: &mut u64) -> f64 {
    if value.abs() <= LARGEST {
        value
    } else {
        *non_finite += 1;
        f64::NAN
    }
}

fn parse(text: &str, not_numbers: &mut NotNumbers) -> f64 {
    let text = text.trim();
    if text.is_empty() {
        return f64::NAN;
    }
    if let Ok(value) = text.parse() {
        finite(value, &mut not_numbers.non_finite)
    } else {
        not_numbers.word(text)
    }
}

#[cfg(test)]
mod tests {
    use pl::{IntoColumn as _, NewChunkedArray as _};

    use super::*;

    fn numbers(column: &pl::Column) -> (Vec<f64>, NotNumbers) {
        let mut out = vec![0.0; column.len()];
        let mut not_numbers = NotNumbers::default();
        polars_to_numbers(column, &mut out, &mut not_numbers).expect("a known type");
        (out, not_numbers)
    }

    fn bits(values: &[f64]) -> Vec<u64> {
        values.iter().map(|value| value.to_bits()).collect()
    }

    fn same(left: &[f64], right: &[f64]) -> bool {
        bits(left) == bits(right)
    }

    #[test]
    fn words_are_counted() {
        let text = ["1.5", "Bad", " 2e3 ", "", "Scan Timeout", "Bad", "inf"];
        let column = pl::StringChunked::from_slice("a".into(), &text).into_column();
        let (values, not_numbers) = numbers(&column);
        let nan = f64::NAN;
        assert!(same(&values, &[1.5, nan, 2000.0, nan, nan, nan, nan]));
        assert_eq!(not_numbers.non_finite, 1);
        let words: Vec<_> = not_numbers.words.into_iter().collect();
        assert_eq!(words, [("Bad".to_owned(), 2), ("Scan Timeout".to_owned(), 1)]);
    }

    fn labels(column: pl::Column) -> Vec<Option<String>> {
        let mut labels: Vec<Option<String>> = Vec::new();
        each_label(&RawColumn::Polars(column), |label| labels.push(label.map(str::to_owned)))
            .expect("a known type");
        labels
    }

    #[test]
    fn numbers_and_text_have_labels() {
        let column =
            pl::Float64Chunked::from_slice_options("a".into(), &[Some(13.0), None, Some(0.5)]);
        let numbers = labels(column.into_column());
        assert_eq!(numbers, [Some("13".to_owned()), None, Some("0.5".to_owned())]);
        let column = pl::StringChunked::from_slice("a".into(), &[" on ", ""]).into_column();
        assert_eq!(labels(column), [Some("on".to_owned()), None]);
    }

    #[test]
    fn countless_words_are_counted_together() {
        let text: Vec<String> = (0..1_500).map(|word| format!("w{word}")).collect();
        let column = pl::StringChunked::from_slice("a".into(), &text).into_column();
        let (_, not_numbers) = numbers(&column);
        assert_eq!(not_numbers.words[OTHER_WORDS], 500);
        assert_eq!(not_numbers.example().as_deref(), Some("w0"), "a word that a cell holds");
        assert_eq!(not_numbers.by_frequency().last(), Some(&(OTHER_WORDS.to_owned(), 500)));
        assert_eq!(not_numbers.words.len(), WORDS + 1);
    }

    #[test]
    fn long_words_are_told_by_their_beginning() {
        let long = "é".repeat(9_000);
        let column = pl::StringChunked::from_slice("a".into(), &[long.as_str()]).into_column();
        let (_, not_numbers) = numbers(&column);
        assert_eq!(not_numbers.words.into_keys().next(), Some("é".repeat(SHOWN_LETTERS)));
    }
}
