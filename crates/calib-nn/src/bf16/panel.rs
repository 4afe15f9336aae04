/// Number of columns of a panel: two AVX-512 vectors.
pub(super) const PANEL: usize = 32;

/// Number of pairs in a whole block of features.
pub(super) const HALF: usize = PANEL / 2;
