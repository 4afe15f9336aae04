//! Headings of options that all commands share.

/// Heading of the options about output.
pub(super) const OUTPUT: &str = "What is shown";
