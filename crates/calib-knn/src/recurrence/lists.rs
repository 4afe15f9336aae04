use std::collections::HashMap;

use calib_core::RowIndex;

use super::{
    halt::Halt,
    member_search::{Distances, MemberSearch},
};
use crate::{Exclusion, bits::Bits, groups::hash};

/// Maximum number of neighbours that are found for one row in advance.
const DEEPEST: usize = 1 << 12;
/// Maximum number of neighbours that are stored.
const KEPT: usize = 1 << 21;

/// A cache of nearest sources. It stores more than `k` per row, because some are about to be left out.
///
/// If no source is forbidden to a query, rows with equal states share a list. A long standstill loses its first rows a few at a time. It
/// is searched again only when a list is used up, and the lists grow each time.
#[derive(Default)]
pub(super) struct Lists {
    of_rows: HashMap<u32, List>,
    /// Rows by a hash of their state.
    rows: HashMap<u64, Vec<u32>>,
    /// Number of neighbours in all lists.
    kept: usize,
}

#[derive(Default)]
struct List {
    /// Transitions and their distances in the searched states, nearest first.
    nearest: Vec<(u32, f32)>,
    /// Number of neighbours that were requested.
    depth: usize,
    /// Whether the list contains every source that can be found.
    complete: bool,
}

impl List {
    /// Removes `gone` from the list, and returns whether the first `k` are still known.
    fn has(&mut self, k: usize, gone: &Bits) -> bool {
        self.nearest.retain(|&(to, _)| !gone.contains(to));
        self.nearest.len() >= k || self.complete
    }
}

impl Lists {
    /// Returns the `k` nearest sources of the first of `rows` that are not left out, or fewer if there are not as many. The other rows
    /// will probably be requested next. Searching them together takes little longer.
    pub(super) fn first(
        &mut self,
        search: &MemberSearch<'_>,
        rows: &[RowIndex],
        k: usize,
        left_out: &[Bits],
    ) -> Result<&[(u32, f32)], Halt> {
        let gone = &left_out[search.member];
        let key = self.key(search, rows[0]);
        if !self.of_rows.entry(key).or_default().has(k, gone) {
            self.search(search, key, &rows[1..], k, left_out)?;
        }
        let nearest = &self.of_rows[&key].nearest;
        Ok(&nearest[..k.min(nearest.len())])
    }

    /// Searches for a longer list for row `key`, and for first lists for the rows in `beside`.
    fn search(
        &mut self,
        search: &MemberSearch<'_>,
        key: u32,
        beside: &[RowIndex],
        k: usize,
        left_out: &[Bits],
    ) -> Result<(), Halt> {
        let depth = self.of_rows.get(&key).map_or(0, |list| list.depth);
        let depth = (2 * depth).max(4 * k).min(DEEPEST.max(k));
        if self.kept > KEPT {
            *self = Self::default();
        }
        let mut keys = vec![RowIndex(key)];
        for &row in beside {
            let key = RowIndex(self.key(search, row));
            if !self.of_rows.contains_key(&key.0) && !keys.contains(&key) {
                keys.push(key);
            }
        }
        let searched = Distances::Searched;
        let exclusion = search.exclusion;
        search.nearest(&keys, depth, exclusion, left_out, searched, |row, to, distances| {
            let nearest: Vec<_> = to.iter().copied().zip(distances.iter().copied()).collect();
            self.kept += nearest.len();
            let complete = nearest.len() < depth;
            self.of_rows.insert(keys[row].0, List { nearest, depth, complete });
        })?;
        Ok(())
    }

    /// Returns the row whose list `row` uses: the first requested row with the same state, unless an exclusion makes the lists different.
    fn key(&mut self, search: &MemberSearch<'_>, row: RowIndex) -> u32 {
        if search.exclusion != Exclusion::default() {
            return row.0;
        }
        let state = search.state(row);
        let rows = self.rows.entry(hash(state)).or_default();
        let same = rows.iter().copied().find(|&other| search.state(RowIndex(other)) == state);
        same.unwrap_or_else(|| {
            rows.push(row.0);
            row.0
        })
    }
}
