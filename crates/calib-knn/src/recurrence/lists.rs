use std::collections::HashMap;

use calib_core::RowIndex;

use super::{
    Halt,
    member_search::{Distances, MemberSearch},
};
use crate::{Exclusion, bits::Bits, groups::hash};

/// Most neighbours that are found for one row in advance.
const DEEPEST: usize = 1 << 12;
/// Most neighbours that are kept.
const KEPT: usize = 1 << 21;

/// The nearest sources of some rows, found in advance of those that are about to be left out.
///
/// Where nothing is forbidden to a query, rows with equal states share a list: a long standstill, whose first rows are left out a
/// few at a time, is searched again only when a list is used up, and lists grow.
#[derive(Default)]
pub(super) struct Lists {
    of_rows: HashMap<u32, List>,
    /// Rows by a hash of their state.
    rows: HashMap<u64, Vec<u32>>,
    /// Neighbours in all lists.
    kept: usize,
}

#[derive(Default)]
struct List {
    /// Transitions and the distances that were searched by, nearest first.
    nearest: Vec<(u32, f32)>,
    /// So many were asked for.
    depth: usize,
    /// Whether there are no others.
    complete: bool,
}

impl List {
    /// Whether the first `k` are known, without what is left out.
    fn has(&mut self, k: usize, gone: &Bits) -> bool {
        self.nearest.retain(|&(to, _)| !gone.contains(to));
        self.nearest.len() >= k || self.complete
    }
}

impl Lists {
    /// The `k` nearest sources of what `rows` begins with that are not left out; fewer if there are not as many. The other rows are those
    /// that are likely to be asked for next: searched together they take little longer.
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

    /// Search for a longer list of row `key`, and for the first ones of the rows beside it.
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

    /// The row whose list `row` has: the first that was asked for with the same state, unless something is forbidden to it alone.
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
