//! Agents that calib does not know: the streams of a sweep for them, and judgements of what they came to.

mod read;
pub mod runs;
mod streams;

pub use streams::{ExternalCandidate, ExternalResult, StreamRun, SweepStreams};
