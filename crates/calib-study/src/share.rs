use std::{fmt, ops::Range};

/// One of several equal shares of the work, for processes on one machine or on several machines.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Share {
    number: usize,
    count: usize,
}

impl Share {
    /// Creates share `number`, counted from 0, of `count` shares; `None` if there is no such share.
    pub fn new(number: usize, count: usize) -> Option<Self> {
        (number < count).then_some(Self { number, count })
    }

    /// Whether this share has the piece of work with this number.
    pub fn has(self, piece: usize) -> bool {
        piece % self.count == self.number
    }

    /// Counts the pieces of this share among the pieces with these numbers.
    pub fn pieces(self, numbers: Range<usize>) -> usize {
        let [before, with_these] = [numbers.start, numbers.end]
            .map(|end| end.saturating_sub(self.number).div_ceil(self.count));
        with_these.saturating_sub(before)
    }
}

impl fmt::Display for Share {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.number, self.count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_piece_is_in_one_share() {
        for count in 1..6 {
            let shares: Vec<Share> =
                (0..count).filter_map(|number| Share::new(number, count)).collect();
            assert_eq!(shares.len(), count);
            for piece in 0..20 {
                assert_eq!(shares.iter().filter(|share| share.has(piece)).count(), 1);
                for share in &shares {
                    let listed = (piece..20).filter(|&piece| share.has(piece)).count();
                    assert_eq!(share.pieces(piece..20), listed, "{share} from {piece}");
                }
            }
        }
        assert_eq!(Share::new(3, 3), None);
        assert_eq!(Share::new(0, 0), None);
    }
}
