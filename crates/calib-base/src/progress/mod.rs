//! Progress notes of running commands, stored beside their results, so that other processes can read the
//! progress.

mod note;
mod recorder;

pub use note::{CommandState, Note, running};
pub use recorder::recorded;
