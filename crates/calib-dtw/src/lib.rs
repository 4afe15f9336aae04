//! Dynamic time warping: every step pattern, any length.
