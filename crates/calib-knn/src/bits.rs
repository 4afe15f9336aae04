//! A set of transitions, with one bit each.

use std::ops::Range;

const WORD: usize = u64::BITS as usize;

/// A set of numbers below a length. An empty set may have length zero.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Bits {
    words: Vec<u64>,
    len: usize,
}

impl Bits {
    /// Returns the empty set of numbers below `len`.
    pub(crate) fn new(len: usize) -> Self {
        Self { words: vec![0; len.div_ceil(WORD)], len }
    }

    pub(crate) fn contains(&self, number: u32) -> bool {
        let word = self.words.get(number as usize / WORD);
        word.is_some_and(|word| word >> (number as usize % WORD) & 1 == 1)
    }

    /// Inserts `number`, and returns whether it was new.
    ///
    /// # Panics
    /// If `number` is not below the length.
    pub(crate) fn insert(&mut self, number: u32) -> bool {
        let word = &mut self.words[number as usize / WORD];
        let bit = number as usize % WORD;
        let new = *word >> bit & 1 == 0;
        *word |= 1 << bit;
        new
    }

    /// Returns how many numbers are in the set.
    pub(crate) fn count(&self) -> usize {
        self.words.iter().map(|word| word.count_ones() as usize).sum()
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.words.iter().all(|&word| word == 0)
    }

    /// Returns the numbers that are not in `other`.
    pub(crate) fn without(mut self, other: &Self) -> Self {
        for (word, out) in self.words.iter_mut().zip(&other.words) {
            *word &= !out;
        }
        self
    }

    /// Returns how many numbers are in both sets.
    pub(crate) fn common(&self, other: &Self) -> usize {
        let pairs = self.words.iter().zip(&other.words);
        pairs.map(|(a, b)| (a & b).count_ones() as usize).sum()
    }

    /// Returns the first number at or after `from` that is not in the set. Numbers beyond the
    /// length are not in the set.
    pub(crate) fn first_absent(&self, from: u32) -> u32 {
        let mut word = from as usize / WORD;
        let mut mask = !0 << (from as usize % WORD);
        while let Some(bits) = self.words.get(word) {
            let absent = !bits & mask;
            if absent != 0 {
                return (word * WORD) as u32 + absent.trailing_zeros();
            }
            (word, mask) = (word + 1, !0);
        }
        from.max((word * WORD) as u32)
    }

    /// Returns the runs of consecutive numbers in the set, ascending.
    pub(crate) fn runs(&self) -> impl Iterator<Item = Range<u32>> + '_ {
        self.iter()
            .filter(|&number| number == 0 || !self.contains(number - 1))
            .map(|start| start..self.first_absent(start))
    }

    /// Returns the numbers in the set, ascending.
    pub(crate) fn iter(&self) -> impl Iterator<Item = u32> + '_ {
        self.words.iter().enumerate().flat_map(|(number, &word)| {
            let mut left = word;
            std::iter::from_fn(move || {
                let bit = (left != 0).then(|| left.trailing_zeros())?;
                left &= left - 1;
                Some((number * WORD) as u32 + bit)
            })
        })
    }

    /// Returns the words of the set, 64 numbers each. The smallest number is the lowest bit.
    pub(crate) fn words(&self) -> &[u64] {
        &self.words
    }

    /// Returns the set with these words, of numbers below `len`.
    pub(crate) fn from_words(words: Vec<u64>, len: usize) -> Self {
        debug_assert_eq!(words.len(), len.div_ceil(WORD));
        Self { words, len }
    }

    /// Returns the set of these numbers below `len`.
    pub(crate) fn of(len: usize, numbers: impl IntoIterator<Item = u32>) -> Self {
        let mut bits = Self::new(len);
        bits.extend(numbers);
        bits
    }

    /// Returns the length: all numbers are below it.
    pub(crate) fn len(&self) -> usize {
        self.len
    }
}

impl Extend<u32> for Bits {
    fn extend<T: IntoIterator<Item = u32>>(&mut self, numbers: T) {
        for number in numbers {
            self.insert(number);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn they_are_a_set(
            numbers in proptest::collection::vec(0_u32..300, 0..400),
            others in proptest::collection::btree_set(0_u32..300, 0..200),
        ) {
            let (mut bits, mut set) = (Bits::new(300), BTreeSet::new());
            for &number in &numbers {
                prop_assert_eq!(bits.insert(number), set.insert(number));
            }
            let second = Bits::of(300, others.iter().copied());
            prop_assert_eq!(bits.iter().collect::<Vec<_>>(), set.iter().copied().collect::<Vec<_>>());
            prop_assert_eq!((bits.count(), bits.is_empty()), (set.len(), set.is_empty()));
            let runs: Vec<_> = bits.runs().collect();
            prop_assert!(runs.windows(2).all(|pair| pair[0].end < pair[1].start));
            prop_assert_eq!(runs.into_iter().flatten().collect::<Vec<_>>(), bits.iter().collect::<Vec<_>>());
            prop_assert_eq!(bits.common(&second), set.intersection(&others).count());
            let rest: Vec<u32> = set.difference(&others).copied().collect();
            prop_assert_eq!(bits.clone().without(&second).iter().collect::<Vec<_>>(), rest);
            for from in 0..330 {
                let absent = (from..=330).find(|number| !set.contains(number));
                prop_assert_eq!(Some(bits.first_absent(from)), absent);
                prop_assert_eq!(bits.contains(from), set.contains(&from));
            }
        }
    }

    #[test]
    fn no_numbers_need_no_length() {
        let none = Bits::default();
        assert!(none.is_empty() && !none.contains(7));
        assert_eq!((none.first_absent(7), none.len()), (7, 0));
    }
}
