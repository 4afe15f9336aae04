//! Widths of pictures.

/// Width of pictures for files, paper and wide screens, in pixels.
pub(crate) const WIDE: f64 = 960.0;
/// Width of pictures for phones, in pixels: pages leave that much of 390 pixels.
pub(crate) const NARROW: f64 = 340.0;
