//! The geometries of the named step patterns, unrolled at compile time.
//!
//! A shape is the branches of a pattern without its weights; weights arrive at run time. A user's
//! pattern with one of these geometries runs as fast as the named one; any other goes through
//! [`super::column::interpreted`].

use super::column::Terms;
use super::lanes::Lanes;

/// Samples counted back along (query, reference).
pub(crate) type Offset = (usize, usize);

/// Branches of a shape: the origin, and the cells that are paid for, all counted back.
pub(crate) type Geometry = &'static [(Offset, &'static [Offset])];

/// A geometry with straight-line code for one cell.
pub(crate) trait Shape {
    /// The same as data, for recognising a pattern.
    const GEOMETRY: Geometry;
    /// Longest advance along the query.
    const HALO: usize;
    /// Longest advance along the reference.
    const REACH: usize;

    /// The least of the branches, for one pack of cells.
    ///
    /// # Safety
    /// The instruction set of `L` must be present, and `terms` must hold `HALO` and `REACH`.
    unsafe fn least<L: Lanes>(terms: &Terms<'_, L>) -> L::V;
}

macro_rules! shape {
    ($(#[$doc:meta])* $name:ident, halo $halo:literal, reach $reach:literal:
     $( ($a:literal, $b:literal) pays $( ($di:literal, $dj:literal) )+ ; )+) => {
        $(#[$doc])*
        pub(crate) struct $name;

        impl Shape for $name {
            const GEOMETRY: Geometry = &[ $( (($a, $b), &[ $( ($di, $dj) ),+ ]) ),+ ];
            const HALO: usize = $halo;
            const REACH: usize = $reach;

            #[inline(always)]
            unsafe fn least<L: Lanes>(terms: &Terms<'_, L>) -> L::V {
                // Counters and options are known to the compiler and vanish.
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
                        // A branch that starts in this very column comes last: it waits for the
                        // cell above, everything else need not.
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
    Single, halo 1, reach 1:
    (1, 0) pays (0, 0);
    (1, 1) pays (0, 0);
    (0, 1) pays (0, 0);
}
shape! {
    /// asymmetric.
    Asymmetric, halo 1, reach 2:
    (1, 0) pays (0, 0);
    (1, 1) pays (0, 0);
    (1, 2) pays (0, 0);
}
shape! {
    /// Sakoe–Chiba P1, Rabiner–Juang II.
    TypeTwo, halo 2, reach 2:
    (2, 1) pays (1, 0) (0, 0);
    (1, 1) pays (0, 0);
    (1, 2) pays (0, 1) (0, 0);
}
shape! {
    /// Rabiner–Juang III.
    TypeThree, halo 2, reach 2:
    (2, 1) pays (0, 0);
    (1, 1) pays (0, 0);
    (1, 2) pays (0, 0);
}
shape! {
    /// Rabiner–Juang IV.
    TypeFour, halo 2, reach 2:
    (2, 1) pays (1, 0) (0, 0);
    (2, 2) pays (1, 0) (0, 0);
    (1, 1) pays (0, 0);
    (1, 2) pays (0, 0);
}
shape! {
    /// Sakoe–Chiba P05, Rabiner–Juang V.
    TypeFive, halo 3, reach 3:
    (3, 1) pays (2, 0) (1, 0) (0, 0);
    (2, 1) pays (1, 0) (0, 0);
    (1, 1) pays (0, 0);
    (1, 2) pays (0, 1) (0, 0);
    (1, 3) pays (0, 2) (0, 1) (0, 0);
}
shape! {
    /// Sakoe–Chiba P2, Rabiner–Juang VI.
    TypeSix, halo 3, reach 3:
    (3, 2) pays (2, 1) (1, 0) (0, 0);
    (1, 1) pays (0, 0);
    (2, 3) pays (1, 2) (0, 1) (0, 0);
}
shape! {
    /// Rabiner–Juang VII.
    TypeSeven, halo 3, reach 3:
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
