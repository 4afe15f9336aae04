//! The geometries of the named step patterns, unrolled at compile time.
//!
//! A shape is the branches of a pattern without its weights, which are run-time values. A user's
//! pattern with one of these geometries runs as fast as the named one. Any other pattern uses
//! [`super::column::interpreted`].

use super::lanes::Lanes;
use super::terms::Terms;

/// Samples counted backwards along (query, reference).
pub(crate) type Offset = (usize, usize);

/// Branches of a shape: the origin, and the cells whose cost is added, all counted backwards.
pub(crate) type Geometry = &'static [(Offset, &'static [Offset])];

/// Returns the longest advances along query and reference, and the number of columns whose cost is
/// added.
const fn extent(geometry: Geometry) -> (usize, usize, usize) {
    // A constant function supports only `while`.
    const fn larger(a: usize, b: usize) -> usize {
        if a > b { a } else { b }
    }
    let mut halo = 0;
    let mut reach = 0;
    let mut columns = 1;
    let mut branch = 0;
    while branch < geometry.len() {
        let (origin, cells) = geometry[branch];
        halo = larger(halo, origin.0);
        reach = larger(reach, origin.1);
        let mut cell = 0;
        while cell < cells.len() {
            columns = larger(columns, cells[cell].1 + 1);
            cell += 1;
        }
        branch += 1;
    }
    (halo, reach, columns)
}

/// A geometry with straight-line code for one cell.
pub(crate) trait Shape {
    /// The geometry as data, to recognise a pattern.
    const GEOMETRY: Geometry;
    /// Longest advance along the query.
    const HALO: usize = extent(Self::GEOMETRY).0;
    /// Longest advance along the reference.
    const REACH: usize = extent(Self::GEOMETRY).1;
    /// Number of columns of local distances that are read.
    const LOCAL_COLUMNS: usize = extent(Self::GEOMETRY).2;

    /// Returns the minimum over the branches, for one pack of cells.
    ///
    /// # Safety
    /// The instruction set of `L` must be present, and `terms` must contain the values that
    /// `GEOMETRY` reads.
    unsafe fn least<L: Lanes>(terms: &Terms<'_, L>) -> L::V;
}

macro_rules! shape {
    ($(#[$doc:meta])* $name:ident:
     $( ($a:literal, $b:literal) pays $( ($di:literal, $dj:literal) )+ ; )+) => {
        $(#[$doc])*
        pub(crate) struct $name;

        impl Shape for $name {
            const GEOMETRY: Geometry = &[ $( (($a, $b), &[ $( ($di, $dj) ),+ ]) ),+ ];

            #[inline(always)]
            unsafe fn least<L: Lanes>(terms: &Terms<'_, L>) -> L::V {
                // The compiler knows these counters and options, and removes them.
                let mut least: Option<L::V> = None;
                let mut waiting: Option<L::V> = None;
                let mut cell = 0;
                $(
                    let mut cost: Option<L::V> = None;
                    $(
                        // SAFETY: passed on from the caller.
                        let paid = unsafe { L::mul(terms.weight(cell), terms.local($di, $dj)) };
                        cost = Some(match cost {
                            None => paid,
                            // SAFETY: passed on from the caller.
                            Some(cost) => unsafe { L::add(cost, paid) },
                        });
                        cell += 1;
                    )+
                    if let Some(cost) = cost {
                        // SAFETY: passed on from the caller.
                        let candidate = unsafe { L::add(terms.origin($a, $b), cost) };
                        // A branch that starts in the current column comes last. It waits for the
                        // cell above; the other branches do not.
                        let slot = if $b == 0 { &mut waiting } else { &mut least };
                        *slot = Some(match *slot {
                            None => candidate,
                            // SAFETY: passed on from the caller.
                            Some(other) => unsafe { L::min(other, candidate) },
                        });
                    }
                )+
                let _ = cell;
                match (least, waiting) {
                    // SAFETY: passed on from the caller.
                    (Some(least), Some(waiting)) => unsafe { L::min(least, waiting) },
                    (Some(one), None) | (None, Some(one)) => one,
                    // SAFETY: passed on from the caller. (A shape has at least one branch.)
                    (None, None) => unsafe { L::splat(f64::INFINITY) },
                }
            }
        }
    };
}

shape! {
    /// Single steps: symmetric1, symmetric2, the P0 patterns, Rabiner–Juang I.
    Single:
    (1, 0) pays (0, 0);
    (1, 1) pays (0, 0);
    (0, 1) pays (0, 0);
}
shape! {
    /// asymmetric.
    Asymmetric:
    (1, 0) pays (0, 0);
    (1, 1) pays (0, 0);
    (1, 2) pays (0, 0);
}
shape! {
    /// Sakoe–Chiba P1, Rabiner–Juang II.
    TypeTwo:
    (2, 1) pays (1, 0) (0, 0);
    (1, 1) pays (0, 0);
    (1, 2) pays (0, 1) (0, 0);
}
shape! {
    /// Rabiner–Juang III.
    TypeThree:
    (2, 1) pays (0, 0);
    (1, 1) pays (0, 0);
    (1, 2) pays (0, 0);
}
shape! {
    /// Rabiner–Juang IV.
    TypeFour:
    (2, 1) pays (1, 0) (0, 0);
    (2, 2) pays (1, 0) (0, 0);
    (1, 1) pays (0, 0);
    (1, 2) pays (0, 0);
}
shape! {
    /// Sakoe–Chiba P05, Rabiner–Juang V.
    TypeFive:
    (3, 1) pays (2, 0) (1, 0) (0, 0);
    (2, 1) pays (1, 0) (0, 0);
    (1, 1) pays (0, 0);
    (1, 2) pays (0, 1) (0, 0);
    (1, 3) pays (0, 2) (0, 1) (0, 0);
}
shape! {
    /// Sakoe–Chiba P2, Rabiner–Juang VI.
    TypeSix:
    (3, 2) pays (2, 1) (1, 0) (0, 0);
    (1, 1) pays (0, 0);
    (2, 3) pays (1, 2) (0, 1) (0, 0);
}
shape! {
    /// Rabiner–Juang VII.
    TypeSeven:
    (3, 1) pays (2, 0) (1, 0) (0, 0);
    (3, 2) pays (2, 0) (1, 0) (0, 0);
    (3, 3) pays (2, 0) (1, 0) (0, 0);
    (2, 1) pays (1, 0) (0, 0);
    (2, 2) pays (1, 0) (0, 0);
    (2, 3) pays (1, 0) (0, 0);
    (1, 1) pays (0, 0);
    (1, 2) pays (0, 0);
    (1, 3) pays (0, 0);
}
