//! Notes of commands that are at work, beside what they write: how far each is, for whoever looks from outside.

mod note;
mod recorder;

pub use note::{CommandState, Note, running};
pub use recorder::recorded;
