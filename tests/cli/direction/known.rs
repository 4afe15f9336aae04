//! Circles of files that are left.

/// Files that import from each other, and why.
pub(super) struct KnownCircle {
    pub(super) package: &'static str,
    /// Paths below the folder of the package's sources.
    pub(super) files: &'static [&'static str],
    pub(super) reason: &'static str,
}

/// The circles that are left. None is to be added: move what the files share into a file below them.
pub(super) const KNOWN: &[KnownCircle] = &[
];
