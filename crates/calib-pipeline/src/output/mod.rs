//! What steps tell: to whom is the observer's affair.

mod format;
mod harmless;
mod observer;
mod printer;

pub(crate) use format::duration_of_secs;
pub use format::{
    about, bytes, count, counted, duration, percent, rounded, significant, span, table,
};
pub use harmless::{Lines, harmless, harmless_json};
pub use observer::{Announced, Answer, Observer, Remark, Result, Shown, Stage, Unobserved};
pub use printer::Printer;
