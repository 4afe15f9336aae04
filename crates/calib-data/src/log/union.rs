//! The sorted union of the items of many channels.

use rayon::prelude::*;

/// Minimum number of items before they are sorted.
const WAITING: usize = 1 << 16;

/// A union that grows in parts. It is sorted when it has doubled, so many parts cost no more than one of their size,
/// and duplicates take no room.
pub(crate) struct Union<T> {
    all: Vec<T>,
    settled: usize,
    /// Whether the first item merges into the second, which precedes it. If so, it extends the second.
    join: fn(&mut T, &mut T) -> bool,
}

impl<T: Ord + Copy + Send> Union<T> {
    pub(crate) fn new(join: fn(&mut T, &mut T) -> bool) -> Self {
        Self { all: Vec::new(), settled: 0, join }
    }

    /// Adds a part, whose items are sorted.
    pub(crate) fn extend(&mut self, items: impl Iterator<Item = T>) {
        for mut item in items {
            let joined = self.all.len() > self.settled
                && self
                    .all
                    .last_mut()
                    .is_some_and(|last| *last <= item && (self.join)(&mut item, last));
            if !joined {
                self.all.push(item);
            }
            if self.all.len() >= (2 * self.settled).max(WAITING) {
                self.settle();
            }
        }
    }

    /// Returns all items in order.
    pub(crate) fn settled(&mut self) -> &[T] {
        self.settle();
        &self.all
    }

    pub(crate) fn into_settled(mut self) -> Vec<T> {
        self.settle();
        self.all
    }

    fn settle(&mut self) {
        if self.settled < self.all.len() {
            self.all.par_sort_unstable();
            self.all.dedup_by(self.join);
            self.settled = self.all.len();
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
        fn all_are_there_once_and_in_order(
            parts in prop::collection::vec(prop::collection::vec(0_i64..300, 0..40), 0..20),
            settle in prop::collection::vec(any::<bool>(), 20),
        ) {
            let mut union = Union::new(|next, last| next == last);
            for (mut part, settle) in parts.clone().into_iter().zip(settle) {
                part.sort_unstable();
                union.extend(part.into_iter());
                if settle {
                    union.settle();
                }
            }
            let expected: BTreeSet<i64> = parts.into_iter().flatten().collect();
            prop_assert_eq!(union.into_settled(), expected.into_iter().collect::<Vec<_>>());
        }
    }

    #[test]
    fn what_is_put_in_order_now_and_then_is_the_same() {
        let mut union = Union::new(|next, last| next == last);
        for part in 0..50 {
            union.extend((0..10_000).map(|item| item * 50 + part % 25));
        }
        assert_eq!(union.into_settled().len(), 250_000);
    }
}
