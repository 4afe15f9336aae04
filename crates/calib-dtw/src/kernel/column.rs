//! One column of one strip: local distances, then cumulated distances.
//!
//! A strip is 16 lanes × `height` rows of the query. Lane l contains rows l·height … of the strip,
//! and processes reference sample t − l at time t. Each lane is one column behind the lane above
//! it. So all sixteen are independent, and every access is aligned. Above the rows of a lane are
//! `halo` rows that repeat the last rows of the lane above.

use super::lanes::{LANES, Lanes, Pack};
use super::shapes::Shape;
use super::terms::Terms;

/// Columns of a strip, the current one first, then one, two … columns ago.
/// Each has `halo + height` packs.
pub(crate) type Columns = Vec<Box<[Pack]>>;

pub(crate) struct LocalInput<'a> {
    /// Query samples of the strip, channel after channel, as many packs each as `out`.
    pub(crate) query: &'a [Pack],
    /// Reference samples of the sixteen lanes, one array per channel.
    pub(crate) reference: &'a [&'a [f64; LANES]],
    pub(crate) out: &'a mut [Pack],
}

/// Restricts a column to a window, and starts paths.
#[derive(Clone, Copy)]
pub(crate) struct Mask<'a> {
    /// Reference sample of each lane.
    pub(crate) at: &'a Pack,
    /// First open reference sample of each row.
    pub(crate) low: &'a [Pack],
    /// Last open reference sample of each row.
    pub(crate) high: &'a [Pack],
    /// Cumulated distance where a path starts, +∞ elsewhere.
    pub(crate) seed: &'a [Pack],
}

/// The inputs of the cumulated distances of one column.
pub(crate) struct ColumnInput<'a> {
    /// Cumulated distances; the current column is written.
    pub(crate) cumulated: &'a mut Columns,
    /// Rows of `cumulated` above the lane's own.
    pub(crate) halo: usize,
    pub(crate) local: &'a Columns,
    /// Rows of `local` above the lane's own.
    pub(crate) local_halo: usize,
    /// Rows of a lane.
    pub(crate) height: usize,
    /// The `halo` cells above the strip in the current column, last row first.
    pub(crate) above: &'a [f64],
    /// Weights of the cells, in the order of the geometry.
    pub(crate) weights: &'a [f64],
    /// Branches for [`interpreted`].
    pub(crate) branches: &'a [InterpretedBranch],
    /// Used by the masked kernels only.
    pub(crate) mask: Mask<'a>,
}

/// A branch of a pattern with no compiled shape.
#[derive(Clone, Debug)]
pub(crate) struct InterpretedBranch {
    pub(crate) origin: (usize, usize),
    pub(crate) cells: Vec<(usize, usize, f64)>,
}

/// A local distance that is summed over channels.
pub(crate) trait LocalKernel {
    /// Returns one channel's term of the sum.
    ///
    /// # Safety
    /// The instruction set must be present.
    unsafe fn term<L: Lanes>(difference: L::V) -> L::V;
    /// Returns the local distance from the sum.
    ///
    /// # Safety
    /// The instruction set must be present.
    #[inline(always)]
    unsafe fn finish<L: Lanes>(sum: L::V) -> L::V {
        sum
    }
}

pub(crate) struct AbsoluteKernel;
pub(crate) struct SquaredKernel;
pub(crate) struct EuclideanKernel;

impl LocalKernel for AbsoluteKernel {
    #[inline(always)]
    unsafe fn term<L: Lanes>(difference: L::V) -> L::V {
        // SAFETY: passed on from the caller.
        unsafe { L::abs(difference) }
    }
}

impl LocalKernel for SquaredKernel {
    #[inline(always)]
    unsafe fn term<L: Lanes>(difference: L::V) -> L::V {
        // SAFETY: passed on from the caller.
        unsafe { L::mul(difference, difference) }
    }
}

impl LocalKernel for EuclideanKernel {
    #[inline(always)]
    unsafe fn term<L: Lanes>(difference: L::V) -> L::V {
        // SAFETY: passed on from the caller.
        unsafe { L::mul(difference, difference) }
    }
    #[inline(always)]
    unsafe fn finish<L: Lanes>(sum: L::V) -> L::V {
        // SAFETY: passed on from the caller.
        unsafe { L::sqrt(sum) }
    }
}

