//! The nearest of many references, without computing most of the distances.

use rayon::prelude::*;

use crate::lower_bound::Bounds;
use crate::{Distance, Dtw, DtwError, Role, Series};

/// The reference nearest to a query.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nearest {
    /// Number of the reference in the list.
    pub index: usize,
    /// Its distance.
    pub distance: Distance,
    /// References that a lower bound ruled out.
    pub pruned: usize,
    /// References whose distance was begun and given up.
    pub abandoned: usize,
}

impl Dtw {
    /// A lower bound of [`Dtw::distance`]'s raw distance in time that grows with N + M.
    ///
    /// The greatest of: the first and the last cell (after Kim et al. 2001); the distances of all
    /// query samples to the envelope of the references they may be matched with, and the other way
    /// round (after Keogh 2002). Each sample counts with the least weight any path of the pattern
    /// pays in it, so the bound holds for every pattern, window and ends; it is weak for patterns
    /// that skip samples and useless (but still a bound) without a window unless the ranges of the
    /// series differ.
    ///
    /// # Errors
    /// If a series is empty, not finite or too large, or the channels differ.
    pub fn lower_bound<'a>(
        &self,
        query: impl Into<Series<'a>>,
        reference: impl Into<Series<'a>>,
    ) -> Result<f64, DtwError> {
        let (query, reference) = (query.into(), reference.into());
        self.check(query, reference)?;
        let bounds = Bounds::new(self.pattern(), self.settings(), query, reference.len());
        let keogh = bounds.query_outside(reference).max(bounds.reference_outside(reference));
        Ok(keogh.max(bounds.corners(reference)))
    }

    /// The reference with the least raw distance to `query`, the first of equals; `None` if no
    /// reference has an admissible path. References are tried in the order of their lower bounds,
    /// and given up as soon as they cannot win.
    ///
    /// # Errors
    /// As [`Dtw::lower_bound`], for any of the references.
    pub fn nearest<'a>(
        &self,
        query: impl Into<Series<'a>>,
        references: &[Series<'_>],
    ) -> Result<Option<Nearest>, DtwError> {
        let query = query.into();
        let mut bounds: Option<Bounds<'_>> = None;
        let mut order = Vec::with_capacity(references.len());
        query.checked(Role::Query)?;
        for (index, &reference) in references.iter().enumerate() {
            self.check(query, reference)?;
            let bounds = match &mut bounds {
                Some(bounds) if bounds.reference() == reference.len() => bounds,
                stale => stale.insert(Bounds::new(
                    self.pattern(),
                    self.settings(),
                    query,
                    reference.len(),
                )),
            };
            let least = bounds.corners(reference).max(bounds.reference_outside(reference));
            order.push((least, index));
        }
        order.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let mut best: Option<Nearest> = None;
        let (mut pruned, mut abandoned) = (0, 0);
        for (least, index) in order {
            let bound = best.map_or(f64::INFINITY, |best| best.distance.raw);
            if least > bound {
                pruned += 1;
                continue;
            }
            match self.distance_within(query, references[index], bound) {
                Err(DtwError::NoPath(_)) => {}
                Err(error) => return Err(error),
                Ok(None) => abandoned += 1,
                Ok(Some(distance)) => {
                    let wins = best
                        .is_none_or(|best| (distance.raw, index) < (best.distance.raw, best.index));
                    if wins {
                        best = Some(Nearest { index, distance, pruned: 0, abandoned: 0 });
                    }
                }
            }
        }
        Ok(best.map(|best| Nearest { pruned, abandoned, ..best }))
    }

    /// [`Dtw::nearest`] for many queries, in parallel on rayon's current pool.
    ///
    /// # Errors
    /// As [`Dtw::nearest`], for the first query that is wrong.
    pub fn nearest_of_each(
        &self,
        queries: &[Series<'_>],
        references: &[Series<'_>],
    ) -> Result<Vec<Option<Nearest>>, DtwError> {
        let all: Vec<_> =
            queries.par_iter().map(|query| self.nearest(*query, references)).collect();
        all.into_iter().collect()
    }
}
