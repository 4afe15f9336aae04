//! The output of steps. The observer decides where it
//! goes.

mod escape;
mod format;
mod observer;
mod printer;

pub use calib_core::{number, percent, rounded};
pub use escape::{Lines, harmless, harmless_json};
pub use format::{about, bytes, count, counted, duration, duration_of_secs, results, span, table};
pub use observer::{
    Announced, Observer, OutputFormat, Remark, ResultPart, Shown, Stage, Unobserved,
};
pub use printer::Printer;
