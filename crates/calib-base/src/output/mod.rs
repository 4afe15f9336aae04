//! What steps tell: to whom is the observer's affair.

mod escape;
mod format;
mod observer;
mod printer;

pub use escape::{Lines, harmless, harmless_json};
pub use format::{
    about, bytes, count, counted, duration, duration_of_secs, percent, rounded, significant, span,
    table,
};
pub use observer::{
    Announced, Observer, OutputFormat, Remark, ResultPart, Shown, Stage, Unobserved,
};
pub use printer::Printer;
