//! What the branches of a step pattern read at one pack of cells.

use super::lanes::{Lanes, Pack};

/// The values that the branches of one pack of cells read.
pub(crate) struct Terms<'a, L: Lanes> {
    /// Cumulated distances one, two, three columns ago; aligned with `local` by `halo`.
    pub(super) past: [&'a [Pack]; 3],
    pub(super) halo: usize,
    pub(super) local: [&'a [Pack]; 3],
    pub(super) local_halo: usize,
    pub(super) weights: &'a [f64],
    pub(super) row: usize,
    pub(super) above: L::V,
}

impl<L: Lanes> Terms<'_, L> {
    /// Returns the cumulated distance `a` rows above and `b` columns ago.
    ///
    /// # Safety
    /// The instruction set must be present; `a` ≤ halo, `b` ≤ 3 or (a, b) = (1, 0).
    #[inline(always)]
    pub(crate) unsafe fn origin(&self, a: usize, b: usize) -> L::V {
        if b == 0 {
            debug_assert_eq!(a, 1);
            return self.above;
        }
        let column = self.past[b - 1];
        debug_assert!(a <= self.halo && self.row + self.halo - a < column.len());
        // SAFETY: a ≤ halo, and the column has halo + height packs (asserted on entry).
        unsafe { L::load(column.get_unchecked(self.row + self.halo - a)) }
    }

    /// Returns the local distance `di` rows above and `dj` columns ago.
    ///
    /// # Safety
    /// The instruction set must be present; `di` ≤ local halo, `dj` ≤ 2.
    #[inline(always)]
    pub(crate) unsafe fn local(&self, di: usize, dj: usize) -> L::V {
        let column = self.local[dj];
        debug_assert!(di <= self.local_halo && self.row + self.local_halo - di < column.len());
        // SAFETY: di ≤ local halo, and the column has local halo + height packs (asserted).
        unsafe { L::load(column.get_unchecked(self.row + self.local_halo - di)) }
    }

    /// Returns the weight of a cell, by its number.
    ///
    /// # Safety
    /// The instruction set must be present.
    #[inline(always)]
    pub(crate) unsafe fn weight(&self, cell: usize) -> L::V {
        // SAFETY: passed on from the caller.
        unsafe { L::splat(self.weights[cell]) }
    }
}
