//! What steps tell: to whom is the observer's affair.

mod format;
mod harmless;
mod observer;
mod printer;

pub use format::{
    about, bytes, count, counted, duration, duration_of_secs, percent, rounded, significant, span,
    table,
};
pub use harmless::{Lines, harmless, harmless_json};
pub use observer::{Announced, Answer, Observer, Remark, Result, Shown, Stage, Unobserved};
pub use printer::Printer;
