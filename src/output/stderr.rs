//! Lines on standard error.

use std::io::{self, Write as _};

use calib_pipeline::output::{Lines, harmless};

/// Prints the lines of a file that an error is about.
pub(crate) fn excerpt(excerpt: &str) {
    for line in excerpt.lines() {
        eprint_line(&harmless(line, Lines::One));
    }
}

pub(super) fn eprint_line(text: &str) {
    // A closed stderr must not stop the work.
    let _ = writeln!(io::stderr().lock(), "{text}");
}
