//! The choice of a kernel: instruction set × shape × masked or not.

use std::fmt;

use super::column::{
    AbsoluteKernel, ColumnInput, EuclideanKernel, InterpretedBranch, LocalInput, LocalKernel,
    SquaredKernel, compiled, interpreted, local,
};
use super::lanes::Portable;
use super::shapes::{
    Asymmetric, Shape, Single, TypeFive, TypeFour, TypeSeven, TypeSix, TypeThree, TypeTwo,
};
#[cfg(target_arch = "x86_64")]
use super::x86::{Avx2, Avx512};
use crate::{LocalDistance, StepPattern};

/// The vector instructions that compute distances. The results are bit-identical for all of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum InstructionSet {
    /// Plain loops that the compiler translates for the target.
    Portable,
    /// AVX2 (`x86_64`).
    Avx2,
    /// AVX-512F (`x86_64`).
    Avx512,
}

impl InstructionSet {
    /// Returns those that this processor has, slowest first.
    pub fn available() -> Vec<Self> {
        let mut sets = vec![Self::Portable];
        #[cfg(target_arch = "x86_64")]
        {
            if std::is_x86_feature_detected!("avx2") {
                sets.push(Self::Avx2);
            }
            if std::is_x86_feature_detected!("avx512f") {
                sets.push(Self::Avx512);
            }
        }
        sets
    }

    /// Returns the fastest that this processor has.
    pub fn best() -> Self {
        Self::available().pop().unwrap_or(Self::Portable)
    }

    /// Returns the name in lower case.
    pub fn name(self) -> &'static str {
        match self {
            Self::Portable => "portable",
            Self::Avx2 => "avx2",
            Self::Avx512 => "avx512",
        }
    }
}