/// Computes the local distances of one column.
///
/// # Safety
/// The instruction set of `L` must be present.
#[inline(always)]
pub(crate) unsafe fn local<L: Lanes, K: LocalKernel>(input: &mut LocalInput<'_>) {
    let rows = input.out.len();
    // SAFETY: the instruction set is the caller's promise; everything else is checked.
    unsafe {
        let first = input.reference[0];
        let rest = &input.reference[1..];
        let y = L::load_unaligned(first);
        for (x, out) in input.query[..rows].iter().zip(&mut *input.out) {
            let sum = K::term::<L>(L::sub(L::load(x), y));
            L::store(if rest.is_empty() { K::finish::<L>(sum) } else { sum }, out);
        }
        for (channel, reference) in rest.iter().enumerate() {
            let y = L::load_unaligned(reference);
            let query = &input.query[(channel + 1) * rows..][..rows];
            for (x, out) in query.iter().zip(&mut *input.out) {
                let sum = L::add(L::load(out), K::term::<L>(L::sub(L::load(x), y)));
                L::store(if channel + 1 == rest.len() { K::finish::<L>(sum) } else { sum }, out);
            }
        }
    }
}

/// Fills the halo of the current column: the last rows of each lane move one lane down.
///
/// # Safety
/// The instruction set of `L` must be present.
#[inline(always)]
unsafe fn fill_halo<L: Lanes>(input: &mut ColumnInput<'_>) {
    let halo = input.halo;
    let height = input.height;
    if let [current, previous, ..] = input.cumulated.as_mut_slice() {
        for back in 1..=halo {
            // SAFETY: passed on from the caller.
            unsafe {
                let last = L::load(&previous[halo + height - back]);
                L::store(L::shift_in(last, input.above[back - 1]), &mut current[halo - back]);
            }
        }
    }
}

/// Closes the cells outside the window, and starts paths.
///
/// # Safety
/// The instruction set of `L` must be present.
#[inline(always)]
unsafe fn masked<L: Lanes>(mask: &Mask<'_>, row: usize, value: L::V) -> L::V {
    // SAFETY: passed on from the caller.
    unsafe {
        let low = L::load(&mask.low[row]);
        let high = L::load(&mask.high[row]);
        L::min(L::inside(L::load(mask.at), low, high, value), L::load(&mask.seed[row]))
    }
}

/// Computes the cumulated distances of one column, with the compiled code of a shape.
///
/// # Safety
/// The instruction set of `L` must be present.
#[inline(always)]
pub(crate) unsafe fn compiled<L: Lanes, S: Shape, const MASKED: bool>(input: &mut ColumnInput<'_>) {
    // SAFETY: passed on from the caller.
    unsafe { fill_halo::<L>(input) };
    let height = input.height;
    let (current, past) = match input.cumulated.split_first_mut() {
        Some((current, past)) => (current, &*past),
        None => return,
    };
    // The unchecked loads of `Terms` rely on these bounds.
    let rows = S::HALO + height;
    assert!(input.halo == S::HALO && past.len() >= S::REACH && !past.is_empty());
    assert!(past.iter().all(|column| column.len() == rows));
    assert!(input.local.len() >= S::LOCAL_COLUMNS);
    let local_rows = input.local_halo + height;
    assert!(input.local_halo >= S::HALO);
    assert!(input.local.iter().all(|column| column.len() == local_rows));

    let (halo, own) = current.split_at_mut(S::HALO);
    // SAFETY: passed on from the caller; the bounds are asserted above.
    unsafe {
        let mut terms = Terms::<L> {
            past: std::array::from_fn(|n| &*past[n.min(past.len() - 1)]),
            halo: S::HALO,
            local: std::array::from_fn(|n| &*input.local[n.min(input.local.len() - 1)]),
            local_halo: input.local_halo,
            weights: input.weights,
            row: 0,
            above: L::load(&halo[S::HALO - 1]),
        };
        for (row, out) in own.iter_mut().enumerate() {
            terms.row = row;
            let mut value = S::least(&terms);
            if MASKED {
                value = masked::<L>(&input.mask, row, value);
            }
            L::store(value, out);
            terms.above = value;
        }
    }
}

/// Computes the cumulated distances of one column, for any pattern.
///
/// # Safety
/// The instruction set of `L` must be present.
#[inline(always)]
pub(crate) unsafe fn interpreted<L: Lanes, const MASKED: bool>(input: &mut ColumnInput<'_>) {
    // SAFETY: passed on from the caller.
    unsafe { fill_halo::<L>(input) };
    for row in 0..input.height {
        // SAFETY: the instruction set is the caller's promise; everything else is checked.
        unsafe {
            let mut least = L::splat(f64::INFINITY);
            for branch in input.branches {
                let mut cost: Option<L::V> = None;
                for &(di, dj, weight) in &branch.cells {
                    let local = L::load(&input.local[dj][row + input.local_halo - di]);
                    let paid = L::mul(L::splat(weight), local);
                    cost = Some(match cost {
                        None => paid,
                        Some(cost) => L::add(cost, paid),
                    });
                }
                let (a, b) = branch.origin;
                let origin = L::load(&input.cumulated[b][row + input.halo - a]);
                if let Some(cost) = cost {
                    least = L::min(least, L::add(origin, cost));
                }
            }
            if MASKED {
                least = masked::<L>(&input.mask, row, least);
            }
            L::store(least, &mut input.cumulated[0][input.halo + row]);
        }
    }
}
