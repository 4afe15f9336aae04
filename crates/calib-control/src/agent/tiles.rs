/// Tile coding of single columns and optionally of pairs of columns.
///
/// Each of `tilings` tilings cuts every column, whose range is 0 to 1, into `tiles` tiles. Its own shift is a share of a tile: tiling `t`
/// shifts column `c` by `((1 + 2c) · t mod tilings) / tilings` tiles (Sutton & Barto 2018, section 9.5.4). A state of `d` columns has one
/// feature per tiling for each column and for each pair of columns. So `tilings · (d + d(d − 1)/2)` features are active in all, or
/// `tilings · d` without pairs. Values outside the range are in the first or the last tile. Pairs, instead of all columns at once, keep the
/// weights few, as in the public code of the literature's experiments.
#[derive(Clone, Debug)]
pub(crate) struct Tiles {
    tilings: usize,
    /// Tiles per column in a tiling.
    cuts: usize,
    columns: usize,
    /// Whether pairs of columns have tiles too.
    has_pairs: bool,
    /// Shift of each column in each tiling, in tiles.
    shifts: Vec<f32>,
    /// The tile of each column in the current tiling.
    at: Vec<u32>,
}

impl Tiles {
    pub(crate) fn new(tilings: usize, tiles: usize, columns: usize, has_pairs: bool) -> Self {
        let shifts = (0..tilings * columns)
            .map(|place: usize| {
                let tiling = place / columns;
                let column = place % columns;
                ((1 + 2 * column) * tiling % tilings) as f32 / tilings as f32
            })
            .collect();
        Self { tilings, cuts: tiles, columns, has_pairs, shifts, at: vec![0; columns] }
    }

    /// Returns the tiles of one column in one tiling: one more than `cuts`, because tilings are shifted.
    fn per_column(&self) -> usize {
        self.cuts + 1
    }

    fn pairs(&self) -> usize {
        if self.has_pairs { self.columns * self.columns.saturating_sub(1) / 2 } else { 0 }
    }

    /// Returns the number of features.
    pub(crate) fn len(&self) -> usize {
        let per = self.per_column();
        self.tilings * (self.columns * per + self.pairs() * per * per)
    }

    /// Returns the number of features that are active at a time.
    pub(crate) fn active(&self) -> usize {
        self.tilings * self.active_per_tiling()
    }

    /// Returns the number of active features in one tiling.
    pub(crate) fn active_per_tiling(&self) -> usize {
        self.columns + self.pairs()
    }

    /// Writes the active features of `state` to `features`.
    pub(crate) fn put_features(&mut self, state: &[f32], features: &mut Vec<u32>) {
        features.clear();
        let per = self.per_column() as u32;
        let mut base = 0;
        for shifts in self.shifts.chunks_exact(self.columns.max(1)) {
            for ((at, value), shift) in self.at.iter_mut().zip(state).zip(shifts) {
                let place = (value * self.cuts as f32 + shift).max(0.0) as u32;
                *at = place.min(per - 1);
                features.push(base + *at);
                base += per;
            }
            let paired = if self.has_pairs { self.columns } else { 0 };
            for first in 0..paired {
                for second in first + 1..self.columns {
                    features.push(base + self.at[first] * per + self.at[second]);
                    base += per * per;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn features_are_as_many_as_said_different_and_inside(
            state in proptest::collection::vec(-0.5_f32..1.5, 1..6),
            tilings in 1_usize..9,
            tiles in 1_usize..9,
            has_pairs in any::<bool>(),
        ) {
            let mut coder = Tiles::new(tilings, tiles, state.len(), has_pairs);
            let mut features = Vec::new();
            coder.put_features(&state, &mut features);
            prop_assert_eq!(features.len(), coder.active());
            prop_assert!(features.windows(2).all(|pair| pair[0] < pair[1]));
            prop_assert!((features[features.len() - 1] as usize) < coder.len());
        }
    }

    /// Returns the number of features that both have.
    fn shared(a: &[u32], b: &[u32]) -> usize {
        a.iter().filter(|one| b.contains(one)).count()
    }

    #[test]
    fn near_states_share_features_and_far_ones_do_not() {
        let mut coder = Tiles::new(16, 8, 2, true);
        let [here, near, far] = [[0.5, 0.5], [0.52, 0.5], [0.9, 0.1]].map(|state: [f32; 2]| {
            let mut features = Vec::new();
            coder.put_features(&state, &mut features);
            features
        });
        assert!(shared(&here, &near) > 30, "of 48");
        assert_eq!(shared(&here, &far), 0);
    }
}
