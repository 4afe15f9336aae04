use std::collections::HashMap;

use calib_core::RowIndex;

use super::{
    Halt,
    again::{Again, Distances},
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
    lists: HashMap<u32, List>,
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

impl Lists {
    /// The `k` nearest sources of `row` that are not left out; fewer if there are not as many.
    pub(super) fn first(
        &mut self,
        again: &Again<'_>,
        row: RowIndex,
        k: usize,
        exclusion: Exclusion,
        left_out: &[Bits],
    ) -> Result<Vec<(u32, f32)>, Halt> {
        if self.kept > KEPT {
            *self = Self::default();
        }
        let key = if exclusion == Exclusion::default() { self.same(again, row) } else { row.0 };
        let list = self.lists.entry(key).or_default();
        let gone = &left_out[again.member];
        let before = list.nearest.len();
        list.nearest.retain(|&(to, _)| !gone.contains(to));
        if list.nearest.len() < k && !list.complete {
            list.depth = (2 * list.depth).max(2 * k).min(DEEPEST.max(k));
            list.nearest.clear();
            let (row, nearest) = ([RowIndex(key)], &mut list.nearest);
            let searched = Distances::Searched;
            again.nearest(&row, list.depth, exclusion, left_out, searched, |_, to, far| {
                nearest.extend(to.iter().copied().zip(far.iter().copied()));
            })?;
            list.complete = list.nearest.len() < list.depth;
        }
        self.kept = self.kept + list.nearest.len() - before;
        Ok(list.nearest[..k.min(list.nearest.len())].to_vec())
    }

    /// The first row that was asked for whose state is that of `row`.
    fn same(&mut self, again: &Again<'_>, row: RowIndex) -> u32 {
        let state = again.state(row);
        let rows = self.rows.entry(hash(state)).or_default();
        let same = rows.iter().copied().find(|&other| again.state(RowIndex(other)) == state);
        same.unwrap_or_else(|| {
            rows.push(row.0);
            row.0
        })
    }
}