impl fmt::Display for InstructionSet {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

type ColumnFn = unsafe fn(&mut ColumnInput<'_>);
type LocalFn = unsafe fn(&mut LocalInput<'_>);

/// The kernel of a local distance.
#[derive(Clone, Copy)]
pub(crate) struct LocalDispatch(LocalFn);

impl LocalDispatch {
    pub(crate) fn run(self, input: &mut LocalInput<'_>) {
        // SAFETY: `local_dispatch` picks kernels of an instruction set that was detected.
        unsafe { (self.0)(input) }
    }
}

/// The kernels of a pattern, with its weights in the order that they expect.
#[derive(Clone)]
pub(crate) struct PatternDispatch {
    plain: ColumnFn,
    masked: ColumnFn,
    pub(crate) weights: Vec<f64>,
    pub(crate) branches: Vec<InterpretedBranch>,
}

impl PatternDispatch {
    pub(crate) fn run(&self, use_mask: bool, input: &mut ColumnInput<'_>) {
        let kernel = if use_mask { self.masked } else { self.plain };
        // SAFETY: `pattern_dispatch` picks kernels of an instruction set that was detected.
        unsafe { kernel(input) }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
unsafe fn local_avx2<K: LocalKernel>(input: &mut LocalInput<'_>) {
    // SAFETY: AVX2 is this function's own promise.
    unsafe { local::<Avx2, K>(input) }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f")]
unsafe fn local_avx512<K: LocalKernel>(input: &mut LocalInput<'_>) {
    // SAFETY: AVX-512F is this function's own promise.
    unsafe { local::<Avx512, K>(input) }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
unsafe fn compiled_avx2<S: Shape, const MASKED: bool>(input: &mut ColumnInput<'_>) {
    // SAFETY: AVX2 is this function's own promise.
    unsafe { compiled::<Avx2, S, MASKED>(input) }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f")]
unsafe fn compiled_avx512<S: Shape, const MASKED: bool>(input: &mut ColumnInput<'_>) {
    // SAFETY: AVX-512F is this function's own promise.
    unsafe { compiled::<Avx512, S, MASKED>(input) }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
unsafe fn interpreted_avx2<const MASKED: bool>(input: &mut ColumnInput<'_>) {
    // SAFETY: AVX2 is this function's own promise.
    unsafe { interpreted::<Avx2, MASKED>(input) }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f")]
unsafe fn interpreted_avx512<const MASKED: bool>(input: &mut ColumnInput<'_>) {
    // SAFETY: AVX-512F is this function's own promise.
    unsafe { interpreted::<Avx512, MASKED>(input) }
}

fn local_for<K: LocalKernel>(set: InstructionSet) -> LocalFn {
    match set {
        #[cfg(target_arch = "x86_64")]
        InstructionSet::Avx2 => local_avx2::<K>,
        #[cfg(target_arch = "x86_64")]
        InstructionSet::Avx512 => local_avx512::<K>,
        _ => local::<Portable, K>,
    }
}

/// Returns the kernel of `distance` over `channels`; `set` must be available.
pub(crate) fn local_dispatch(
    set: InstructionSet,
    distance: LocalDistance,
    channels: usize,
) -> LocalDispatch {
    debug_assert!(InstructionSet::available().contains(&set));
    LocalDispatch(match distance {
        // The absolute distance is exact, and cheaper than the root of a square.
        LocalDistance::Euclidean if channels == 1 => local_for::<AbsoluteKernel>(set),
        LocalDistance::Absolute => local_for::<AbsoluteKernel>(set),
        LocalDistance::Squared => local_for::<SquaredKernel>(set),
        LocalDistance::Euclidean => local_for::<EuclideanKernel>(set),
    })
}

/// Returns the weights of `pattern` in the order of the shape's cells, if it has the shape's
/// geometry.
fn weights_for<S: Shape>(pattern: &StepPattern) -> Option<Vec<f64>> {
    if pattern.branches().len() != S::GEOMETRY.len() {
        return None;
    }
    let mut weights = Vec::new();
    for (origin, cells) in S::GEOMETRY {
        let branch = pattern.branches().iter().find(|branch| {
            let own = branch.cells().map(|cell| (cell.query, cell.reference));
            branch.origin() == *origin && own.eq(cells.iter().copied())
        })?;
        weights.extend(branch.cells().map(|cell| cell.weight));
    }
    Some(weights)
}

fn compiled_for<S: Shape>(set: InstructionSet, pattern: &StepPattern) -> Option<PatternDispatch> {
    let weights = weights_for::<S>(pattern)?;
    let (plain, masked): (ColumnFn, ColumnFn) = match set {
        #[cfg(target_arch = "x86_64")]
        InstructionSet::Avx2 => (compiled_avx2::<S, false>, compiled_avx2::<S, true>),
        #[cfg(target_arch = "x86_64")]
        InstructionSet::Avx512 => (compiled_avx512::<S, false>, compiled_avx512::<S, true>),
        _ => (compiled::<Portable, S, false>, compiled::<Portable, S, true>),
    };
    Some(PatternDispatch { plain, masked, weights, branches: Vec::new() })
}

fn interpreted_for(set: InstructionSet, pattern: &StepPattern) -> PatternDispatch {
    let (plain, masked): (ColumnFn, ColumnFn) = match set {
        #[cfg(target_arch = "x86_64")]
        InstructionSet::Avx2 => (interpreted_avx2::<false>, interpreted_avx2::<true>),
        #[cfg(target_arch = "x86_64")]
        InstructionSet::Avx512 => (interpreted_avx512::<false>, interpreted_avx512::<true>),
        _ => (interpreted::<Portable, false>, interpreted::<Portable, true>),
    };
    let branches = pattern.branches().iter();
    PatternDispatch {
        plain,
        masked,
        weights: Vec::new(),
        branches: branches
            .map(|branch| InterpretedBranch {
                origin: branch.origin(),
                cells: branch
                    .cells()
                    .map(|cell| (cell.query, cell.reference, cell.weight))
                    .collect(),
            })
            .collect(),
    }
}

/// Returns the fastest kernels for `pattern`; `set` must be available.
pub(crate) fn pattern_dispatch(set: InstructionSet, pattern: &StepPattern) -> PatternDispatch {
    debug_assert!(InstructionSet::available().contains(&set));
    compiled_for::<Single>(set, pattern)
        .or_else(|| compiled_for::<Asymmetric>(set, pattern))
        .or_else(|| compiled_for::<TypeTwo>(set, pattern))
        .or_else(|| compiled_for::<TypeThree>(set, pattern))
        .or_else(|| compiled_for::<TypeFour>(set, pattern))
        .or_else(|| compiled_for::<TypeFive>(set, pattern))
        .or_else(|| compiled_for::<TypeSix>(set, pattern))
        .or_else(|| compiled_for::<TypeSeven>(set, pattern))
        .unwrap_or_else(|| interpreted_for(set, pattern))
}
