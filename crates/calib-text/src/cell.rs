//! A cell of text in eight bytes: a number, a missing value, or the index of a word.

use std::{collections::HashMap, sync::Arc};

/// The content of a cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Cell {
    /// A finite number.
    Number(f64),
    /// An empty cell.
    Missing,
    /// NaN, infinity, or a number larger than any plant measures.
    NonFinite,
    /// A word, by its position in [`Words`].
    Word(u32),
}

/// Bits of a quiet NaN. Its payload tells the cells without a number apart.
const NAN_BITS: u64 = 0x7FF8_0000_0000_0000;
const NON_FINITE: u64 = 1;
const FIRST_WORD: u64 = 2;

impl Cell {
    /// Encodes a number as its own bits, and every other cell as a NaN with a payload.
    #[inline]
    pub fn encode(self) -> u64 {
        match self {
            Self::Number(value) => value.to_bits(),
            Self::Missing => NAN_BITS,
            Self::NonFinite => NAN_BITS | NON_FINITE,
            Self::Word(word) => NAN_BITS | (FIRST_WORD + u64::from(word)),
        }
    }

    /// Returns the cell that [`Self::encode`] turned into these bits.
    #[inline]
    pub fn decode(bits: u64) -> Self {
        let value = f64::from_bits(bits);
        match bits & !NAN_BITS {
            _ if !value.is_nan() => Self::Number(value),
            0 => Self::Missing,
            NON_FINITE => Self::NonFinite,
            word => Self::Word((word - FIRST_WORD) as u32),
        }
    }
}

/// Limits on the number of distinct words that are kept and on their total bytes. All further words
/// count as one word.
const KEPT: usize = 1 << 20;
const KEPT_BYTES: usize = 64 << 20;
/// The word that stands for all words beyond [`KEPT`].
pub(crate) const OTHER_WORDS: &str = "(other words)";

/// The distinct words of a log.
#[derive(Clone, Debug, Default)]
pub struct Words {
    list: Vec<Arc<str>>,
    positions: HashMap<Arc<str>, u32>,
    bytes: usize,
    is_bounded: bool,
    /// Position of the word that stands for all words that are not kept.
    others: Option<u32>,
}

impl Words {
    /// Creates an empty list for a whole log, which keeps a limited number of words to save memory.
    pub fn bounded() -> Self {
        Self { is_bounded: true, ..Self::default() }
    }

    /// Returns the position of `word`, and adds it if it is new.
    pub fn position(&mut self, word: &str) -> u32 {
        if let Some(&position) = self.positions.get(word) {
            return position;
        }
        let is_full = self.list.len() >= KEPT || self.bytes + word.len() > KEPT_BYTES;
        if self.is_bounded && is_full {
            return self.other();
        }
        let word: Arc<str> = Arc::from(word);
        let position = self.add(Arc::clone(&word));
        self.bytes += word.len();
        self.positions.insert(word, position);
        position
    }

    fn add(&mut self, word: Arc<str>) -> u32 {
        self.list.push(word);
        (self.list.len() - 1) as u32
    }

    /// Returns the position of the word that stands for all words that are not kept.
    fn other(&mut self) -> u32 {
        let others = self.others.unwrap_or_else(|| self.add(Arc::from(OTHER_WORDS)));
        *self.others.insert(others)
    }

    /// Returns the position in this list of a word of `other`.
    pub fn translated(&mut self, other: &Self, word: u32) -> u32 {
        if other.others == Some(word) { self.other() } else { self.position(other.word(word)) }
    }

    /// Returns the word at a position.
    pub fn word(&self, position: u32) -> &str {
        &self.list[position as usize]
    }

    /// Iterates over all words in the order of their positions.
    pub fn all(&self) -> impl Iterator<Item = &str> {
        self.list.iter().map(|word| &**word)
    }

    /// Whether a cell stands for words that are not kept.
    pub fn is_other(&self, cell: u64) -> bool {
        matches!(Cell::decode(cell), Cell::Word(word) if self.others == Some(word))
    }

    /// Translates `cells`, whose words are those of `other`, to the words of this list.
    pub fn adopt(&mut self, other: &Self, cells: &mut [u64]) {
        if other.list.is_empty() {
            return;
        }
        let words = 0..other.list.len() as u32;
        let positions: Vec<u32> = words.map(|word| self.translated(other, word)).collect();
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
        let mut all = Words::bounded();
        all.position("Bad");
        let mut part = Words::default();
        let mut cells =
            [part.position("No Data"), part.position("Bad")].map(|word| Cell::Word(word).encode());
        all.adopt(&part, &mut cells);
        assert_eq!(cells.map(Cell::decode), [Cell::Word(1), Cell::Word(0)]);
        assert_eq!([all.word(0), all.word(1)], ["Bad", "No Data"]);
        for word in 0..KEPT + 9 {
            all.position(&format!("w{word}"));
        }
        assert_eq!(all.list.len(), KEPT + 1);
        let other = all.position("one more");
        assert_eq!(all.word(other), OTHER_WORDS);
        assert!(all.is_other(Cell::Word(other).encode()));
        assert!(!all.is_other(Cell::Word(0).encode()));
        let mut next = Words::bounded();
        let mut cells = [Cell::Word(other).encode()];
        next.adopt(&all, &mut cells);
        assert!(next.is_other(cells[0]), "what is lost stays lost");
        let mut long = Words::bounded();
        for word in 0..9_000 {
            long.position(&format!("{word:08192}"));
        }
        assert!(long.bytes <= KEPT_BYTES && long.others.is_some());
    }
}
