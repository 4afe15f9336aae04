//! A cell of text as eight bytes: a number, nothing, or the number of a word.

use std::collections::HashMap;

/// What a cell holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Cell {
    /// A finite number.
    Number(f64),
    /// Nothing.
    Missing,
    /// NaN, infinity, or more than any plant measures.
    NonFinite,
    /// A word, by its position in [`Words`].
    Word(u32),
}

/// The bits of a quiet NaN; what follows them tells which cell without a number it is.
const NAN_BITS: u64 = 0x7FF8_0000_0000_0000;
const NON_FINITE: u64 = 1;
const FIRST_WORD: u64 = 2;

impl Cell {
    /// A number as its own bits, all else as a NaN with a payload.
    pub(crate) fn encode(self) -> u64 {
        match self {
            Self::Number(value) => value.to_bits(),
            Self::Missing => NAN_BITS,
            Self::NonFinite => NAN_BITS | NON_FINITE,
            Self::Word(word) => NAN_BITS | (FIRST_WORD + u64::from(word)),
        }
    }

    /// The cell that [`Self::encode`] gave these bits.
    pub(crate) fn decode(bits: u64) -> Self {
        let value = f64::from_bits(bits);
        match bits & !NAN_BITS {
            _ if !value.is_nan() => Self::Number(value),
            0 => Self::Missing,
            NON_FINITE => Self::NonFinite,
            word => Self::Word((word - FIRST_WORD) as u32),
        }
    }
}

/// Distinct words that are kept; the rest is one word.
const KEPT: usize = 1 << 20;
/// What words beyond [`KEPT`] are.
pub(crate) const OTHER_WORDS: &str = "(other words)";

/// The words of a log, each once.
#[derive(Clone, Debug, Default)]
pub(crate) struct Words {
    list: Vec<String>,
    positions: HashMap<String, u32>,
}

impl Words {
    /// The position of `word`, which is new or known.
    pub(crate) fn position(&mut self, word: &str) -> u32 {
        if let Some(&position) = self.positions.get(word) {
            return position;
        }
        let word = if self.list.len() >= KEPT { OTHER_WORDS } else { word };
        let next = self.list.len() as u32;
        let position = *self.positions.entry(word.to_owned()).or_insert(next);
        if position == next {
            self.list.push(word.to_owned());
        }
        position
    }

    pub(crate) fn list(&self) -> &[String] {
        &self.list
    }

    /// Make `cells`, whose words are those of `other`, cells of this list.
    pub(crate) fn adopt(&mut self, other: &Self, cells: &mut [u64]) {
        if other.list.is_empty() {
            return;
        }
        let positions: Vec<u32> = other.list.iter().map(|word| self.position(word)).collect();
        for bits in cells {
            if let Cell::Word(word) = Cell::decode(*bits) {
                *bits = Cell::Word(positions[word as usize]).encode();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_survive() {
        let cells =
            [Cell::Number(-1.5), Cell::Number(0.0), Cell::Missing, Cell::NonFinite, Cell::Word(0)];
        for cell in cells.into_iter().chain([Cell::Word(1 << 20), Cell::Number(f64::MIN_POSITIVE)])
        {
            assert_eq!(Cell::decode(cell.encode()), cell);
        }
        assert_eq!(Cell::decode(f64::NAN.to_bits()), Cell::Missing);
    }

    #[test]
    fn words_are_adopted_and_bounded() {
        let mut all = Words::default();
        all.position("Bad");
        let mut part = Words::default();
        let mut cells =
            [part.position("No Data"), part.position("Bad")].map(|word| Cell::Word(word).encode());
        all.adopt(&part, &mut cells);
        assert_eq!(cells.map(Cell::decode), [Cell::Word(1), Cell::Word(0)]);
        assert_eq!(all.list(), ["Bad", "No Data"]);
        for word in 0..KEPT + 9 {
            all.position(&format!("w{word}"));
        }
        assert_eq!(all.list().len(), KEPT + 1);
        assert_eq!(all.list()[KEPT], OTHER_WORDS);
    }
}
