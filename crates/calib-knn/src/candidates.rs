use std::ops::Range;

/// The sources that can be neighbours.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Candidates<'a> {
    /// One source in this many, in time order, beginning with the first.
    Every(u32),
    /// These transitions, in ascending order.
    Chosen(&'a [u32]),
}

impl Candidates<'_> {
    /// Returns how many of the transitions before `end` can be neighbours.
    pub(crate) fn before(self, end: u32) -> u32 {
        match self {
            Self::Every(every) => end.div_ceil(every),
            Self::Chosen(chosen) => chosen.partition_point(|&kept| kept < end) as u32,
        }
    }

    /// Returns how many transitions of `range` can be neighbours.
    pub(crate) fn count(self, range: &Range<u32>) -> usize {
        if range.is_empty() {
            0
        } else {
            (self.before(range.end) - self.before(range.start)) as usize
        }
    }

    /// Returns the maximum number of candidates in a range of `length` transitions.
    pub(crate) fn most_in(self, length: u64) -> usize {
        match self {
            Self::Every(every) => length.div_ceil(u64::from(every)) as usize,
            Self::Chosen(_) => length as usize,
        }
    }

    pub(crate) fn nth(self, number: u32) -> u32 {
        match self {
            Self::Every(every) => number * every,
            Self::Chosen(chosen) => chosen[number as usize],
        }
    }

    pub(crate) fn contains(self, transition: u32) -> bool {
        match self {
            Self::Every(every) => transition.is_multiple_of(every),
            Self::Chosen(chosen) => chosen.binary_search(&transition).is_ok(),
        }
    }

    /// Returns the last candidate at or before `transition`, or the first of all if none precedes
    /// it.
    pub(crate) fn near(self, transition: u32) -> u32 {
        self.nth(self.before(transition + 1).saturating_sub(1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn candidates_are_counted_and_found() {
        let chosen: Vec<u32> = (0..5).map(|number| 4 * number).collect();
        let odd = [3, 4, 9, 13];
        for candidates in
            [Candidates::Every(4), Candidates::Chosen(&chosen), Candidates::Chosen(&odd)]
        {
            let all: Vec<u32> = (0..20).filter(|&t| candidates.contains(t)).collect();
            let numbered: Vec<u32> = (0..all.len() as u32).map(|n| candidates.nth(n)).collect();
            assert_eq!(all, numbered);
            for start in 0..20 {
                for end in 0..=20 {
                    let expected = all.iter().filter(|&t| (start..end).contains(t)).count();
                    assert_eq!(candidates.count(&(start..end)), expected, "{start}..{end}");
                }
                let near = all.iter().copied().rfind(|&t| t <= start).unwrap_or(all[0]);
                assert_eq!(candidates.near(start), near);
            }
        }
    }
}
