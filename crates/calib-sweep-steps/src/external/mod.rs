//! Support for agents of other programs: it exports the streams of a sweep, and judges the results of
//! such agents.

mod read;
pub mod runs;
mod streams;

pub use streams::{ExternalCandidate, ExternalResult, StreamRun, SweepStreams};
