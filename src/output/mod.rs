//! What a person or a machine reads: results on stdout, talk and progress on stderr.

mod format;
mod harmless;
mod printer;
mod progress;

pub(crate) use format::{bytes, count, counted, duration, percent, significant, span, table};
pub(crate) use harmless::{Lines, harmless};
pub(crate) use printer::Printer;
pub(crate) use progress::{ProgressMonitor, watch_for_interrupts};
