//! Output for people and machines: results on stdout, messages and progress on stderr.

mod interrupts;
mod journal;
mod progress;
mod stderr;
mod terminal;

pub(crate) use calib_pipeline::output::{Lines, harmless};
pub(crate) use interrupts::{
    AfterInterruption, interrupted, is_asked_to_stop, is_to_be_tried_again, watch_for_interrupts,
};
pub(crate) use journal::{Journal, Verbosity};
pub(crate) use stderr::excerpt;
pub(crate) use terminal::Terminal;
